"""The main job in figures: wheels onto a support, from the task file to a verified plan.

``python tests/bench/bench_wheel.py`` prints Markdown; with ``--seeds 2`` only so many seeds a row. Each plan is made by
the command line in a process of its own, imports included: first with an empty cache of grasps, then again with it.
Figures are medians unless they say otherwise.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from kumitate.errors import InputError
from kumitate.tasks.cell import build_cell
from kumitate.tasks.task_file import read_task, task_of, task_to_builtins

HERE = Path(__file__).resolve()
EXAMPLES = HERE.parents[2] / "examples"
OBJECTS = Path(os.environ.get("KUMITATE_OBJECTS", HERE.parents[3] / "shared" / "objects"))
PAPER = {"wheel": "planewheel.stl", "support": "planefrontstay.stl"}  # in metres
LIMIT = "120 s"
# Rows: the task file, how many seeds, whether the start poses are drawn at random.
ONE_WHEEL = {
    "upright": ("task.yaml", 5, False),
    "lying": ("lying.yaml", 5, False),
    "at random": ("task.yaml", 10, True),
}
TWO_WHEELS = {
    "upright, two wheels": ("two_wheels.yaml", 10, False),
    "lying, two wheels": ("two_wheels_lying.yaml", 10, False),
}
HEAD = ["start", "solved", "cold s", "90%", "largest", "warm s", "verification s", "motion s", "largest"]


@dataclass
class Row:
    """What came of the runs of a row."""

    cold: list[float] = field(default_factory=list)
    warm: list[float] = field(default_factory=list)
    verification: list[float] = field(default_factory=list)
    motion: list[float] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    runs: int = 0

    def add(self, other: Row) -> None:
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)

    def cells(self) -> list[str]:
        if not self.cold:
            return [f"0 of {self.runs}", *["-"] * (len(HEAD) - 2)]
        times = [np.median(self.cold), np.percentile(self.cold, 90), max(self.cold), np.median(self.warm)]
        shown = [*times, np.median(self.verification), np.median(self.motion), max(self.motion)]
        return [f"{len(self.cold)} of {self.runs}", *(f"{seconds:.1f}" for seconds in shown)]


def planned(task: Path, seed: int, cache: Path) -> tuple[float, dict]:
    """Wall time [s] of a process that plans, and its answer."""
    command = [sys.executable, "-m", "kumitate.tasks.cli", "plan", str(task), "--seed", str(seed), "--json"]
    command += ["--time-limit", LIMIT, "--output", str(cache / "plan.json")]
    started = time.perf_counter()
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "KUMITATE_CACHE": str(cache)}
    )
    seconds = time.perf_counter() - started
    if not done.stdout:  # neither a plan nor a reason
        return seconds, {"error": {"message": done.stderr.splitlines()[-1]}}
    return seconds, json.loads(done.stdout)


def run(task: Path, seed: int) -> Row:
    row = Row(runs=1)
    with tempfile.TemporaryDirectory() as cache:
        seconds, answer = planned(task, seed, Path(cache))
        if "error" in answer:
            row.failures.append(f"{task.stem}, seed {seed}, after {seconds:.0f} s: {answer['error']['message']}")
            return row
        row.cold.append(seconds)
        row.verification.append(answer["seconds"]["verification"])
        row.motion.append(answer["duration"])
        row.warm.append(planned(task, seed, Path(cache))[0])
    return row


def at_random(task: Path, seed: int) -> Path:
    """A task file beside ``task`` whose parts start elsewhere on the table: the support on the right, either way up."""
    rng = np.random.default_rng(1000 + seed)
    while True:
        written = task_to_builtins(read_task(task))
        for name, part in written["parts"].items():
            turn = float(rng.uniform(-np.pi, np.pi))
            x, y = float(rng.uniform(0.28, 0.46)), float(rng.uniform(0.12, 0.42))
            lies = name == "support" and rng.random() < 0.5
            upright = [0.0, 0.0, turn] if name == "support" else [np.pi / 2, 0.0, turn]
            part["at"] = {
                "xyz": [x, -y if name == "support" else y, -0.035 if lies else -0.05],
                "rpy": [turn, -np.pi / 2, 0.0] if lies else upright,
            }
        try:
            build_cell(task_of(written), task.parent)
        except InputError:  # something stands in something else there
            continue
        drawn = task.with_name(f"{task.stem}_{seed}.yaml")
        drawn.write_text(yaml.safe_dump(written), encoding="utf-8")
        return drawn


def table(title: str, folder: Path, rows: dict[str, tuple[str, int, bool]], most: int) -> None:
    print(f"\n### {title}\n\n| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|", flush=True)
    total = Row()
    for name, (file, count, random) in rows.items():
        row = Row()
        for seed in range(min(count, most)):
            row.add(run(at_random(folder / file, seed) if random else folder / file, seed))
        print("| " + " | ".join([name, *row.cells()]) + " |", flush=True)
        total.add(row)
    print("| " + " | ".join(["all", *total.cells()]) + " |", flush=True)
    for failure in total.failures:
        print(f"\n- {failure}")


def copied(to: Path, meshes: dict[str, str] | None = None) -> Path:
    """The folder of the examples' tasks, copied ``to`` a place; with other meshes (in metres) if given."""
    shutil.copytree(EXAMPLES, to)
    folder = to / "wheel_support"
    for file in folder.glob("*.yaml") if meshes else ():
        written = task_to_builtins(read_task(file))
        for name, part in written["parts"].items():
            own = meshes["support" if name == "support" else "wheel"]
            shutil.copy(OBJECTS / own, to / "parts" / own)
            part.update(mesh=f"../parts/{own}", unit="m")
        file.write_text(yaml.safe_dump(written), encoding="utf-8")
    return folder


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="The main job in figures.")
    parser.add_argument("--seeds", type=int, default=20, help="at most so many seeds a row")
    most = parser.parse_args(arguments).seeds
    with tempfile.TemporaryDirectory() as place:
        folder = copied(Path(place) / "own")
        table("one wheel", folder, ONE_WHEEL, most)
        table("two wheels", folder, TWO_WHEELS, most)
        if not all((OBJECTS / mesh).is_file() for mesh in PAPER.values()):
            print("\nThe paper's meshes are not here; KUMITATE_OBJECTS names their folder.")
            return
        folder = copied(Path(place) / "paper", PAPER)
        table("one wheel, the paper's meshes", folder, ONE_WHEEL, most)
        table("two wheels, the paper's meshes", folder, TWO_WHEELS, most)


if __name__ == "__main__":
    main()
