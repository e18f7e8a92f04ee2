"""``kumitate export``: the files it writes, what it says, how it ends."""

from __future__ import annotations

import argparse
import csv

import msgspec
import pytest
from plans import sample_plan

from kumitate.errors import InputError
from kumitate.tasks.export import Stretch, table, trajectories
from kumitate.tasks.export_command import add_export


@pytest.fixture
def plan_file(tmp_path):
    sample_plan().save(tmp_path / "job.json")
    return tmp_path / "job.json"


def run(*arguments):
    parser = argparse.ArgumentParser()
    add_export(parser)
    options = parser.parse_args([str(argument) for argument in arguments])
    return options.run(options)


def test_json_and_yaml_hold_the_same_trajectories(plan_file, capsys):
    kept = plan_file.read_bytes()
    assert run(plan_file, "--format", "ros-json", "--step", "100 ms") == 0
    assert run(plan_file, "--format", "ros-yaml", "--step", "0.1") == 0
    files = [plan_file.with_suffix(f".trajectories.{kind}") for kind in ("json", "yaml")]
    expected = trajectories(sample_plan(), step=0.1)
    assert msgspec.json.decode(files[0].read_bytes(), type=list[Stretch]) == expected
    assert msgspec.yaml.decode(files[1].read_bytes(), type=list[Stretch]) == expected
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{len(expected)} actions, {sample_plan().duration:.1f} s -> {files[0]}"
    assert plan_file.read_bytes() == kept


def test_csv_goes_where_it_is_told(plan_file, tmp_path):
    assert run(plan_file, "--format", "csv", "--output", tmp_path / "table.csv") == 0
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))
    assert rows == list(csv.reader(table(sample_plan()).splitlines()))
    assert run(plan_file, "--format", "csv") == 0
    assert plan_file.with_suffix(".csv").read_bytes() == (tmp_path / "table.csv").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--format", "csv", "--step", "20 apples"], "--step"),
        (["--format", "csv", "--step", "0"], "step"),
        (["--format", "csv", "--output", "/proc/none/x.csv"], "cannot be written"),
    ],
)
def test_a_wrong_input_is_told(plan_file, arguments, words):
    with pytest.raises(InputError, match=words):
        run(plan_file, *arguments)


def test_an_unknown_format_is_refused_with_those_there_are(plan_file, capsys):
    with pytest.raises(SystemExit) as ended:
        run(plan_file, "--format", "xml")
    assert ended.value.code == 2
    assert "ros-json" in capsys.readouterr().err
