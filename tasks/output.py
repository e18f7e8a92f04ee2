"""What every command does with its answer: lines on the terminal, JSON, files, or one line on what went wrong."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

from ..errors import InputError, KumitateError
from .supervised import CLEAR, tell, unfinished

_CURE = "name a folder that exists and is yours"
_MORE_ROOM = "make room there, or name a folder that has some"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def say(line: str) -> None:
    """Print a line of the answer; characters that the terminal does not have are written as escapes."""
    encoding = sys.stdout.encoding or "utf-8"
    sys.stdout.write(line.encode(encoding, "backslashreplace").decode(encoding) + "\n")


def say_json(answer: Any) -> None:
    """Print an answer for programs; numbers that are not finite become null."""
    import msgspec

    say(msgspec.json.format(msgspec.json.encode(_text(msgspec.to_builtins(answer)))).decode())


def _text(answer: Any) -> Any:
    """``answer`` with names that are no text, such as those of files that are no UTF-8, written with escapes."""
    if isinstance(answer, str):
        return answer.encode(errors="backslashreplace").decode()
    if isinstance(answer, dict):
        return {_text(key): _text(value) for key, value in answer.items()}
    return [_text(entry) for entry in answer] if isinstance(answer, list | tuple) else answer


def say_error(error: KumitateError, *, as_json: bool) -> None:
    """Print what went wrong, and what was tried, to the terminal; for programs with the other answers too."""
    report = [str(line) for line in getattr(error, "report", ())]
    sys.stderr.write("".join([f"kumitate: {error}\n", *(f"  {line}\n" for line in report)]))
    if as_json:
        say_json({"error": {"kind": type(error).__name__, "message": str(error), "report": report}})


@contextlib.contextmanager
def progress_line() -> Iterator[Callable[[str], None]]:
    """What shows what is being done on one line of the terminal, which is gone in the end; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield tell
        return
    started = perf_counter()

    def show(doing: str) -> None:
        tell(doing)
        width = os.get_terminal_size(sys.stderr.fileno()).columns or 80
        sys.stderr.write(CLEAR + f"{perf_counter() - started:4.0f} s  {doing}"[: width - 1])
        sys.stderr.flush()

    try:
        yield show
    finally:
        sys.stderr.write(CLEAR)


def check_writable(path: Path) -> None:
    """Check, before the work whose answer it shall hold, that a file can be written.

    Raises:
        InputError: It is a folder, or its folder is none, or not the user's.
    """
    folder = path.resolve().parent
    if path.is_dir() or not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(path, "cannot be written", _CURE)


def write_file(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file; whoever reads it finds the whole of it, or what was there before.

    Raises:
        InputError: The file cannot be written.
    """
    try:
        if path.exists() and not path.is_file():  # a device or a pipe, which nothing may take the place of
            write(path)
            return
        path = path.resolve()
        beside = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
        with unfinished(beside):
            write(beside)
            beside.replace(path)
    except OSError as error:
        cure = _MORE_ROOM if error.errno in _FULL else _CURE
        raise InputError(path, f"cannot be written ({error.strerror or error})", cure) from error
