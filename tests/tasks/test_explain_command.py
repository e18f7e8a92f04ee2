"""``kumitate explain``: what it says and writes, and how it ends: with a plan after all, without one, wrong input."""

from __future__ import annotations

import json
import os
import pty
import shutil
import subprocess
import sys

import pytest
from infeasible import ONE, folder, refusal
from plans import short_plan

from kumitate.errors import InputError, TimeLimitError
from kumitate.tasks import suggestions as module
from kumitate.tasks.cli import main
from kumitate.tasks.task_file import read_task

LID = "a lid over the part"
TASK = """\
robot: nextage
hands: {left: robotiq_2f85, right: robotiq_2f85}
cell:
  - {name: table, box: [300 mm, 1320 mm, 20 mm], at: {xyz: [0.40, 0, -0.06]}, support: true}
  - {name: lid, box: [200 mm, 200 mm, 10 mm], at: {xyz: [0.40, 0.25, 0.08]}}
parts:
  block: {mesh: block.stl, unit: m, mass: 100 g, at: {xyz: [0.40, 0.25, 0.01]}, grasps: {t_rnn: 6 mm}}
goals:
  - place: {part: block, at: {xyz: [0.40, 0.35, 0.01]}}
"""


@pytest.fixture
def task(tmp_path):
    """The file of the block under the lid."""
    shutil.copy(folder() / "block.stl", tmp_path)
    (tmp_path / "task.yaml").write_text(TASK, encoding="utf-8")
    return tmp_path / "task.yaml"


@pytest.fixture
def answers(monkeypatch):
    """Let the planner answer at once, as it would: under the lid with its refusal; what it was asked."""
    asked: list[tuple[object, dict[str, object]]] = []

    def answer(task, folder, **more):
        asked.append((task, more))
        if any(entry.name == "lid" for entry in task.cell):
            raise refusal(LID)
        return short_plan()

    for place in ("kumitate.tasks.planner.plan", "kumitate.tasks.suggestions.plan"):
        monkeypatch.setattr(place, answer)
    return asked


def test_the_file_is_the_task_that_is_spoken_of(task):
    read, expected = read_task(task), ONE[LID].task
    assert (read.parts, read.goals, read.hands) == (expected.parts, expected.goals, expected.hands)
    assert [entry.name for entry in read.cell] == [entry.name for entry in expected.cell]


# No plan --------------------------------------------------------------------------------------------------------------


def test_the_reason_is_told_then_what_would_help(task, answers, capsys):
    assert main(["explain", str(task)]) == 1
    captured = capsys.readouterr()
    assert captured.err == ""
    first, *lines = captured.out.splitlines()
    help_line = lines.index("what would help, one thing at a time:")
    assert first == str(refusal(LID))
    assert lines[:help_line] == [f"  {line}" for line in refusal(LID).report]
    assert lines[help_line + 1 :] == ["  without the obstacle lid there is a plan"]


def test_where_nothing_helps_that_is_told(task, answers, monkeypatch, capsys):
    def fail(task, folder, **more):
        raise refusal(LID)

    monkeypatch.setattr(module, "plan", fail)
    assert main(["explain", str(task)]) == 1
    assert capsys.readouterr().out.splitlines()[-2:] == [
        "what would help, one thing at a time:",
        "  nothing that was tried",
    ]


def test_seed_and_time_limit_hold_for_every_try(task, answers, capsys):
    main(["explain", str(task), "--seed", "7", "--time-limit", "5 s"])
    assert len(answers) > 2
    assert {(more["seed"], more["time_limit"]) for _, more in answers} == {(7, 5.0)}


def test_where_time_was_short_more_is_tried_and_there_is_no_page(task, monkeypatch, capsys, tmp_path):
    def answer(task, folder, *, time_limit, **more):
        if time_limit < 10.0:
            raise TimeLimitError(time_limit, "a way for block")
        return short_plan()

    for place in ("kumitate.tasks.planner.plan", "kumitate.tasks.suggestions.plan"):
        monkeypatch.setattr(place, answer)
    page = tmp_path / "page.html"
    assert main(["explain", str(task), "--time-limit", "4 s", "--view", str(page)]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "the time limit of 4 s was over while planning: a way for block; give more time",
        "what would help, one thing at a time:",
        "  with 16 s of time there is a plan",
        "no page: there is no candidate to show",
    ]
    assert not page.exists()


def test_json_is_all_that_is_printed_then(task, answers, capsys):
    assert main(["explain", str(task), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    error = refusal(LID)
    assert answer == {
        "planned": False,
        "because": str(error),
        "causes": [{"words": c.words, "bodies": list(c.bodies), "count": n} for c, n in error.report.causes],
        "report": list(error.report),
        "helps": ["without the obstacle lid there is a plan"],
    }
    assert answer["causes"][0]["bodies"] == ["lid"]


def test_the_page_shows_report_and_help(task, answers, capsys, tmp_path):
    page = tmp_path / "page.html"
    assert main(["explain", str(task), "--view", str(page)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == f"page -> {page}"
    text = page.read_text(encoding="utf-8")
    assert text.rstrip().endswith("</html>")
    for line in (refusal(LID).report.title, *refusal(LID).report, "without the obstacle lid there is a plan"):
        assert line in text


# A plan after all -----------------------------------------------------------------------------------------------------


def test_a_plan_is_exit_0(task, answers, capsys):
    task.write_text(task.read_text(encoding="utf-8").replace("name: lid", "name: other"), encoding="utf-8")
    assert main(["explain", str(task)]) == 0
    made = short_plan()
    told = f"there is a plan: {len(made.actions)} actions, {made.duration:.1f} s of motion\n"
    assert capsys.readouterr().out == told
    assert main(["explain", str(task), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"planned": True}


# Wrong input ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("robot: nextage", "robot: nextagge", "task.yaml:1: robot: "),
        ("mass: 100 g", "mass: 100 mm", "task.yaml:7: parts.block.mass: "),
        ("goals:", "gaols:", "gaols"),
    ],
)
def test_a_wrong_task_is_exit_2_in_one_line_with_file_and_line(task, capsys, old, new, words):
    task.write_text(TASK.replace(old, new), encoding="utf-8")
    assert main(["explain", str(task)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert words in captured.err
    assert captured.err.count("\n") == 1


def test_what_planning_finds_wrong_is_told_with_file_and_line(task, monkeypatch, capsys):
    def refuse(task, folder, **more):
        raise InputError("parts.block.at", "it floats", "put it down")

    monkeypatch.setattr("kumitate.tasks.planner.plan", refuse)
    assert main(["explain", str(task), "--json"]) == 2
    captured = capsys.readouterr()
    assert captured.err == f"kumitate: {task}:7: parts.block.at: it floats; put it down\n"
    assert json.loads(captured.out)["error"]["kind"] == "InputError"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seed", "one"], "--seed"),
        (["--time-limit", "0 s"], "--time-limit"),
        (["--view", "/proc/none/page.html"], "/proc/none/page.html: cannot be written"),
    ],
)
def test_a_wrong_option_is_one_line_before_any_planning(task, answers, capsys, arguments, words):
    assert main(["explain", str(task), *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not answers


# In earnest -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_on_a_terminal_lines_of_the_answer_take_the_place_of_what_is_being_done(task, tmp_path):
    page = tmp_path / "page.html"
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "kumitate.tasks.cli", "explain", str(task), "--view", str(page)]
    with subprocess.Popen(command, stdout=slave, stderr=slave) as running:
        os.close(slave)
        shown = b""
        try:
            while piece := os.read(master, 10_000):
                shown += piece
        except OSError:  # how Linux tells that nobody has the terminal any more
            pass
        assert running.wait() == 1
    os.close(master)
    lines = shown.decode().split("\r\n")
    assert any(" s  whether there is a plan without the obstacle lid" in line for line in lines)
    seen = [line.split("\r\x1b[K")[-1] for line in lines]
    first = seen.index("what would help, one thing at a time:")
    assert seen[0].startswith("goal 1 is not reached: no grasp of block works where it is: ")
    assert seen[first + 1 :] == ["  without the obstacle lid there is a plan", f"page -> {page}", ""]
    assert page.is_file()
