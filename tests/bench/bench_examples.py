"""The demonstrations in figures: from the task files to verified plans.

``python tests/bench/bench_examples.py`` prints Markdown; ``--seeds 2`` for so many seeds, ``--from 100`` for others,
``--only bolt drill`` for some of the examples. Each plan is made by the command line in a process of its own with an
empty cache, imports included. Figures are medians unless they say otherwise; where other programs run too, wall times
tell less than the processor time.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from bench_wheel import EXAMPLES, planned

from kumitate.tasks.document import Plan

sys.path.insert(0, str(EXAMPLES))

from run_all import TASKS

BAR, BARS = 15.0, {"kitting": 40.0, "four_parts": 40.0}  # s, of the median
STAGES = ["cell", "grasps", "regrasps and motions", "verification"]
HEAD = ["example", "solved", "s", "bar", "largest", "processor s", *STAGES, "regrasps", "motion s", "joint travel rad"]


def figures(seconds: float, processor: float, plan: Plan) -> list[float]:
    """Wall and processor time [s], time by stage [s], regrasps, motion [s] and joint travel [rad] of a plan."""
    travel = sum(float(np.abs(np.diff(action.motion.positions, axis=0)).sum()) for action in plan.actions)
    return [seconds, processor, *(plan.seconds[stage] for stage in STAGES), regrasps(plan), plan.duration, travel]


def spent() -> float:
    """Processor time of all processes that were waited for [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def regrasps(plan: Plan) -> int:
    """How often a hand takes a part that a hand has taken already for the same goal."""
    takes = Counter(
        (action.goal, event.part)
        for action in plan.actions
        for event in action.events
        if event.kind == "attach" and event.carrier in plan.task["hands"]
    )
    return takes.total() - len(takes)


def row(name: str, seeds: Iterable[int]) -> tuple[list[str], list[str]]:
    """The cells of an example, and its failures in words."""
    plans, failures = [], []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as cache:
            before = spent()
            seconds, answer = planned(EXAMPLES / TASKS[name], seed, Path(cache))
            if "error" in answer:
                failures.append(f"{name}, seed {seed}, after {seconds:.0f} s: {answer['error']['message']}")
            else:
                plans.append(figures(seconds, spent() - before, Plan.load(answer["plan"])))
    solved, bar = f"{len(plans)} of {len(plans) + len(failures)}", f"{BARS.get(name, BAR):.0f}"
    if not plans:
        return [name, solved, "-", bar, *["-"] * (len(HEAD) - 4)], failures
    median, *others = (f"{figure:.1f}" for figure in np.median(plans, axis=0))
    return [name, solved, median, bar, f"{np.max(plans, axis=0)[0]:.1f}", *others], failures


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="The demonstrations in figures.")
    parser.add_argument("--seeds", type=int, default=10, help="so many seeds for each example")
    parser.add_argument("--from", type=int, default=0, dest="first", help="the first seed")
    parser.add_argument("--only", nargs="+", choices=TASKS, default=TASKS, help="these examples")
    given = parser.parse_args(arguments)
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|", flush=True)
    failures = []
    for name in given.only:
        cells, failed = row(name, range(given.first, given.first + given.seeds))
        print("| " + " | ".join(cells) + " |", flush=True)
        failures += failed
    for failure in failures:
        print(f"\n- {failure}")


if __name__ == "__main__":
    main()
