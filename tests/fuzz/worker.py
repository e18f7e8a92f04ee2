"""One input in a process of its own, which crashes, hangs, eats memory or writes where it may not without harm."""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import resource
import select
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from kumitate.errors import InputError, PlanningError

SOUND = {
    "works": "It was read, and what was made of it keeps its promises.",
    "faults": "A plan was read, and its verification found faults.",
    "refused": "InputError: it was told what is wrong.",
    "no plan": "PlanningError.",
}
BAD = {
    "raised": "Any other exception.",
    "crashed": "The process was ended by a signal.",
    "hung": "It took longer than it may.",
    "memory": "It took, or asked for, more memory than it may.",
    "stray": "It wrote outside its folder, started a process or opened a connection.",
    "missed": "A plan passed its verification, although it was changed in what matters.",
}
SECONDS = 10  # processor time of one input
_WALL = 6 * SECONDS  # for inputs that wait, on a machine that is busy
_MEMORY = 2 * 2**30  # bytes that may be touched
_ADDRESSES = 3 * 2**30  # bytes that may be asked for, beyond what is there already
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_PATHS = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.symlink", "os.link", "os.truncate", "os.chmod")
_TWO_PATHS = ("os.rename", "os.link", "os.symlink")
_STRANGERS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.connect", "socket.bind")


class Outcome(NamedTuple):
    """What became of an input: a key of ``SOUND`` or ``BAD``, and words on it."""

    name: str
    words: str

    @property
    def sound(self) -> bool:
        return self.name in SOUND


class MissedError(Exception):
    """A changed plan passed its verification."""


def tried(feed: Callable[[], str], folder: Path) -> Outcome:
    """What becomes of ``feed``, which answers with a key of ``SOUND`` and may write in ``folder`` alone."""
    told, tell = os.pipe()
    child = os.fork()
    if not child:
        os.close(told)
        _work(feed, folder.resolve(), tell)
    os.close(tell)
    try:
        finished, _, _ = select.select([told], [], [], _WALL)
        if not finished:
            os.kill(child, signal.SIGKILL)
        answer = b"".join(iter(lambda: os.read(told, 65536), b""))
    finally:
        os.close(told)
        _, status, used = os.wait4(child, 0)
    if not finished or (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU):
        return Outcome("hung", f"after {used.ru_utime + used.ru_stime:.0f} s of processor time{_said(folder)}")
    if used.ru_maxrss * 1024 > _MEMORY:
        return Outcome("memory", f"{used.ru_maxrss / 2**20:.1f} GiB")
    if os.WIFSIGNALED(status) or not answer:
        return Outcome("crashed", f"{signal.strsignal(os.WTERMSIG(status))}{_said(folder)}")
    outcome, imported = json.loads(answer)
    for module in imported:
        with contextlib.suppress(Exception):
            importlib.import_module(module)  # so that the next process has it already
    return Outcome(*outcome)


def _said(folder: Path) -> str:
    """Where the process was when it was ended, if it told."""
    told = (folder / "said.txt").read_text(errors="replace")
    return told[told.rfind("(most recent call first)") :][:2000] if "(most recent call first)" in told else ""


def _work(feed: Callable[[], str], folder: Path, tell: int) -> None:
    """The child's life: what is said goes into a file of the folder, the outcome to the parent."""
    said = os.open(folder / "said.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    faulthandler.enable(2)
    faulthandler.register(signal.SIGXCPU, 2, all_threads=False, chain=True)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    addresses = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() + _ADDRESSES
    resource.setrlimit(resource.RLIMIT_AS, (addresses, addresses))
    before, stray = set(sys.modules), list[str]()
    sys.addaudithook(_watch(folder, stray))
    try:
        outcome = _fed(feed)
    except BaseException:
        outcome = Outcome("raised", traceback.format_exc(limit=-8))
    if stray:
        outcome = Outcome("stray", "; ".join(stray))
    os.write(tell, json.dumps([outcome, sorted(sys.modules.keys() - before)]).encode())
    os._exit(0)


def _fed(feed: Callable[[], str]) -> Outcome:
    try:
        return Outcome(feed(), "")
    except (InputError, PlanningError) as error:
        if _for_want_of_memory(error):
            return Outcome("memory", traceback.format_exc(limit=-8))
        return Outcome("refused" if isinstance(error, InputError) else "no plan", str(error))
    except MissedError as error:
        return Outcome("missed", str(error))
    except MemoryError:
        return Outcome("memory", traceback.format_exc(limit=-8))


def _for_want_of_memory(error: BaseException | None) -> bool:
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None


def _watch(folder: Path, stray: list[str]) -> Callable[[str, tuple[Any, ...]], None]:
    """An audit hook that notes what is done outside ``folder``."""

    def inside(path: object) -> bool:
        if isinstance(path, int) or path is None:
            return True
        where = Path(os.path.realpath(os.fsdecode(path)))  # type: ignore[arg-type]
        return where.is_relative_to(folder) or where == Path(os.devnull)

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            wrong = bool((arguments[2] or 0) & _WRITING) and not inside(arguments[0])
        elif event in _PATHS:
            paths = arguments[event == "os.symlink" : 1 + (event in _TWO_PATHS)]
            wrong = not all(inside(path) or (event == "os.mkdir" and Path(path).is_dir()) for path in paths)
        else:
            wrong = event in _STRANGERS
        if wrong:
            stray.append(f"{event} {arguments[0]!r}"[:200])

    return hook
