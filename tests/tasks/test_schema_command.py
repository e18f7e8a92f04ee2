"""``kumitate schema``: it prints the schema of either format."""

from __future__ import annotations

import argparse
import json

import pytest

from kumitate.tasks.document import plan_schema
from kumitate.tasks.schema_command import add_schema
from kumitate.tasks.task_file import task_schema


@pytest.mark.parametrize(
    ("arguments", "schema"), [([], task_schema()), (["task"], task_schema()), (["plan"], plan_schema())]
)
def test_it_prints_the_schema_asked_for(capsys, arguments, schema):
    parser = argparse.ArgumentParser()
    add_schema(parser)
    options = parser.parse_args(arguments)
    assert options.run(options) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed.pop("$schema").startswith("https://json-schema.org/")
    assert printed == json.loads(json.dumps(schema))
