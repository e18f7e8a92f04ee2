"""``kumitate replay``: the page it writes, what it says, how it ends."""

from __future__ import annotations

import argparse

import pytest
from plans import sample_plan

from kumitate.errors import InputError
from kumitate.tasks.replay_command import add_replay


@pytest.fixture
def plan_file(tmp_path):
    sample_plan().save(tmp_path / "job.json")
    return tmp_path / "job.json"


def run(*arguments):
    parser = argparse.ArgumentParser()
    add_replay(parser)
    options = parser.parse_args([str(argument) for argument in arguments])
    return options.run(options)


def test_the_page_is_named_after_the_plan_unless_named(plan_file, tmp_path, capsys):
    assert run(plan_file) == 0
    page = plan_file.with_suffix(".html")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    printed = capsys.readouterr().out
    assert printed.startswith(f"{len(sample_plan().actions)} steps, {sample_plan().duration:.1f} s -> {page} (")
    assert run(plan_file, "--output", tmp_path / "other.html") == 0
    assert (tmp_path / "other.html").is_file()


def test_a_wrong_file_or_place_is_told(plan_file, tmp_path):
    with pytest.raises(InputError, match=r"none\.json"):
        run(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("{}", encoding="utf-8")
    with pytest.raises(InputError, match=r"text\.json"):
        run(tmp_path / "text.json")
    with pytest.raises(InputError, match="cannot be written"):
        run(plan_file, "--output", "/proc/none/page.html")
