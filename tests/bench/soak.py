"""Many different random tasks planned one after the other in one process: does memory grow, do files stay open?

``python tests/bench/soak.py`` prints Markdown; with ``--tasks 20`` only so many, with ``--from 1000`` others.
"""

from __future__ import annotations

import argparse
import gc
import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from kumitate.errors import InputError, PlanningError
from kumitate.grasping.part import Part
from kumitate.regrasp.placements import find_placements
from kumitate.tasks.cell import build_cell
from kumitate.tasks.planner import UnverifiedError, plan
from kumitate.tasks.task import Area, At, Attach, Goal, HandOver, Insert, Obstacle, PartEntry, Place, Task
from kumitate.transforms import pose, rpy_from_rotation

PARTS = Path(__file__).resolve().parents[2] / "examples" / "parts"
LIMIT = 120.0  # s
WARM = 10  # tasks after which the memory of the start is read: libraries and models are loaded by then
TABLES = {  # sides, middle, and the x and |y| in which parts start and end
    "nextage": ((0.3, 1.32, 0.02), (0.4, 0.0, -0.06), (0.30, 0.45), (0.12, 0.40)),
    "ur3_dual": ((0.8, 1.83, 0.024), (0.45, 0.0, 1.082), (0.22, 0.38), (0.15, 0.50)),
}
MASSES = {"block": 0.1, "ring": 0.04, "peg": 0.03, "bar": 0.08, "wheel": 0.05, "support": 0.06}


class Draw:
    """Draws what stands on one robot's table."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.robot = str(rng.choice(list(TABLES)))
        sides, middle, self._x, self._y = TABLES[self.robot]
        self.table = Obstacle("table", At(middle), box=sides, support=True)
        self.top = middle[2] + sides[2] / 2.0

    def at(self, part: str, side: int | None = None) -> At:
        """A stable pose on the table, on one side if told."""
        made = Part.load(PARTS / f"{part}.stl", unit="mm", mass=MASSES[part])
        placements = find_placements(made).surface_from_part
        which = placements[self.rng.integers(len(placements))]
        side = side or int(self.rng.choice([-1, 1]))
        x, y = self.rng.uniform(*self._x), side * self.rng.uniform(*self._y)
        there = pose((x, y, self.top), (0.0, 0.0, self.rng.uniform(-np.pi, np.pi))) @ which
        return At(tuple(there[:3, 3].tolist()), rpy_from_rotation(there[:3, :3]))

    def entry(self, part: str, side: int | None = None) -> PartEntry:
        """A part, standing somewhere."""
        return PartEntry(f"{part}.stl", "mm", self.at(part, side), mass=MASSES[part])

    def task(self, parts: dict[str, PartEntry], goals: Sequence[Goal], **more: object) -> Task:
        """The task."""
        hands = dict.fromkeys(("left", "right"), "robotiq_2f85")
        return Task(self.robot, hands, parts, tuple(goals), cell=(self.table,), **more)


def placing(draw: Draw) -> Task:
    part = str(draw.rng.choice(["block", "ring", "bar"]))
    return draw.task({part: draw.entry(part)}, [Goal(place=Place(part, draw.at(part)))])


def area(draw: Draw) -> Task:
    part = str(draw.rng.choice(["block", "bar"]))
    return draw.task({part: draw.entry(part)}, [Goal(place=Place(part, area=Area("table", up=(0.0, 0.0, 1.0))))])


def two(draw: Draw) -> Task:
    parts = {"block": draw.entry("block"), "ring": draw.entry("ring")}
    goals = [Goal(place=Place(part, draw.at(part))) for part in parts]
    return draw.task(parts, goals, order="free")


def handing(draw: Draw) -> Task:
    side = int(draw.rng.choice([-1, 1]))
    up = 0.3 + draw.top
    end = At((0.35, -0.15 * side, up), (0.0, 0.0, float(draw.rng.uniform(-np.pi, np.pi))))
    to = "left" if side < 0 else "right"
    return draw.task({"block": draw.entry("block", side)}, [Goal(hand_over=HandOver("block", to, end))])


def wheel(draw: Draw) -> Task:
    parts = {"support": draw.entry("support", -1), "wheel": draw.entry("wheel", 1)}
    insert = Insert((0.0, -1.0, 0.0), 0.07)
    return draw.task(parts, [Goal(attach=Attach("wheel", "support", At((0.0, 0.032, 0.010)), insert))])


KINDS: dict[str, Callable[[Draw], Task]] = {
    "place": placing,
    "area": area,
    "two, free order": two,
    "hand over": handing,
    "wheel": wheel,
}


def drawn(number: int) -> tuple[str, Task]:
    """The task of a number, of which the start is sound."""
    rng = np.random.default_rng([20_000, number])
    kind = str(rng.choice(list(KINDS)))
    while True:
        task = KINDS[kind](Draw(rng))
        try:
            build_cell(task, PARTS)
        except InputError:  # parts that stand in each other
            continue
        return kind, task


def memory() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def files() -> int:
    """Open files of this process."""
    return len(list(Path("/proc/self/fd").iterdir()))


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="Many random tasks in one process.")
    parser.add_argument("--tasks", type=int, default=200)
    parser.add_argument("--from", type=int, default=0, dest="first")
    options = parser.parse_args(arguments)
    solved, tried, reasons = Counter[str](), Counter[str](), []
    seconds: dict[str, list[float]] = {kind: [] for kind in KINDS}
    start = (0.0, 0)
    most = 0.0
    for number in range(options.first, options.first + options.tasks):
        if number - options.first == WARM:
            gc.collect()
            start = memory(), files()
        kind, task = drawn(number)
        tried[kind] += 1
        before = time.perf_counter()
        try:
            plan(task, PARTS, seed=number, time_limit=LIMIT)
            solved[kind] += 1
            seconds[kind].append(time.perf_counter() - before)
        except UnverifiedError as error:
            reasons.append(f"{number} ({kind}): NOT VERIFIED: {error}")
        except (InputError, PlanningError) as error:
            reasons.append(f"{number} ({kind}): {error}")
        most = max(most, memory())
        print(f"{number} {kind}: {time.perf_counter() - before:.1f} s, {memory():.0f} MB, {files()} files", flush=True)
    gc.collect()
    print("\n| task | solved | median s | 90% | largest |\n|---|---|---|---|---|")
    for kind, times in seconds.items():
        if times:
            row = f"{np.median(times):.1f} | {np.percentile(times, 90):.1f} | {max(times):.1f}"
            print(f"| {kind} | {solved[kind]} of {tried[kind]} | {row} |")
    print(f"\n{solved.total()} of {tried.total()} solved and verified")
    print(f"memory {start[0]:.0f} MB after {WARM} tasks, {memory():.0f} MB at the end, {most:.0f} MB at most")
    print(f"open files {start[1]} after {WARM} tasks, {files()} at the end")
    for reason in reasons:
        print(f"- {reason}")


if __name__ == "__main__":
    main()
