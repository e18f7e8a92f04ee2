# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""Regrasps in figures: ``python tests/bench/bench_regrasp.py [--problems N] [--only random growth flip]``.

Prints Markdown tables, processor seconds of one thread. Every answer is looked at again by the reference: python-fcl on
full meshes, 1 mm of true motion between two looks at free motions and 0.2 mm at straight ones.
"""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import argparse
import itertools
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from tabletops import HANDS, Tabletop, tabletop
from witness import Witness, faults

from kumitate.errors import NoRegraspError
from kumitate.regrasp import reach
from kumitate.regrasp.graph import Goal, RegraspGraph
from kumitate.regrasp.nodes import between
from kumitate.regrasp.placements import find_placements
from kumitate.regrasp.planner import Regrasp, choose, plan_regrasp
from kumitate.regrasp.reach import Node
from kumitate.robots.ik import IKSolver
from kumitate.transforms import Array, pose

GRASPS = 1000
LIMIT = 10.0  # s
SIZES = (50, 100, 200, 500, 1000)
ROUTES = 24  # as many as are followed before a search is given up
SEEDS = 10
RUNS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=50, help="random problems for each part and robot; 50")
    parser.add_argument("--only", nargs="+", choices=("random", "growth", "flip"), default=("random", "growth", "flip"))
    options = parser.parse_args()
    if "random" in options.only:
        random_problems(options.problems)
    if "growth" in options.only:
        growth()
    if "flip" in options.only:
        flip()


# Random problems ------------------------------------------------------------------------------------------------------


def random_problems(count: int) -> None:
    print(f"{count} random problems each, stable start to stable goal, {GRASPS} grasps; of every other one no grasp is")
    print("shared by start and goal\n")
    print(f"| robot | part | none shared | solved in {LIMIT:g} s | median s | 90% s | regrasps: number | faults |")
    print("|---|---|---|---|---|---|---|---|")
    for robot, part in itertools.product(("nextage", "ur3_dual"), ("block", "bracket", "wheel")):
        table, rng = tabletop(robot, part), np.random.default_rng(2026)
        witness, seconds, regrasps, found, apart = Witness(table.scene), [], Counter[str](), 0, 0
        for number in range(count):
            start, goal, shared = draw(table, rng, shared=number % 2 == 1)
            apart += not shared
            before = time.process_time()
            try:
                answer = solve(table, start, goal, seed=number)
            except NoRegraspError as error:
                seconds.append(np.inf)
                sys.stderr.write(f"{robot}, {part}, problem {number}: {error}\n")
                continue
            seconds.append(time.process_time() - before)
            regrasps[str(answer.route.regrasps)] += 1
            wrong = faults(table.scene, table.resting(start), answer.steps, part, witness)
            found += len(wrong)
            for line in wrong:
                sys.stderr.write(f"{robot}, {part}, problem {number}: {line}\n")
        solved = np.mean(np.array(seconds) <= LIMIT)
        middle, most = np.percentile(seconds, [50.0, 90.0], method="higher")
        counts = ", ".join(f"{k}: {n}" for k, n in sorted(regrasps.items()))
        print(
            f"| {robot} | {part} | {apart} | {solved:.0%} | {middle:.2f} | {most:.2f} | {counts} | {found} |",
            flush=True,
        )


def draw(table: Tabletop, rng: np.random.Generator, shared: bool) -> tuple[Array, Array, bool]:
    """A start and a goal that some grasp reaches each, and whether any arm shares one; if not ``shared``, none does."""
    grasps = table.grasps.thin(GRASPS)
    every = np.ones(len(grasps), dtype=bool)
    while True:
        ends = [stand(table, rng) for _ in range(2)]
        reacher = table.reacher(ends[0], grasps)
        works = {
            arm: [reacher.reach(table.node(f"{i}", at), arm, every).mask(len(grasps)) for i, at in enumerate(ends)]
            for arm in HANDS
        }
        if all(any(masks[end].any() for masks in works.values()) for end in range(2)):
            both = any((here & there).any() for here, there in works.values())
            if shared or not both:
                return ends[0], ends[1], both


def stand(table: Tabletop, rng: np.random.Generator) -> Array:
    """A random stable pose on the table."""
    placements = find_placements(table.part)
    x, y = (rng.uniform(-0.5, 0.5, 2)) * (table.support.size - 0.1)
    turned = pose([x, y, 0.0], [0.0, 0.0, rng.uniform(-np.pi, np.pi)])
    return table.support.world_from_support @ turned @ placements.surface_from_part[rng.integers(len(placements))]


def solve(table: Tabletop, start: Array, goal: Array, *, seed: int, supports: bool = True, n: int = GRASPS) -> Regrasp:
    grasps = table.grasps.thin(n)
    return plan_regrasp(
        table.scene,
        table.resting(start),
        table.part,
        dict.fromkeys(HANDS, grasps),
        [table.node("goal", goal)],
        [table.support] if supports else [],
        rests_on="table",
        seed=seed,
    )


# Growth ---------------------------------------------------------------------------------------------------------------


class Stopwatch:
    """Processor seconds spent in calls of some functions."""

    def __init__(self) -> None:
        self.seconds = 0.0

    @contextmanager
    def on(self, owner: Any, name: str):
        """Count the time of every call of ``owner.name``."""
        plain: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **options: Any) -> Any:
            before = time.process_time()
            answer = plain(*args, **options)
            self.seconds += time.process_time() - before
            return answer

        setattr(owner, name, timed)
        yield
        setattr(owner, name, plain)


def growth() -> None:
    table = tabletop("ur3_dual", "block")
    start, goal = table.at([0.3, -0.2, 0.05]), table.at([0.3, 0.2, 0.05], [np.pi, 0.0, 0.0])
    print(f"\nThe graph of a block that is turned over on ur3_dual: {ROUTES} routes, grasps chosen along four of them,")
    print(f"median of {RUNS} runs; inverse kinematics and the following of lines are counted apart\n")
    print("| grasps | graph s | ms a grasp | inverse kinematics s | lines s | grasps tested | routes |")
    print("|---|---|---|---|---|---|---|")
    search(table, start, goal, 20)
    for n in SIZES:
        runs = [search(table, start, goal, n) for _ in range(RUNS)]
        rest, kinematics, lines, tested, routes = np.median(runs, axis=0)
        figures = f"{rest:.2f} | {1e3 * rest / n:.1f} | {kinematics:.2f} | {lines:.2f} | {tested:.0f} | {routes:.0f}"
        print(f"| {n} | {figures} |", flush=True)


def search(table: Tabletop, start: Array, goal: Array, n: int) -> tuple[float, float, float, int, int]:
    """Processor seconds of all but kinematics, of inverse kinematics, and of following lines; grasps tested; routes."""
    grasps, kinematics, lines = table.grasps.thin(n), Stopwatch(), Stopwatch()
    begin, end = Node("start", start, "table"), table.node("goal", goal)
    before = time.process_time()
    with kinematics.on(IKSolver, "__call__"), lines.on(reach, "track"):
        reacher = table.reacher(start, grasps)
        rng = np.random.default_rng(0)
        graph = RegraspGraph(reacher, begin, None, between(reacher, table.part, begin, [end], [table.support], rng))
        goals = [Goal(end, {arm: np.ones(n, dtype=bool) for arm in HANDS})]
        routes = list(itertools.islice(graph.routes(goals), ROUTES))
        for route in routes[:4]:
            choose(graph, route)
    seconds = time.process_time() - before
    rest = seconds - kinematics.seconds - lines.seconds
    return rest, kinematics.seconds, lines.seconds, reacher.looked, len(routes)


# The box that is turned over ------------------------------------------------------------------------------------------


def flip() -> None:
    table = tabletop("ur3_dual", "block")
    start, goal = table.at([0.3, -0.2, 0.05]), table.at([0.3, 0.2, 0.05], [np.pi, 0.0, 0.0])
    solve(table, start, goal, seed=SEEDS, supports=False)
    print(f"\nA 30 x 30 x 100 mm box turned over from hand to hand on ur3_dual, motions included, {SEEDS} seeds\n")
    print("| grasps | median s | worst s | seconds of motion | faults |\n|---|---|---|---|---|")
    witness = Witness(table.scene)
    for n in (300, GRASPS):
        seconds, motion, wrong = [], [], 0
        for seed in range(SEEDS):
            before = time.process_time()
            answer = solve(table, start, goal, seed=seed, supports=False, n=n)
            seconds.append(time.process_time() - before)
            motion.append(sum(step.trajectory.duration for step in answer.steps))
            wrong += len(faults(table.scene, table.resting(start), answer.steps, "block", witness))
        print(
            f"| {n} | {np.median(seconds):.2f} | {max(seconds):.2f} | {np.median(motion):.1f} | {wrong} |", flush=True
        )


if __name__ == "__main__":
    main()
