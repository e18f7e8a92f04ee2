"""What commands do with their answers: whole files or none, JSON, and progress on a terminal only."""

from __future__ import annotations

import errno
import io
import json
import os
import pty
import resource
import signal
from pathlib import Path

import numpy as np
import pytest

from kumitate.errors import InputError, PlanningError
from kumitate.tasks import output
from kumitate.tasks.output import check_writable, progress_line, say_error, say_json, write_file
from kumitate.tasks.supervised import told


def test_a_file_is_whole(tmp_path):
    write_file(tmp_path / "a.txt", lambda path: path.write_text("new"))
    assert (tmp_path / "a.txt").read_text() == "new"
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_who_is_stopped_leaves_what_was_there(tmp_path, stop):
    file = tmp_path / "a.txt"
    file.write_text("old")

    def half(path):
        path.write_text("ne")
        raise stop

    with pytest.raises(stop):
        write_file(file, half)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_the_writer_sees_the_kind_of_the_file(tmp_path):
    seen = []
    write_file(tmp_path / "grasps.npz", lambda path: seen.append(path.suffix) or np.savez(path, a=1))
    assert seen == [".npz"]
    assert (tmp_path / "grasps.npz").is_file()


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "far" / "real.txt")
    write_file(tmp_path / "link.txt", lambda path: path.write_text("new"))
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "far" / "real.txt").read_text() == "new"


def test_a_device_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_file(pipe, lambda path: path.write_text("new"))
    assert os.read(reading, 10) == b"new"
    os.close(reading)
    assert pipe.is_fifo()


@pytest.mark.parametrize("place", ["none/a.txt", "file/a.txt", "folder"])
def test_where_nothing_can_be_written_is_told(tmp_path, place):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    path = tmp_path / place
    with pytest.raises(InputError, match="cannot be written") as caught:
        write_file(path, lambda beside: beside.write_text("new"))
    assert caught.value.place.endswith(place)
    with pytest.raises(InputError, match="cannot be written"):
        check_writable(path)


@pytest.fixture
def nearly_full():
    """No file can get longer than 1000 bytes: what a full disk is to a writer."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.parametrize(
    "write",
    [
        lambda path: path.write_bytes(bytes(10_000)),
        lambda path: path.write_text("x" * 10_000),
        lambda path: np.savez(path, array=np.zeros(10_000)),
    ],
)
def test_a_full_disk_leaves_what_was_there_and_is_told(tmp_path, nearly_full, write):
    file = tmp_path / "a.npz"
    file.write_text("old")
    with pytest.raises(InputError, match="cannot be written") as caught:
        write_file(file, write)
    assert "make room" in caught.value.cure
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize(
    ("number", "cure"), [(errno.ENOSPC, "make room"), (errno.EDQUOT, "make room"), (errno.EROFS, "yours")]
)
def test_what_the_system_says_is_told(tmp_path, number, cure):
    def refused(path):
        raise OSError(number, os.strerror(number))

    with pytest.raises(InputError, match=os.strerror(number)) as caught:
        write_file(tmp_path / "a.txt", refused)
    assert cure in caught.value.cure


def test_what_can_be_written_is_not_touched_by_the_check(tmp_path):
    check_writable(tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


def test_json_has_null_where_a_number_is_not_finite(capsys):
    say_json({"clearance": np.inf, "seconds": 1.5})
    assert json.loads(capsys.readouterr().out) == {"clearance": None, "seconds": 1.5}


@pytest.mark.parametrize(("encoding", "shown"), [("utf-8", r"\udcff 組"), ("latin-1", r"\udcff \u7d44")])
def test_names_that_are_no_text_are_told_with_escapes(monkeypatch, encoding, shown):
    name, written = os.fsdecode("\udcff 組".encode(errors="surrogateescape")), io.BytesIO()
    monkeypatch.setattr(output.sys, "stdout", io.TextIOWrapper(written, encoding=encoding, write_through=True))
    output.say(name)
    assert written.getvalue().decode(encoding) == shown + "\n"


def test_json_has_names_that_are_no_text_with_escapes(capsys):
    name, shown = os.fsdecode(b"\xff.yaml"), r"\udcff.yaml"
    say_json({name: [name, {"plan": name}], "number": 1})
    assert json.loads(capsys.readouterr().out) == {shown: [shown, {"plan": shown}], "number": 1}


def test_errors_are_told_to_programs_too(capsys):
    error = PlanningError("no way")
    say_error(error, as_json=True)
    captured = capsys.readouterr()
    assert captured.err == "kumitate: no way\n"
    assert json.loads(captured.out) == {"error": {"kind": "PlanningError", "message": "no way", "report": []}}


def test_a_report_is_told_as_sentences_whatever_it_is_made_of(capsys):
    error = PlanningError("no way")
    error.report = iter([Path("one"), "two"])
    say_error(error, as_json=True)
    captured = capsys.readouterr()
    assert captured.err == "kumitate: no way\n  one\n  two\n"
    assert json.loads(captured.out)["error"]["report"] == ["one", "two"]


def test_there_is_no_progress_in_a_pipe(capsys):
    with progress_line() as progress:
        progress("thinking")
    assert capsys.readouterr().err == ""
    assert told() == "thinking"  # by whoever ends it


def test_progress_redraws_one_line_of_a_terminal_and_clears_it(monkeypatch):
    master, slave = pty.openpty()
    with os.fdopen(slave, "w", encoding="utf-8") as terminal:
        monkeypatch.setattr(output.sys, "stderr", terminal)
        with progress_line() as progress:
            progress("thinking")
            progress("x" * 500)
        terminal.flush()
        shown = ""
        while shown.count("\r\x1b[K") < 3:  # it may come in pieces
            shown += os.read(master, 10_000).decode()
    os.close(master)
    lines = shown.split("\r\x1b[K")
    assert lines[0] == ""
    assert lines[1].endswith(" s  thinking")
    assert len(lines[2]) < 200  # cut to the terminal's width
    assert lines[-1] == ""
    assert "\n" not in shown
    assert told() == "x" * 500


def test_say_prints_lines(monkeypatch):
    written = io.StringIO()
    monkeypatch.setattr(output.sys, "stdout", written)
    output.say("one")
    output.say("two")
    assert written.getvalue() == "one\ntwo\n"
