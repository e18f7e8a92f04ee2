"""A command's work in a process of its own, so that time limits and signals hold whatever it is at.

Deep in a library nothing looks at the clock or answers a signal. So a child does the work, and its parent, which has
loaded nothing heavy, ends it when the time is over or a signal asks for it. They share a little memory in which the
child tells what it does and which file it has begun: the parent names the one and removes the other.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic, sleep
from types import FrameType
from typing import NoReturn

from ..errors import KumitateError, TimeLimitError

CLEAR = "\r\x1b[K"  # back to the start of the terminal's line, and nothing on it
GRACE = 0.5  # s in which work that looks at the clock itself may end by itself
_STEP = 0.02  # s between two looks at the child
_ENDING = (signal.SIGINT, signal.SIGTERM)
_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG


class CrashError(KumitateError):
    """The work was ended from outside, or by a fault in a library.

    Attributes:
        number: The signal that ended it.
        doing: What was being done.
    """

    def __init__(self, number: int, doing: str) -> None:
        """Name the signal."""
        self.number, self.doing = signal.Signals(number), doing
        cause = "; memory may have run out" if self.number == signal.SIGKILL else ""
        super().__init__(f"ended by {self.number.name} while at: {doing}{cause}")


class _Note:
    """A short text in memory that a process shares with its children; whole, or empty."""

    _LENGTH, _MOST = 4, 8192  # bytes

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, self._LENGTH + self._MOST)

    def write(self, text: bytes) -> None:
        text = text[: self._MOST]
        for place, content in ((0, bytes(self._LENGTH)), (self._LENGTH, text), (0, len(text).to_bytes(self._LENGTH))):
            self._memory[place : place + len(content)] = content  # the length last: a killed writer leaves it zero

    def read(self) -> bytes:
        end = self._LENGTH + int.from_bytes(self._memory[: self._LENGTH])
        return self._memory[self._LENGTH : end]


_DOING, _UNFINISHED = _Note(), _Note()


def tell(doing: str) -> None:
    """Note what is being done, for whoever ends it."""
    _DOING.write(doing.encode(errors="replace"))


def told() -> str:
    """What is being done, or was when it was ended."""
    return _DOING.read().decode(errors="replace") or "the start"


@contextlib.contextmanager
def unfinished(file: Path) -> Iterator[None]:
    """What is at ``file`` (absolute) is removed in the end, also if the process is ended meanwhile."""
    _UNFINISHED.write(os.fsencode(file))
    try:
        yield
    finally:
        file.unlink(missing_ok=True)
        _UNFINISHED.write(b"")


def supervised(work: Callable[[], int], limit: float = math.inf) -> int:
    """Do some work in a child process, and end that when its time is over or a signal asks for it.

    Where there is no fork the work is done as by `unsupervised`.

    Args:
        work: What to do; it answers with an exit code.
        limit: Time for it from now on [s]; ``GRACE`` later it is ended.

    Returns:
        The exit code of the work; 128 and the number of the signal (SIGINT, SIGTERM) that ended it.

    Raises:
        TimeLimitError: The time was over.
        CrashError: The child died.
    """
    if not hasattr(os, "fork"):
        return unsupervised(work)
    end, asked = monotonic() + limit + GRACE, list[int]()
    late = False
    tell("")
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)  # who ignores it, as some that start programs do, learns no exit code
    with _signals(lambda number, frame: asked.append(number)):
        parent, child = os.getpid(), os.fork()
        if child == 0:
            _be_child(work, parent)
        while not (ended := os.waitpid(child, os.WNOHANG))[0]:
            late = monotonic() > end
            if asked or late:
                os.kill(child, signal.SIGKILL)
                ended = os.waitpid(child, 0)
                break
            sleep(_STEP)
        code = os.waitstatus_to_exitcode(ended[1])
        if code < 0:
            _leave_nothing()
    if code >= 0:
        return code
    if asked or -code in _ENDING:
        return 128 + (asked[0] if asked else -code)
    raise TimeLimitError(limit, told()) if late else CrashError(-code, told())


def unsupervised(work: Callable[[], int]) -> int:
    """Do some work here. Signals end this process at once, as soon as Python itself sees them; no time limit does."""

    def end(number: int, frame: FrameType | None) -> None:  # an exception could get lost, most likely in libraries
        _leave_nothing()
        os._exit(128 + number)

    with _signals(end):
        return work()


@contextlib.contextmanager
def _signals(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    """Meanwhile ``handler`` gets the signals that ask to end."""
    before = [(number, signal.signal(number, handler)) for number in _ENDING]
    try:
        yield
    finally:
        for number, earlier in before:
            signal.signal(number, earlier)


def _be_child(work: Callable[[], int], parent: int) -> NoReturn:
    status = 1
    try:
        for number in _ENDING:
            signal.signal(number, signal.SIG_DFL)
        if sys.platform == "linux":
            import ctypes

            ctypes.CDLL(None).prctl(_DEATH_OF_PARENT, signal.SIGKILL)
        if os.getppid() == parent:  # else it died before
            status = work()
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(status)


def _leave_nothing() -> None:
    """Remove the file that is not finished, and what is on the terminal's line."""
    with contextlib.suppress(OSError):
        if file := os.fsdecode(_UNFINISHED.read()):
            Path(file).unlink(missing_ok=True)
            _UNFINISHED.write(b"")
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), CLEAR.encode())
