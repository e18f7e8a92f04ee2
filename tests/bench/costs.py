# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""The paper's table of computational costs (section V.B.1): ``python tests/bench/costs.py`` writes docs/costs.md.

``--output FILE`` writes it elsewhere, ``--runs N`` averages so many runs in place of ten.
"""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import argparse
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import kumitate as km

HERE = Path(__file__).resolve()
REPOSITORY = HERE.parents[2]
OBJECTS = Path(os.environ.get("KUMITATE_OBJECTS", HERE.parents[3] / "shared" / "objects"))
# The paper's six, and the files that look like them: its table names none.
PAPERS = {
    "bearing housing": "housing",
    "toy wheel": "planewheel",
    "electric drill": "tool2",
    "tube connector": "ttube",
    "metal workpiece": "sandpart",
    "plastic workpiece": "planerearstay",
}
OWN = ("block", "wheel", "drill", "channel", "ring", "cover")
STAGES = {
    "segmentation": "superimposed segmentation",
    "sampling": "sampling",
    "refinement 1": "removing bad samples 1",
    "refinement 2": "removing bad samples 2",
    "contact pairs": "contact pairs",
    "stroke collision": "collision: strokes against part",
    "pad standing": "pads stand on the surface *",
    "seal": "lip seals *",
    "hand collision": "collision: hand against part",
    "stability": "stability",
    "closing fingers": "fingers on their way, forces *",
    "peel": "peel *",
    "both ways round": "fingers swapped *",
}
COUNTS = {"segmentation": "facets", "refinement 2": "contacts", "contact pairs": "contact pairs"}
WRS = {  # mesh, processor seconds, grasps
    "bearing housing": ("housing", 5.2, 742),
    "toy wheel": ("planewheel", 6.9, 942),
    "tube connector": ("ttube", 11.9, 304),
    "metal workpiece": ("sandpart", 5.9, 370),
    "bunny": ("bunnysim", 6.0, 238),
    "plane's front stay": ("planefrontstay", 11.4, 508),
    "motor driver": ("tool_motordriver", 4.1, 1488),
}
TWO, THREE, CUP = "robotiq_2f85", "hrp5p_three_finger", "suction_cup"


@dataclass(frozen=True)
class Cost:
    """What planning took: n runs, in processor seconds, after one that is not counted."""

    part: km.Part
    grasps: km.GraspSet
    stages: dict[str, float]
    total: Sequence[float]

    @property
    def mean(self) -> float:
        return float(np.mean(self.total))

    @property
    def kept(self) -> dict[str, int]:
        return {stage.name: stage.kept for stage in self.grasps.record}


def cost(load: Callable[[], km.Part], hand: str, runs: int, parameters: km.GraspParameters | None = None) -> Cost:
    """Plan a part without the cache, each time freshly loaded so that its mesh keeps nothing from the run before."""
    total, rows, fingers = [], [], km.load_hand(hand)
    for _ in range(1 + runs):  # the first loads the libraries
        part = load()
        started = time.process_time()
        grasps = km.plan_grasps(part, fingers, parameters)
        total.append(time.process_time() - started)
        rows.append([stage.seconds for stage in grasps.record])
    means = np.mean(rows[1:], axis=0)
    return Cost(part, grasps, dict(zip((s.name for s in grasps.record), means, strict=True)), total[1:])


def objects() -> tuple[dict[str, Callable[[], km.Part]], bool]:
    """What loads six parts, under the names they are shown with, and whether they are the paper's."""
    if all((OBJECTS / f"{name}.stl").is_file() for name in {*PAPERS.values(), *(file for file, *_ in WRS.values())}):
        return {name: loader(file) for name, file in PAPERS.items()}, True
    print("the paper's meshes are not here (KUMITATE_OBJECTS names their folder): six parts of our own in their place")
    own = {name: REPOSITORY / f"examples/parts/{name}.stl" for name in OWN}
    return {name: partial(km.Part.load, file, unit="mm", density=1000.0) for name, file in own.items()}, False


def loader(name: str) -> Callable[[], km.Part]:
    """What loads an object of the paper."""
    return partial(km.Part.load, OBJECTS / f"{name}.stl", unit="m", density=1000.0)


def table(heads: Sequence[str], costs: Sequence[Cost]) -> list[str]:
    """A column for each object, a row for each count and stage."""
    rows = [
        ("vertices", [len(c.part.mesh.vertices) for c in costs]),
        ("triangles", [len(c.part.mesh.faces) for c in costs]),
        *((label, [c.kept.get(name, "") for c in costs]) for name, label in COUNTS.items()),
        ("grasps", [len(c.grasps) for c in costs]),
    ]
    dearest = [max(c.stages, key=lambda name, c=c: c.stages[name]) for c in costs]
    for name, label in STAGES.items():
        cells = [_seconds(c.stages[name]) if name in c.stages else "" for c in costs]
        marked = [f"**{cell}**" if name == most else cell for cell, most in zip(cells, dearest, strict=True)]
        rows += [(f"{label} [s]", marked)] if any(cells) else []
    rows.append(("**in all** [s]", [f"{c.mean:.3f}" for c in costs]))
    rows.append(("least to most of the runs [s]", [f"{min(c.total):.3f} to {max(c.total):.3f}" for c in costs]))
    lines = ["| | " + " | ".join(heads) + " |", "|---" + "|--:" * len(heads) + "|"]
    return lines + [f"| {label} | " + " | ".join(map(str, cells)) + " |" for label, cells in rows]


def _seconds(value: float) -> str:
    return f"{value:.3f}" if value >= 5e-4 else "< 0.001"


def against_wrs(runs: int) -> list[str]:
    """Rows for the objects that WRS has a figure for; grasps one way round, as it counts."""
    lines = ["| | WRS [s] | its grasps | n_da = 8 [s] | grasps | n_da = 16 [s] | grasps |", "|---" + "|--:" * 6 + "|"]
    for name, (file, seconds, grasps) in WRS.items():
        cells = [seconds, grasps]
        for n_da in (8, 16):
            c = cost(loader(file), TWO, runs, km.GraspParameters(n_da=n_da))
            cells += [f"{c.mean:.2f}", c.kept["closing fingers"]]
        lines.append(f"| {name} | " + " | ".join(map(str, cells)) + " |")
    return lines


def machine() -> str:
    """Processor and versions."""
    info = Path("/proc/cpuinfo")
    models = [line.partition(":")[2].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
    return f"one core of {models[0] if models else platform.machine()}, Python {platform.python_version()}"


def page(load: dict[str, Callable[[], km.Part]], papers: bool, runs: int) -> str:
    """The whole document."""
    print("two fingers", flush=True)
    costs = {name: cost(loaded, TWO, runs) for name, loaded in load.items()}
    words = [HEAD.format(runs=runs, machine=machine())]
    words += [ABOUT_PAPERS if papers else "The paper's meshes were not at hand; these are parts of our own.\n"]
    words += ["## Two fingers: robotiq_2f85", "", *table(list(costs), list(costs.values())), "", ABOUT_STAGES]
    if not papers:
        return "\n".join(words)
    print("other hands", flush=True)
    others = {"tube connector": THREE, "metal workpiece": CUP, "plastic workpiece": CUP}
    heads = [f"{name}, {hand}" for name, hand in others.items()]
    words += ["## Other hands", "", ABOUT_OTHERS]
    words += [*table(heads, [cost(load[name], hand, runs) for name, hand in others.items()]), ""]
    print("beside WRS", flush=True)
    return "\n".join([*words, PAPER, ABOUT_WRS, *against_wrs(runs), ""])


HEAD = """\
# What grasp planning costs

Written by `python tests/bench/costs.py`. Each figure is the mean of {runs} runs in processor seconds,
on {machine}; one run before them is not counted, the part is loaded afresh for each (reading
and repairing it is not counted either), and nothing comes out of the cache of grasps. The parameters are the paper's:
theta_pln 20 deg, theta_fct 20 deg, t_bdry 2 mm, t_rnn 3 mm, h_max 1.5 mm, theta_parl 160 deg, t_dct 3 mm, n_da 8. All
parts weigh 1000 kg/m3; vertices and triangles are those after repair.
"""
ABOUT_PAPERS = """\
The objects are the six of the paper's table in its order. It names no files: which mesh is which of them is inferred
from shape (`{}`).
""".format("`, `".join(PAPERS.values()))
ABOUT_STAGES = """\
The dearest stage of each object is in bold. Grasps count both ways round (fingers swapped). Contacts count once for
each facet that they lie in. Stages with a star are not in the paper's table; its two nested `checkcollision` are the
two collision stages. What stands in the pads' way is found when their whole faces are put on the surface, a stage of
our own between those two; then the hand is checked at its opening, and last, for grasps that hold, its fingers on their
way open and a little further closed, and whether the forces of its sides pass each other. "In all" has what lies
between the stages too, such as the trees of boxes for the collisions.
"""
ABOUT_OTHERS = """\
The tube connector is the paper's example for three fingers, the metal workpiece its example for a suction cup (ours
has a lip of 8 mm radius). A cup has no contact pairs and no strokes.
"""
PAPER = """\
## What the paper says

The values of the paper's table are in a picture. Its text says: averages of ten runs with the parameters above, on
one core of an Intel Xeon E3-1505M v5 at 2.80 GHz, in Python 2.7.11 (32 bit). The dearest stage was the collision of
the hand with the part, which took "a few seconds for a few thousand triangles"; the next one was removing bad samples
1. The processors are not the same, so that the shares of the stages compare better than the seconds.
"""
ABOUT_WRS = """\
## Beside WRS

WRS is the paper's authors' own later system, and open. The figures are its antipodal grasps for a Robotiq 85 at its
library's defaults, measured in November 2026 in processor seconds on a machine with two cores and without a GPU, not
side by side with ours. It turns the hand in steps of 22.5 deg, which is our n_da = 16. Our grasps are counted one way
round here. Of the other systems that we know none gives figures for grasps from a mesh; the last three objects are not
in the paper's table.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=REPOSITORY / "docs" / "costs.md")
    parser.add_argument("--runs", type=int, default=10)
    options = parser.parse_args()
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text(page(*objects(), options.runs))


if __name__ == "__main__":
    main()
