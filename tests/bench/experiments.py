# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""The paper's experiments in physics: ``python tests/bench/experiments.py`` writes docs/experiments.md and its plots.

The paper's objects are read from KUMITATE_OBJECTS, or from where its developers keep them; they are no part of the
repository. Without them the experiments are made with the parts of the examples alone.
"""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import logging
import multiprocessing
import sys
from dataclasses import dataclass
from math import degrees, radians
from pathlib import Path

import numpy as np
import numpy.typing as npt

import kumitate as km
from kumitate.physics.chart import plot_trials
from kumitate.physics.trials import Trials, on_the_table, run_trials

Array = npt.NDArray[np.float64]
HERE = Path(__file__).resolve()
ROOT = HERE.parents[2]
OBJECTS = Path(os.environ.get("KUMITATE_OBJECTS", ROOT.parent / "shared" / "objects"))
DOCS = ROOT / "docs"
DENSITY = 1000.0  # kg/m3
PAPER = {  # theta_parl: candidates, failures, largest dx and dy [mm]
    ("housing", 140): (44, 2, 2.19, 1.90),
    ("housing", 160): (32, 0, 1.95, 1.88),
    ("bunnysim", 140): (6, None, 1.00, 4.50),
    ("bunnysim", 160): (1, None, 0.25, 1.00),
}
TWO, THREE, CUP = "robotiq_2f85", "hrp5p_three_finger", "suction_cup"
SAMPLE = 40  # of trials where not all are made
OFF = 1e-3  # m


@dataclass(frozen=True)
class Job:
    """Trials to make: a mesh, a hand, theta_parl [deg], how many at most, and how far the hand stands off [m]."""

    mesh: Path
    hand: str
    theta_parl: int
    count: int | None
    off: float = 0.0


@dataclass(frozen=True, eq=False)
class Result:
    """What came of a job: planned grasps, those that can be tried, and the trials with the quality of each."""

    planned: int
    possible: int
    trials: Trials
    quality: Array


def main() -> int:
    logging.disable()
    paper, own = sorted(OBJECTS.glob("*.stl")), sorted((ROOT / "examples" / "parts").glob("*.stl"))
    if not paper:
        print(f"no meshes of the paper in {OBJECTS}: parts of the examples alone")
    meshes = paper + own
    jobs = [Job(mesh, TWO, 160, None) for mesh in meshes]
    jobs += [Job(mesh, TWO, 160, SAMPLE, OFF) for mesh in meshes]
    jobs += [Job(mesh, TWO, 140, SAMPLE) for mesh in meshes]
    jobs += [Job(mesh, hand, 160, SAMPLE) for hand in (THREE, CUP) for mesh in meshes]
    named = {mesh.stem: mesh for mesh in paper}
    table = [Job(named[name], TWO, theta, None, off) for name, theta in PAPER if name in named for off in (0.0, OFF)]
    wanted = list(dict.fromkeys(table + jobs))
    with multiprocessing.get_context("spawn").Pool() as pool:
        results = dict(zip(wanted, pool.imap(tried, wanted, chunksize=1), strict=True))
    DOCS.mkdir(exist_ok=True)
    (DOCS / "experiments.md").write_text("\n".join(document(results, table, jobs)) + "\n")
    draw_quantiles(results, jobs, DOCS / "displacement.png")
    return 0


def tried(job: Job) -> Result:
    """Plan, try, and draw the pictures that go beside the paper's."""
    part = km.Part.load(job.mesh, unit="m" if job.mesh.is_relative_to(OBJECTS) else "mm", density=DENSITY)
    hand, placements = km.load_hand(job.hand), km.find_placements(part)
    grasps = km.plan_grasps(part, hand, km.GraspParameters(theta_parl=radians(job.theta_parl)))
    possible = len(on_the_table(hand, grasps, placements).grasp)
    trials = run_trials(part, hand, grasps, placements, count=job.count, off=job.off)
    if job.hand == TWO and job.off and (job.mesh.stem, job.theta_parl) in PAPER and len(trials) and job.count is None:
        plot_trials(trials, grasps, DOCS / f"{job.mesh.stem}_{job.theta_parl}.png")
    print(
        f"{job.mesh.stem} {job.hand} {job.theta_parl} {job.off}: {int(trials.held.sum())} of {len(trials)}", flush=True
    )
    return Result(len(grasps), possible, trials, grasps.quality[trials.grasp])


def document(results: dict[Job, Result], table: list[Job], jobs: list[Job]) -> list[str]:
    """The lines of docs/experiments.md."""
    lines = TEXT["top"].splitlines()
    if table:
        lines += ["", *TEXT["paper"].splitlines(), "", *paper_table(results, table)]
    for key, hand, theta, off in SECTIONS:
        chosen = [job for job in jobs if (job.hand, job.theta_parl, job.off) == (hand, theta, off)]
        lines += ["", *TEXT[key].splitlines(), "", *objects_table({job: results[job] for job in chosen})]
    return [*lines, "", *TEXT["end"].splitlines()]


def paper_table(results: dict[Job, Result], table: list[Job]) -> list[str]:
    """Bearing housing and bunny beside the paper's figures."""
    lines = [
        "| object | theta_parl deg | hand off by mm | tried | failed | largest dx mm | largest dy mm "
        "| the paper: tried | failed | dx | dy |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for job in table:
        trials = results[job].trials
        held = trials.shift[trials.held]
        dx, dy = (np.abs(held[:, :2]) * 1e3).max(axis=0, initial=0.0)
        theirs = ["not told" if value is None else f"{value}" for value in PAPER[job.mesh.stem, job.theta_parl]]
        ours = [f"{job.off * 1e3:g}", len(trials), int((~trials.held).sum()), f"{dx:.2f}", f"{dy:.2f}"]
        lines.append("| " + " | ".join(map(str, [job.mesh.stem, job.theta_parl, *ours, *theirs])) + " |")
    return lines


def objects_table(results: dict[Job, Result]) -> list[str]:
    """A row for each object, and one for all of them."""
    lines = [
        "| object | planned | can be tried | tried | lifted % | held % | displacement mm: median | 95 % | largest "
        "| turn deg: median | 95 % | slip mm: median | 95 % | failures by quarter of the quality, lowest first | s |",
        "|---" * 15 + "|",
    ]
    for job, result in results.items():
        lines.append(row(job.mesh.stem, [result]))
    return [*lines, row("**all**", list(results.values()))]


def row(name: str, results: list[Result]) -> str:
    """A line of the table: some results as one."""
    trials = [result.trials for result in results]
    start = [name, sum(r.planned for r in results), sum(r.possible for r in results), sum(len(t) for t in trials)]
    if not sum(len(t) for t in trials):
        return "| " + " | ".join(map(str, start)) + " |" + " - |" * 11
    lifted, held = (np.concatenate([getattr(t, key) for t in trials]) for key in ("lifted", "held"))
    way, turn, slip = (np.concatenate([getattr(t, key) for t in trials]) for key in ("displacement", "turn", "slip"))
    seconds = np.concatenate([t.seconds[t.seconds > 0.0] for t in trials])
    quarters = np.sum([failures_by_quarter(r) for r in results], axis=0)
    cells = [
        *start,
        f"{100.0 * lifted.mean():.1f}",
        f"{100.0 * held.mean():.1f}",
        *(f"{value * 1e3:.3f}" for value in np.quantile(way, [0.5, 0.95, 1.0])),
        *(f"{degrees(value):.2f}" for value in np.quantile(turn, [0.5, 0.95])),
        *(f"{value * 1e3:.3f}" for value in np.quantile(slip, [0.5, 0.95])),
        ", ".join(str(count) for count in quarters),
        f"{np.median(seconds):.2f}, at most {seconds.max():.2f}",
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


def failures_by_quarter(result: Result) -> Array:
    """How many of the trials of each quarter of the quality failed (4,)."""
    quarters = np.array_split(np.argsort(result.quality, kind="stable"), 4)
    return np.array([int((~result.trials.held[chosen]).sum()) for chosen in quarters])


def draw_quantiles(results: dict[Job, Result], jobs: list[Job], path: Path) -> None:
    """Which share of all trials moved the part by no more than so much, a curve a kind of trial."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.2), dpi=120, layout="constrained")
    axes = figure.subplots()
    for key, hand, theta, off in SECTIONS:
        chosen = [results[job] for job in jobs if (job.hand, job.theta_parl, job.off) == (hand, theta, off)]
        way = np.sort(np.concatenate([r.trials.displacement for r in chosen])) * 1e3
        if len(way):
            axes.plot(np.maximum(way, 1e-3), 100.0 * np.arange(1, len(way) + 1) / len(way), label=LABELS[key])
    for bar in (1.0, 2.0):
        axes.axvline(bar, color="#888888", linestyle="--", linewidth=1.0)
    axes.set(xscale="log", xlabel="displacement while the fingers close [mm]", ylabel="share of all trials [%]")
    axes.grid(color="#dddddd")
    axes.legend(loc="lower right")
    figure.savefig(path)


SECTIONS = (
    ("two", TWO, 160, 0.0),
    ("off", TWO, 160, OFF),
    ("wide", TWO, 140, 0.0),
    ("three", THREE, 160, 0.0),
    ("cup", CUP, 160, 0.0),
)
LABELS = {
    "two": "two fingers, theta_parl 160 deg",
    "off": "the same, hand off by up to 1 mm",
    "wide": "two fingers, theta_parl 140 deg",
    "three": "three fingers",
    "cup": "suction cup",
}
TEXT = {
    "top": """# Experiments in physics

`make experiments` writes this page. Planned grasps are tried in MuJoCo, which knows nothing of what the planner took
for granted: a part rests on a table, the hand closes with its speed and force, lifts it by 100 mm in 0.4 s, and is
shaken, by 5 m/s2 along and 20 rad/s2 about each of its axes. Tried are grasps that approach within 40 deg of the
vertical, as in the paper, each in the stable placement where its approach is steepest, and whose hand clears the
table. Two grasps that differ by half a turn of a hand that looks the same are simulated once and count twice.

*Displacement* is the way of the centre of mass along the table while the fingers close, over all trials, failed ones
too; *slip* is its way in the hand while it is lifted. *Lifted*: after lifting, fingers of both sides touch the part,
and it is within 10 mm and 20 deg of where it was grasped. *Held*: that still holds after shaking. Parts have 1000
kg/m3. Friction: pads and lip as the hand's file says (0.5), part on table 0.3, part on metal 0.3. Seconds are of one
core, a trial.

![Share of trials within a displacement](displacement.png)""",
    "paper": """## The paper's table

Bearing housing and Stanford bunny beside the paper's measurements with markers on real parts. Our hand stands exactly
where it was told unless the table says how far off it is at random; a real robot, camera and marker are never exact.
Pictures of the rows with the hand off: [housing 140](housing_140.png), [housing 160](housing_160.png), [bunny
140](bunnysim_140.png), [bunny 160](bunnysim_160.png).""",
    "two": """## Two fingers, theta_parl 160 deg

All grasps that the default planner returns: for the paper's objects and for parts of our own.""",
    "off": f"""## Two fingers, the hand off by up to 1 mm

The same, but for each trial the part lies up to 1 mm aside of where the hand expects it. Here and in the tables below
at most {SAMPLE} of each object are tried, evenly from the best grasp to the worst.""",
    "wide": """## Two fingers, theta_parl 140 deg

Facets may be 20 deg less parallel.""",
    "three": """## Three fingers, theta_parl 160 deg

The fingers turn as they close, coupled rigidly, and their pads are parallel at 30 mm only.""",
    "cup": """## Suction cup

Twelve points of the lip pull with a twelfth of the vacuum's force each, and let go one by one where more is asked of
them; where the lip does not lie on the part all around, there is no vacuum. Its approach needs no pads: theta_parl
plays no part.""",
    "end": """## Limits of the simulation

- Bodies are rigid; pads and lips give by hundredths of a millimetre. A real pad is soft and wide where MuJoCo knows
  points: torsional friction of 3 mm stands for the patch.
- Hand, part and table are exact: no error of calibration, of the mesh, or of where the part is, unless said.
- The surface of a part is exact to a hundredth of a millimetre, the outline of its holes to five, but made of thin
  wedges: what is driven in deeper than about a millimetre slips through.
- The 2F-85 is its parallelogram: that its fingertips can fold around a part when it is taken near the palm is left
  out.
- Friction is one number a pair, the same at rest and in motion; nothing wears, is oily or bends.
- Time steps of 0.25 ms while the fingers close, 1 ms once they hold: steps half as long change displacements by some
  hundredths of a millimetre.""",
}

if __name__ == "__main__":
    sys.exit(main())
