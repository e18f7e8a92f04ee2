"""Feeds random and spoiled files of all kinds to Kumitate, each in a process of its own.

``python tests/fuzz/run.py`` prints what became of them; ``--count`` for so many of each kind, ``--kind meshes plans``
for some kinds only, ``--seed`` for others, ``--from`` to go on with a later one, ``--again FOLDER`` for one that was
kept.
Inputs that end badly are kept in ``out/fuzz``, with what was said; the exit code is then 1.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from collections import Counter
from functools import partial
from importlib import import_module
from pathlib import Path
from time import perf_counter
from typing import Protocol

import numpy as np
from worker import BAD, SOUND, Outcome, tried


class Kind(Protocol):
    """A kind of input."""

    COUNT: int  # inputs of a long run

    def make(self, rng: np.random.Generator, folder: Path) -> None:
        """Write an input into an empty folder."""

    def feed(self, folder: Path) -> str:
        """Feed it to Kumitate, and tell a key of ``SOUND``."""


KINDS = {
    "meshes": "mesh_files",
    "robots": "robot_files",
    "hands": "hand_files",
    "grasps": "grasp_files",
    "plans": "plan_files",
    "tasks": "task_files",
}
_KEPT = Path("out/fuzz")


def main() -> int:
    sys.dont_write_bytecode = True  # inputs may write in their folders alone
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--count", type=int, help="inputs of each kind; some thousands unless given")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--from", type=int, default=0, dest="first", metavar="NUMBER")
    parser.add_argument("--again", type=Path, metavar="FOLDER")
    given = parser.parse_args()
    if given.again:
        outcome = again(given.again)
        say(f"{outcome.name}: {outcome.words}")
        return 0 if outcome.sound else 1
    say(f"seed {given.seed}")
    table, seconds = {}, {}
    for kind in given.kind:
        started = perf_counter()
        whole = loaded(kind).COUNT  # loads it here, so that no input has to
        numbers = range(given.first, given.first + (whole if given.count is None else given.count))
        table[kind] = count(kind, given.seed, numbers)
        seconds[kind] = perf_counter() - started
    show(table, seconds)
    return 1 if any(row[name] for row in table.values() for name in BAD) else 0


def loaded(kind: str) -> Kind:
    """The module of a kind; some make plans when they are loaded."""
    module: Kind = import_module(KINDS[kind])  # type: ignore[assignment]
    return module


def count(kind: str, seed: int, numbers: range) -> Counter[str]:
    """How often each outcome came, of inputs of a kind; bad ones are kept and told."""
    outcomes: Counter[str] = Counter()
    for number in numbers:
        with tempfile.TemporaryDirectory(prefix="fuzz") as name:
            folder = Path(name)
            outcome = tried(partial(made_and_fed, kind, seed, number, folder), folder)
            outcomes[outcome.name] += 1
            if not outcome.sound:
                kept = _KEPT / f"{kind}-{seed}-{number}"
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(folder, kept, symlinks=True)
                (kept / "kind.txt").write_text(kind)
                (kept / "outcome.txt").write_text(f"{outcome.name}: {outcome.words}\n")
                say(f"{kept}: {outcome.name}: {outcome.words.strip().splitlines()[-1]}")
    return outcomes


def made_and_fed(kind: str, seed: int, number: int, folder: Path) -> str:
    """Make an input, which depends on kind, seed and number alone, and feed it."""
    loaded(kind).make(np.random.default_rng([seed, list(KINDS).index(kind), number]), folder)
    return loaded(kind).feed(folder)


def again(kept: Path) -> Outcome:
    """What becomes of an input that was kept."""
    kind = loaded((kept / "kind.txt").read_text())
    with tempfile.TemporaryDirectory(prefix="fuzz") as name:
        folder = shutil.copytree(kept, Path(name) / "input", symlinks=True)
        return tried(lambda: kind.feed(folder), folder)


def show(table: dict[str, Counter[str]], seconds: dict[str, float]) -> None:
    """Print how often each kind of input came to each outcome."""
    names = [name for name in (*SOUND, *BAD) if name in SOUND or any(row[name] for row in table.values())]
    say("| kind | inputs | " + " | ".join(names) + " | s |")
    say("|---" * (len(names) + 3) + "|")
    for kind, row in table.items():
        say(f"| {kind} | {row.total()} | " + " | ".join(str(row[name]) for name in names) + f" | {seconds[kind]:.0f} |")


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
