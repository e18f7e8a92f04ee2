"""The command ``kumitate schema``: the formats of task files and plans as JSON Schema, for editors and programs."""

from __future__ import annotations

import argparse
import json

from .output import say

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def add_schema(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "Print the JSON Schema of task files, or of the plans that `kumitate plan` writes."
    parser.add_argument("what", nargs="?", choices=("task", "plan"), default="task", help="task unless given")
    parser.set_defaults(run=_schema)


def _schema(options: argparse.Namespace) -> int:
    from .document import plan_schema
    from .task_file import task_schema

    schema = task_schema() if options.what == "task" else plan_schema()
    say(json.dumps({"$schema": _DIALECT, **schema}, indent=2))
    return 0
