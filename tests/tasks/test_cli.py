"""The command line as a whole: its commands, that help is quick, and how it ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from kumitate.errors import InputError, NoRegraspError
from kumitate.tasks import cli, schema_command
from kumitate.tasks.cli import main

COMMANDS = ["plan", "verify", "replay", "export", "grasps", "placements", "robots", "schema"]
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


def test_an_interrupt_that_a_library_swallows_ends_it_all_the_same():
    code = (
        "import os, signal\n"
        "from kumitate.tasks import cli, schema_command\n"
        "def library(options):\n"
        "    try:\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "    except BaseException:\n"
        "        pass\n"
        "    return 0\n"
        "schema_command._schema = library\n"
        "raise SystemExit(cli.main(['schema']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr == ""


def test_a_reader_that_has_enough_is_no_error():
    code = "from kumitate.tasks.cli import main; raise SystemExit(main(['schema', 'plan']))"
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, "-c", code], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 0
    assert done.stderr == ""


def test_the_package_names_it_as_its_command():
    from importlib.metadata import entry_points

    (entry,) = [entry for entry in entry_points(group="console_scripts") if entry.name == "kumitate"]
    assert entry.load() is cli.main
