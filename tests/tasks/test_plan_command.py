"""``kumitate plan``: what it says and writes, and how it ends: planned, without a plan, wrong input, interrupted."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import pty
import shutil
import signal
import subprocess
import sys
from time import perf_counter

import pytest
import trimesh
from plans import short_plan

from kumitate.tasks.cli import main
from kumitate.tasks.document import Plan
from kumitate.tasks.plan_command import add_plan
from kumitate.tasks.planner import TIME_LIMIT
from kumitate.tasks.quantities import parse_quantity
from kumitate.tasks.verify import verify

TASK = """\
robot: nextage
hands: {left: robotiq_2f85, right: robotiq_2f85}
cell:
  - {name: table, box: [300 mm, 1320 mm, 20 mm], at: {xyz: [0.40, 0, -0.06]}, support: true}
parts:
  block: {mesh: block.stl, unit: mm, mass: 100 g, at: {xyz: [0.40, 0.30, 0.01]}}
goals:
  - place: {part: block, at: {xyz: [0.40, 0.20, 0.01]}}
"""


@pytest.fixture
def task(tmp_path):
    """The file of a small task: a block goes aside on its table."""
    trimesh.creation.box([30, 30, 120]).export(tmp_path / "block.stl")
    (tmp_path / "task.yaml").write_text(TASK, encoding="utf-8")
    return tmp_path / "task.yaml"


@pytest.fixture
def planned(monkeypatch):
    """Let the planner answer at once; what it was asked."""
    asked = {}

    def answer(task, folder, **more):
        asked.update(more, task=task, folder=folder)
        return short_plan()

    monkeypatch.setattr("kumitate.tasks.planner.plan", answer)
    return asked


def change(task, old, new):
    text = task.read_text(encoding="utf-8")
    assert old in text
    task.write_text(text.replace(old, new), encoding="utf-8")


# Planned --------------------------------------------------------------------------------------------------------------


def test_a_task_is_planned_verified_and_written_with_its_replay(task, capsys):
    assert main(["plan", str(task), "--seed", "7", "--replay"]) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    made = Plan.load(task.with_suffix(".plan.json"))
    assert made.seed == 7
    assert verify(made).ok
    page = task.with_suffix(".plan.html")
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    lines = captured.out.splitlines()
    for number, (action, line) in enumerate(zip(made.actions, lines, strict=False), start=1):
        assert line.split() == [str(number), f"{action.motion.duration:.1f}", "s", *action.words.split()]
    assert lines[len(made.actions)] == f"{len(made.actions)} actions, {made.duration:.1f} s of motion"
    assert all(f"{stage} {seconds:.1f} s" in captured.out for stage, seconds in made.seconds.items())
    assert "verified: no faults" in lines
    assert any(line.startswith(f"plan -> {task.with_suffix('.plan.json')} (") for line in lines)
    assert any(line.startswith(f"replay -> {page} (") for line in lines)
    assert sorted(file.name for file in task.parent.iterdir()) == [
        "block.stl",
        "task.plan.html",
        "task.plan.json",
        "task.yaml",
    ]


def test_the_options_reach_the_planner(task, planned, tmp_path):
    files = ["--output", str(tmp_path / "a.json"), "--replay", str(tmp_path / "b.html")]
    assert main(["plan", str(task), "--seed", "12", "--time-limit", "2 min", *files]) == 0
    assert (planned["seed"], planned["folder"]) == (12, tmp_path)
    assert 100.0 < planned["time_limit"] < 120.0  # what is left of it by then
    assert Plan.load(tmp_path / "a.json") == short_plan()
    assert (tmp_path / "b.html").is_file()


def test_without_options_the_planner_has_its_own(task, planned):
    assert main(["plan", str(task)]) == 0
    assert planned["seed"] == 0
    assert planned["time_limit"] == pytest.approx(TIME_LIMIT, abs=10.0)
    parser = argparse.ArgumentParser()
    add_plan(parser)
    assert parse_quantity(parser.parse_args(["task.yaml"]).time_limit, "time", "") == TIME_LIMIT


def test_json_is_all_that_is_printed_then(task, planned, capsys):
    assert main(["plan", str(task), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer == {
        "plan": str(task.with_suffix(".plan.json")),
        "replay": None,
        "actions": len(short_plan().actions),
        "duration": short_plan().duration,
        "seconds": short_plan().seconds,
        "verified": True,
    }


# No plan --------------------------------------------------------------------------------------------------------------


def test_no_plan_is_exit_1_with_the_cause_and_what_was_tried(task, capsys):
    change(task, "place: {part: block, at: {xyz: [0.40, 0.20, 0.01]}}", "hand_over: {part: block, to: left, at: {}}")
    assert main(["plan", str(task), "--json"]) == 1
    captured = capsys.readouterr()
    first, *report = captured.err.splitlines()
    assert first.startswith("kumitate: goal 1 is not reached: ")
    assert len(report) > 1
    assert all(line.startswith("  ") for line in report)
    error = json.loads(captured.out)["error"]
    assert error["kind"] == "NoPlanError"
    assert error["report"] == [line[2:] for line in report]
    assert not task.with_suffix(".plan.json").exists()


def test_a_time_limit_that_is_over_is_exit_1(task, capsys):
    assert main(["plan", str(task), "--time-limit", "1 ms"]) == 1
    assert "the time limit of 0.001 s was over" in capsys.readouterr().err


@pytest.mark.parametrize("limit", [0.2, 0.7])
def test_the_time_limit_is_that_of_the_whole_command(task, limit):
    command = [sys.executable, "-m", "kumitate.tasks.cli", "plan", str(task), "--json", "--time-limit", f"{limit} s"]
    before = perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert perf_counter() - before < limit + 1.0
    assert done.returncode == 1
    words = f"the time limit of {limit} s was over while planning: "
    assert done.stderr.startswith(f"kumitate: {words}")
    error = json.loads(done.stdout)["error"]
    assert error["kind"] == "TimeLimitError"
    assert error["message"].startswith(words)
    assert sorted(file.name for file in task.parent.iterdir()) == ["block.stl", "task.yaml"]


@pytest.mark.parametrize("where", ["planner.plan", "replay.write_replay"])
def test_the_time_limit_holds_in_libraries_that_do_not_come_back(task, where, tmp_path):
    module, name = where.split(".")
    script = (
        "import sys\n"
        f"from kumitate.tasks import cli, document, {module}, planner\n"
        "plan = document.Plan.load(sys.argv.pop(1))\n"
        "planner.plan = lambda *args, **more: plan\n"
        f"{module}.{name} = lambda *args, **more: sum(range(10**12))\n"
        "sys.exit(cli.main())\n"
    )
    short_plan().save(tmp_path / "short.json")
    command = [sys.executable, "-c", script, str(tmp_path / "short.json"), "plan", str(task), "--replay"]
    done = subprocess.run([*command, "--time-limit", "1.5 s"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    doing = {"planner": "the start", "replay": "replay"}[module]
    assert done.stderr == f"kumitate: the time limit of 1.5 s was over while planning: {doing}; give more time\n"
    made = {file.name for file in task.parent.iterdir()} - {"block.stl", "task.yaml", "short.json"}
    assert made == {"planner": set(), "replay": {"task.plan.json"}}[module]
    assert all(Plan.load(task.parent / name) == short_plan() for name in made)


# Wrong input ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("robot: nextage", "robot: nextagge", "task.yaml:1: robot: "),
        ("left: robotiq_2f85", "left: robotiq", "task.yaml:2: hands.left: "),
        ("xyz: [0.40, 0.30, 0.01]", "xyz: [0.40, 0.30, 0.05]", "task.yaml:6: parts.block"),  # floats
        ("xyz: [0.40, 0.30, 0.01]", "xyz: [0.40, 0.30, -0.01]", "task.yaml:6: parts.block"),  # sinks
        ("mass: 100 g", "mass: 100 mm", "task.yaml:6: parts.block.mass: "),
        ("{part: block,", "{part: blokc,", "task.yaml:8: goals[0].place.part: "),
        ("goals:", "gaols:", "gaols"),
        ("block.stl", "none.stl", "task.yaml:6: parts.block.mesh: "),
    ],
)
def test_a_wrong_task_is_one_line_with_file_and_line(task, capsys, old, new, words):
    change(task, old, new)
    assert main(["plan", str(task)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("kumitate: ")
    assert words in error
    assert error.count("\n") == 1
    assert not task.with_suffix(".plan.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seed", "-1"], "--seed"),
        (["--seed", "one"], "--seed"),
        (["--seed", "99999999999999999999"], "--seed"),
        (["--time-limit", "0 s"], "--time-limit"),
        (["--time-limit", "-5 s"], "--time-limit"),
        (["--time-limit", "1 kg"], "--time-limit"),
        (["--output", "/proc/none/plan.json"], "/proc/none/plan.json: cannot be written"),
        (["--replay", "/proc/none/page.html"], "/proc/none/page.html: cannot be written"),
        (["--output", "FOLDER"], "cannot be written"),
        (["--output", "FOLDER/task.yaml"], "name every file differently"),
        (["--output", "FOLDER/a.json", "--replay", "FOLDER/a.json"], "name every file differently"),
    ],
)
def test_a_wrong_option_is_one_line_before_any_planning(task, planned, capsys, arguments, words):
    written = [argument.replace("FOLDER", str(task.parent)) for argument in arguments]
    assert main(["plan", str(task), *written]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not planned
    assert task.read_text(encoding="utf-8") == TASK


def test_a_task_file_that_is_not_there_is_exit_2(tmp_path, capsys):
    assert main(["plan", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err


# A terminal -----------------------------------------------------------------------------------------------------------


@pytest.fixture
def at_terminal(task):
    """`kumitate plan` with its errors on a terminal, and what reads that."""
    master, slave = pty.openpty()
    command = [sys.executable, "-m", "kumitate.tasks.cli", "plan", str(task), "--replay"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=slave, text=True) as running:
        os.close(slave)
        yield running, lambda: os.read(master, 10_000).decode()
        running.kill()
    os.close(master)


def rest_of(read):
    """All that comes until the terminal is closed."""
    shown = ""
    try:
        while piece := read():
            shown += piece
    except OSError:  # how Linux tells that nobody has the terminal any more
        pass
    return shown


def test_progress_is_one_line_that_is_gone_in_the_end(at_terminal, task):
    running, read = at_terminal
    shown = rest_of(read)
    assert running.wait() == 0
    told = [line for line in shown.split("\r\x1b[K") if line]
    assert any(line.endswith(" s  cell") for line in told)
    assert any(line.endswith(" s  verification") for line in told)
    assert shown.rindex("\r\x1b[K") > shown.rindex("replay")
    assert "\x1b" not in running.stdout.read()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_it_at_once_and_leaves_nothing(at_terminal, task, number, code):
    running, read = at_terminal
    shown = read()
    while "cell" not in shown:
        shown += read()
    running.send_signal(number)
    assert running.wait(timeout=1.0) == code
    shown += rest_of(read)
    assert "Traceback" not in shown
    assert shown.endswith("\r\x1b[K")
    assert running.stdout.read() == ""
    assert sorted(file.name for file in task.parent.iterdir()) == ["block.stl", "task.yaml"]


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.2, 0.4, 0.6, 0.8])
def test_ctrl_c_at_any_time_leaves_whole_files_or_none(share, wheel_folder, tmp_path):
    folder = shutil.copytree(wheel_folder.parent, tmp_path / "examples") / "wheel_support"
    before = set(folder.iterdir())
    command = [sys.executable, "-m", "kumitate.tasks.cli", "plan", str(folder / "task.yaml"), "--replay"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        with contextlib.suppress(subprocess.TimeoutExpired):
            running.wait(timeout=share * 10.0)
        running.send_signal(signal.SIGINT)
        status = running.wait(timeout=5.0)
        assert "Traceback" not in running.stderr.read()
    assert status in (0, 130)
    made = set(folder.iterdir()) - before
    plan, page = folder / "task.plan.json", folder / "task.plan.html"
    assert made <= {plan, page}
    if plan in made:
        assert Plan.load(plan).actions
    if page in made:
        assert page.read_text(encoding="utf-8").rstrip().endswith("</html>")
