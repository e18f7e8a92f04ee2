"""The command line as a whole: its commands, that help is quick, and how it ends."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys

import pytest

from kumitate.errors import InputError, NoRegraspError
from kumitate.tasks import cli, schema_command
from kumitate.tasks.cli import main

COMMANDS = ["plan", "explain", "verify", "replay", "export", "grasps", "placements", "robots", "schema"]
HEAVY = ["numpy", "scipy", "trimesh", "pinocchio", "coal", "fcl", "ompl", "toppra", "networkx", "meshcat", "msgspec"]


def answering(monkeypatch, run):
    """Let ``kumitate schema`` do something else."""
    monkeypatch.setattr(schema_command, "_schema", run)


def test_help_lists_the_commands(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    printed = capsys.readouterr().out
    for command in COMMANDS:
        assert f"\n    {command} " in printed or f"\n    {command}\n" in printed


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_loads_nothing_heavy(command):
    arguments = [*([command] if command else []), "--help"]
    code = (
        "import sys\n"
        "from kumitate.tasks.cli import main\n"
        "try:\n"
        f"    main({arguments})\n"
        "finally:\n"
        f"    sys.stderr.write(repr([name for name in {HEAVY} if name in sys.modules]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "[]"
    assert done.stdout.startswith("usage: ")


@pytest.mark.parametrize("arguments", [[], ["dance"], ["schema", "--tango"]])
def test_an_unknown_command_or_option_is_exit_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "usage: kumitate" in capsys.readouterr().err


def test_a_wrong_input_is_one_line_and_exit_2(monkeypatch, capsys):
    def wrong(options):
        raise InputError("task.yaml:3: robot", "there is none", "name one")

    answering(monkeypatch, wrong)
    assert main(["schema"]) == 2
    assert capsys.readouterr().err == "kumitate: task.yaml:3: robot: there is none; name one\n"


def test_no_answer_is_exit_1_with_what_was_tried(monkeypatch, capsys):
    def tried(options):
        raise NoRegraspError("wheel", "the table is in the way", ["left arm: 0 of 9", "right arm: 0 of 7"])

    answering(monkeypatch, tried)
    assert main(["schema"]) == 1
    captured = capsys.readouterr()
    assert captured.err.splitlines() == [
        "kumitate: no way for wheel: the table is in the way",
        "  left arm: 0 of 9",
        "  right arm: 0 of 7",
    ]
    assert captured.out == ""


def test_an_interrupt_is_exit_130_and_leaves_the_handler_as_it_was(monkeypatch, capsys):
    def interrupted(options):
        raise KeyboardInterrupt

    answering(monkeypatch, interrupted)
    before = signal.getsignal(signal.SIGINT)
    assert main(["schema"]) == 130
    assert signal.getsignal(signal.SIGINT) is before
    assert capsys.readouterr().err == ""


def schema_that(work, *call):
    """The command line of a program whose ``kumitate schema`` does something else."""
    code = (
        "import os, signal, sys, time\n"
        "from kumitate.tasks import cli, schema_command\n"
        "def work(options):\n" + "".join(f"    {line}\n" for line in work.splitlines()) + "    return 0\n"
        f"schema_command._schema, sys.argv[1:] = work, ['schema']\n"
        f"sys.exit(cli.main({', '.join(call)}))\n"
    )
    return [sys.executable, "-c", code]


@pytest.mark.parametrize("call", [(), ("['schema']",)], ids=["program", "function"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_that_a_library_swallows_ends_it_all_the_same(call, number, code):
    work = f"try:\n    signal.raise_signal({number:d})\nexcept BaseException:\n    pass"
    done = subprocess.run(schema_that(work, *call), capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert done.stderr == done.stdout == ""


def test_a_library_that_has_no_ear_for_signals_is_ended():
    work = "print('ready', flush=True)\nsum(range(10**12))"
    with subprocess.Popen(schema_that(work), stdout=subprocess.PIPE, text=True) as running:
        running.stdout.readline()
        running.send_signal(signal.SIGINT)
        assert running.wait(timeout=1.0) == 130
        assert running.stdout.read() == ""  # and nobody is left who could write


def test_a_library_that_crashes_is_told():
    done = subprocess.run(schema_that("os.abort()"), capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "kumitate: ended by SIGABRT while at: the start\n"


def test_called_by_other_code_it_forks_nothing(monkeypatch, capsys):
    answering(monkeypatch, lambda options: print(os.getpid()) or 0)  # noqa: T201
    assert main(["schema"]) == 0
    assert int(capsys.readouterr().out) == os.getpid()


def test_a_reader_that_has_enough_is_no_error():
    code = "from kumitate.tasks.cli import main; raise SystemExit(main(['schema', 'plan']))"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-c", code], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 0
    assert done.stderr == ""


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")  # noqa: PTH110
@pytest.mark.parametrize("what", ["print('x')", "for _ in range(10_000):\n    print('x' * 100)"])
def test_an_answer_that_finds_no_room_is_told(what):
    with open("/dev/full", "w") as full:  # noqa: PTH123
        done = subprocess.run(schema_that(what), stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert re.fullmatch(r"kumitate: the answer cannot be written \(.*No space left on device\)\n", done.stderr)


def test_the_package_names_it_as_its_command():
    from importlib.metadata import entry_points

    (entry,) = [entry for entry in entry_points(group="console_scripts") if entry.name == "kumitate"]
    assert entry.load() is cli.main
