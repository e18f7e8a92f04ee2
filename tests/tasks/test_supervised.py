"""Work that is watched: whatever it is at, a time limit or a signal ends it, and nothing is left."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from time import perf_counter

import pytest

from kumitate.errors import TimeLimitError
from kumitate.tasks import supervised as module
from kumitate.tasks.supervised import CrashError, supervised, tell, told, unfinished

IN_C = "sum(range(10**12))"  # answers no signal, and has the lock of the interpreter for hours
PRELUDE = """\
import os, signal, sys, time
from pathlib import Path
from kumitate.errors import KumitateError
from kumitate.errors import TimeLimitError
from kumitate.tasks.supervised import supervised, tell, unfinished, unsupervised

def ready():
    print("ready", flush=True)

def say(error):
    print(type(error).__name__, error, flush=True)
    return 1

def watched(work, *limit):
    try:
        return supervised(work, *limit)
    except KumitateError as error:
        return say(error)
"""


@pytest.fixture
def start():
    """Start a script in a session of its own; what it started is over in the end."""
    started = []

    def run(script, *arguments, **options):
        command = [sys.executable, "-c", PRELUDE + script, *map(str, arguments)]
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
        started.append(subprocess.Popen(command, start_new_session=True, **options))
        return started[-1]

    yield run
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def script(work, ending="sys.exit(watched(work))"):
    """A script whose work is ``work``."""
    return "def work():\n" + "".join(f"    {line}\n" for line in work.splitlines()) + ending + "\n"


# Work that ends by itself ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", [0, 1, 2, 77])
def test_the_exit_code_is_that_of_the_work(start, code):
    process = start(script(f"return {code}"))
    assert process.communicate() == ("", "")
    assert process.returncode == code


def test_it_is_also_known_where_the_end_of_children_is_ignored(start):
    process = start("signal.signal(signal.SIGCHLD, signal.SIG_IGN)\n" + script("return 7"))
    assert process.communicate() == ("", "")
    assert process.returncode == 7


def test_it_is_done_in_a_child_and_said_once(start):
    process = start("print('before', os.getpid())\n" + script("print('work', os.getpid())\nreturn 0"))
    lines = process.communicate()[0].split()
    assert lines[::2] == ["before", "work"]
    assert int(lines[1]) == process.pid
    assert int(lines[3]) != process.pid


def test_an_error_in_the_work_is_shown_and_exit_1(start):
    process = start(script("raise ZeroDivisionError('here')"))
    assert process.communicate()[1].endswith("ZeroDivisionError: here\n")
    assert process.returncode == 1


def test_signals_mean_afterwards_what_they_meant_before(start):
    ending = (
        "before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]\n"
        "code = watched(work)\n"
        "sys.exit(before != [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)])"
    )
    process = start(script("return 0", ending))
    assert process.communicate() == ("", "")
    assert process.returncode == 0


def test_without_fork_it_is_done_here(monkeypatch):
    monkeypatch.delattr(os, "fork")
    assert supervised(os.getpid) == os.getpid()


# Time -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("hang", [IN_C, "time.sleep(60)", "while True:\n    pass"])
def test_the_limit_holds_whatever_the_work_is_at(start, hang):
    ending = "began = time.monotonic(); watched(work, 0.2); print(time.monotonic() - began)"
    process = start(script(f"tell('thinking')\n{hang}", ending))
    words, seconds = process.communicate()[0].splitlines()
    assert words == f"TimeLimitError {TimeLimitError(0.2, 'thinking')}"
    assert 0.2 <= float(seconds) <= 1.2


def test_work_that_looks_at_the_clock_ends_by_itself(start):
    process = start(script("time.sleep(0.2)\nreturn 7", "sys.exit(watched(work, 0.1))"))
    assert process.communicate() == ("", "")
    assert process.returncode == 7


# Signals --------------------------------------------------------------------------------------------------------------


def over_within_a_second(process):
    """Whether all processes that write to its output are over, and what they still said."""
    before = perf_counter()
    said = process.stdout.read()
    process.wait()
    assert perf_counter() - before < 1.0
    return said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("send", [os.kill, os.killpg], ids=["to it", "to its group, as terminals do"])
@pytest.mark.parametrize("hang", [IN_C, "time.sleep(60)"])
def test_a_signal_ends_it_whatever_the_work_is_at(start, number, send, hang):
    process = start(script(f"ready()\n{hang}"))
    assert process.stdout.readline() == "ready\n"
    for _ in range(2):  # the impatient send it twice
        send(process.pid, number)
    assert over_within_a_second(process) == ""
    assert process.returncode == 128 + number
    assert process.stderr.read() == ""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells children that their parent died")
def test_the_work_does_not_outlive_who_watches_it(start):
    process = start(script(f"ready()\n{IN_C}"))
    process.stdout.readline()
    process.kill()
    over_within_a_second(process)


@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL])
def test_a_crash_is_told(start, number):
    process = start(script(f"tell('thinking')\nos.kill(os.getpid(), {number:d})"))
    said = process.communicate()[0]
    assert said == f"CrashError {CrashError(number, 'thinking')}\n"
    assert f"ended by {number.name} while at: thinking" in said
    assert ("memory" in said) == (number == signal.SIGKILL)


def test_a_child_that_is_asked_to_end_is_no_crash(start):
    process = start(script("os.kill(os.getpid(), signal.SIGTERM)"))
    assert process.communicate() == ("", "")
    assert process.returncode == 143


def test_a_terminal_has_nothing_left_on_its_line(start):
    master, slave = pty.openpty()
    process = start(script(f"sys.stderr.write('  1 s  thinking')\nready()\n{IN_C}"), stderr=slave)
    os.close(slave)
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    over_within_a_second(process)
    assert os.read(master, 1000).decode().endswith("thinking\r\x1b[K")
    os.close(master)


# Files ----------------------------------------------------------------------------------------------------------------

WRITING = "with unfinished(Path(sys.argv[1])):\n    Path(sys.argv[1]).write_text('half')\n    ready()\n    "


@pytest.mark.parametrize("name", ["half.json", "ha\nlf wheel 組み立て.json", "x" * 250])
@pytest.mark.parametrize("call", ["watched(work)", "unsupervised(work)"])
def test_a_signal_leaves_no_file(start, tmp_path, call, name):
    file = tmp_path / name
    process = start(script(WRITING + "time.sleep(60)", f"sys.exit({call})"), file)
    process.stdout.readline()
    assert file.exists()
    process.terminate()
    over_within_a_second(process)
    assert process.returncode == 143
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("end", [IN_C, "os.abort()"])
def test_neither_the_limit_nor_a_crash_leaves_a_file(start, tmp_path, end):
    process = start(script(WRITING + end, "sys.exit(watched(work, 0.2))"), tmp_path / "half.json")
    assert "Error" in process.communicate()[0]
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_was_finished_stays(start, tmp_path):
    finish = "    Path(sys.argv[1]).rename(sys.argv[2])\nos.abort()"
    process = start(script(WRITING.rstrip(" ") + finish), tmp_path / "half.json", tmp_path / "whole.json")
    assert "CrashError" in process.communicate()[0]
    assert [file.name for file in tmp_path.iterdir()] == ["whole.json"]


def test_an_error_leaves_no_file(tmp_path):
    def fail(file):
        file.write_text("half")
        raise ValueError(file)

    with pytest.raises(ValueError, match="half"), unfinished(tmp_path / "half.json"):
        fail(tmp_path / "half.json")
    assert list(tmp_path.iterdir()) == []


# Notes ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("words", ["thinking", "", "組み立て", "grasps of \udcff", "x" * 100_000])
def test_what_is_told_is_known(words):
    tell("something longer than what comes then")
    tell(words)
    expected = words.encode(errors="replace").decode()[:8192] or "the start"
    assert told() == expected
    tell("")


def test_a_note_is_whole_or_empty_at_every_step():
    """Whoever is killed between two changes of the memory leaves the old text, the new one, or none."""
    note = module._Note()
    memory, seen = note._memory, []

    class Watched:
        def __getitem__(self, place):
            return memory[place]

        def __setitem__(self, place, content):
            memory[place] = content
            seen.append(note.read())

    note._memory = Watched()
    for text in (b"/tmp/one", b"/tmp/two.json", b"/a"):
        note.write(text)
    assert set(seen) == {b"", b"/tmp/one", b"/tmp/two.json", b"/a"}
