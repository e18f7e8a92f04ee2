"""The command ``kumitate replay``: a plan as a page that plays in a browser."""

from __future__ import annotations

import argparse
from pathlib import Path

from .output import say, write_file


def add_replay(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "Write one HTML page that plays a plan in a browser, offline."
    parser.add_argument("plan", type=Path, help="a plan that `kumitate plan` wrote")
    parser.add_argument("--output", type=Path, metavar="HTML", help="the page; PLAN.html beside the plan unless given")
    parser.set_defaults(run=_replay)


def _replay(options: argparse.Namespace) -> int:
    from .document import Plan
    from .replay import write_replay

    plan = Plan.load(options.plan)
    page = options.output or options.plan.with_suffix(".html")
    write_file(page, lambda path: write_replay(plan, path))
    say(f"{len(plan.actions)} steps, {plan.duration:.1f} s -> {page} ({page.stat().st_size / 1e6:.1f} MB)")
    return 0
