"""Time of a 12-joint query among clutter, and of importing the package, as Markdown tables.

Pairs of free random configurations of two UR3 with two 2F-85, a table, a rack and five parts. A plain RRT-Connect with
30 s for each pair tells which pairs have an answer; the first 20 of those are asked.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from cells import make_cell

from kumitate.errors import NoPathError
from kumitate.robots.motion import MOST_CHECKS, SEARCH_STEP, Search, plan_motion
from kumitate.robots.timing import time_motion

PAIRS = 20
RUNS = 5
ARMS = ["left", "right"]


def solvable(checker, robot, start, goal, seconds=30.0) -> bool:
    """Whether a plain RRT-Connect over all joints finds a path within ``seconds``."""
    space = ob.RealVectorStateSpace(len(start))
    bounds = ob.RealVectorBounds(len(start))
    for i, (low, high) in enumerate(zip(robot.lower, robot.upper, strict=True)):
        bounds.setLow(i, float(low))
        bounds.setHigh(i, float(high))
    space.setBounds(bounds)
    ou.RNG.setSeed(7)
    setup = og.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: checker.free(np.array(state[0 : len(start)])))
    setup.getSpaceInformation().setStateValidityCheckingResolution(0.05 / space.getMaximumExtent())
    ends = []
    for q in (start, goal):
        state = space.allocState()
        for i, value in enumerate(q):
            state[i] = float(value)
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(seconds)
    return bool(setup.haveExactSolutionPath())


def main() -> None:
    scene, states = make_cell("ur3_dual")
    robot, state = scene.robot, states[0]
    checker = scene.checker(state)
    rng = np.random.default_rng(3)

    def free():
        while True:
            q = rng.uniform(robot.lower, robot.upper)
            if checker.free(q):
                return q

    pairs, asked = [], 0
    while len(pairs) < PAIRS:
        start, goal = free(), free()
        asked += 1
        if solvable(checker, robot, start, goal):
            pairs.append((start, goal))
    joints = [robot.arms[arm].indices for arm in ARMS]
    paths, motions, timings, failed = [], [], [], 0
    for run in range(RUNS):
        for start, goal in pairs:
            before = time.perf_counter()
            search = Search(checker, start, joints, robot.lower, robot.upper)
            found = search.path([goal], SEARCH_STEP, run, MOST_CHECKS)
            if found is not None:
                paths.append(time.perf_counter() - before)
            before = time.perf_counter()
            try:
                path = plan_motion(scene, state.with_q(start), goal, ARMS, seed=run)
            except NoPathError:
                failed += 1
                continue
            motions.append(time.perf_counter() - before)
            before = time.perf_counter()
            time_motion(scene, state.with_q(start), path, ARMS)
            timings.append(time.perf_counter() - before)
    print(
        f"{PAIRS} pairs of {asked} random ones have an answer; {RUNS} runs with a seed each, {failed} without a path\n"
    )
    print("| what | median ms | 90th percentile ms |")
    print("|---|---|---|")
    rows = {"to a path": paths, "shortened and checked": motions, "timed and checked again": timings}
    for name, seconds in rows.items():
        print(f"| {name} | {1e3 * np.median(seconds):.0f} | {1e3 * np.percentile(seconds, 90):.0f} |")
    imports = []
    for _ in range(RUNS):
        before = time.perf_counter()
        subprocess.run([sys.executable, "-c", "import kumitate"], check=True)
        imports.append(time.perf_counter() - before)
    bare = []
    for _ in range(RUNS):
        before = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        bare.append(time.perf_counter() - before)
    print(
        f"| import kumitate, interpreter's own start left out | {1e3 * (np.median(imports) - np.median(bare)):.0f} | |"
    )


if __name__ == "__main__":
    main()
