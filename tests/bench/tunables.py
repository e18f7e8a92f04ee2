# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""The paper's figure of its tunable parameters (section V.A): ``python tests/bench/tunables.py`` writes it to docs/.

``--output FOLDER`` writes tunables.png and tunables.md elsewhere.
"""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import argparse
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import kumitate as km
from kumitate.tasks.grasps_sweep import Sweep, read_sweep, shown, swept, usual_unit

HERE = Path(__file__).resolve()
REPOSITORY = HERE.parents[2]
OBJECTS = Path(os.environ.get("KUMITATE_OBJECTS", HERE.parents[3] / "shared" / "objects"))
COLORS = ("#1f6feb", "#d9480f")
TWO, THREE = "robotiq_2f85", "hrp5p_three_finger"


@dataclass(frozen=True)
class Row:
    """One parameter: the hand that shows it, its values, what it does, and what is seen on the paper's objects."""

    hand: str
    values: str
    does: str
    seen: str


ROWS = (
    Row(
        TWO,
        "theta_pln=0..40/9",
        "Planarity: a triangle belongs to a facet if its normal is within theta_pln of the seed's. Smaller values "
        "leave flatter and smaller facets, and more of them; at 0 each flat patch is a facet of its own, and on a part "
        "of small curved triangles none is wide enough for a contact t_bdry from its boundary.",
        "As the paper says: facets grow with theta_pln, of the bunny from 1 to 73 triangles. Larger facets have more "
        "contacts and pairs, and mostly more grasps; not always, since they are other contacts (at 25 deg 24 of the "
        "bunny's 249 pairs have free strokes, at 20 deg 27 of 185).",
    ),
    Row(
        TWO,
        "theta_fct=4..40/10",
        "Overlap: a triangle becomes the seed of a new facet unless a facet that holds it has a seed whose normal is "
        "within theta_fct of its own. Smaller values leave more facets, which overlap more. Values above theta_pln "
        "change nothing, for each triangle of a facet is within theta_pln of its seed.",
        "As the paper says: the smaller theta_fct, the more overlap; at 20 deg each triangle of the bunny lies in 1.5 "
        "facets in the mean, at 4 deg in 11. The paper claims no necessary relation to the size of facets or to the "
        "number of grasps: with more overlap the bunny has more grasps, the drill about as many.",
    ),
    Row(
        TWO,
        "theta_parl=120..180/13",
        "Parallelism: two facets make pairs if their normals differ by at least theta_parl. Nearer to 180 deg, fewer "
        "pairs oppose each other well enough; farther from it there are more grasps, but worse ones.",
        "As the paper says: more pairs and grasps the farther from 180 deg. Below 140 deg pairs are added and hardly a "
        "grasp: nearly all of them fail at the strokes. The bunny has no pair left at 175 deg.",
    ),
    Row(
        TWO,
        "h_max=0..3/7",
        "Soft penetration: how deep a pad may sink in. It decides how large the contact regions are, and so what "
        "torque they resist (stability), and how far a pad may sink in to reach its contact where the surface is not "
        "flat.",
        "As the paper says: with less penetration fewer grasps are left. At 0 there are none, for then the strokes "
        "touch the surface that their contacts lie on. None of the bunny's grasps (0.13 kg) turns under gravity at any "
        "of the values: strokes and pads decide. Of the drill's hands (0.92 kg) that touch nothing 9% hold it at 0.5 "
        "mm, 24% at 3 mm.",
    ),
    Row(
        THREE,
        "t_dct=0..6/7",
        "Distance: how far from the surface either finger of the pair may stop, for three-finger hands. Larger values "
        "find more grasps, of which more touch with one of the two fingers first.",
        "As the paper says: grasps increase with t_dct. On the drill no more are found from 2 mm on: what is added "
        "touches the part or turns under gravity.",
    ),
    Row(
        TWO,
        "n_da=2..16/8",
        "Rotations: at how many angles about its axis each contact pair is tried. More of them give denser grasps, at "
        "a cost that grows with them.",
        "As the paper says: a larger n_da leads to denser results. Which angles they are matters too: at n_da = 2 "
        "nearly every hand touches the drill and no other holds it, and at 8 there are hardly more grasps than at 6.",
    ),
)
HEAD = """\
# The tunable parameters

Written by `python tests/bench/tunables.py`: each of the paper's parameters (section V.A) through a row of values, the
others at their defaults, on {parts}, each of 1000 kg/m3.
`kumitate grasps --sweep` takes any part and hand through such a row.

![Grasps and facets over each parameter](tunables.png)

Grasps of two-finger hands count both ways round (fingers swapped); contacts count once for each facet that they lie
in; "triangles" is the mean number of triangles of a facet. What is the same in all rows is left out.

The paper's figure gives theta_pln and theta_fct as 180 deg minus the angle (160 deg stands for 20 deg), so that its
trends in these two read reversed; here both are the angle itself.
"""


def parts() -> tuple[dict[str, km.Part], bool]:
    """Two parts under the names they are shown with, and whether they are the paper's."""
    files = {"bunny": OBJECTS / "bunnysim.stl", "drill": OBJECTS / "tool2.stl"}
    if all(file.is_file() for file in files.values()):
        return {name: km.Part.load(file, unit="m", density=1000.0) for name, file in files.items()}, True
    print("the paper's meshes are not here (KUMITATE_OBJECTS names their folder): two parts of our own in their place")
    own = ("wheel", "drill")
    return {n: km.Part.load(REPOSITORY / f"examples/parts/{n}.stl", unit="mm", density=1000.0) for n in own}, False


def measured(chosen: dict[str, km.Part]) -> list[list[Sweep]]:
    """A sweep for each parameter and part."""
    sweeps = []
    for row in ROWS:
        name, values = read_sweep(row.values, "ROWS")
        hand = km.load_hand(row.hand)
        sweeps.append([swept(part, hand, km.GraspParameters(), name, values) for part in chosen.values()])
        print(name, *(sweep.grasps.tolist() for sweep in sweeps[-1]), flush=True)
    return sweeps


def draw(path: Path, chosen: dict[str, km.Part], sweeps: list[list[Sweep]]) -> None:
    """Six panels: grasps on the left axis, facets on the right one, the default as a grey line."""
    figure = Figure(figsize=(13.0, 8.5), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    lines = []
    for axes, row, both in zip(figure.subplots(2, 3).flat, ROWS, sweeps, strict=True):
        name, right = both[0].name, axes.twinx()
        unit, one = usual_unit(name)
        default = axes.axvline(
            getattr(km.GraspParameters(), name) / one, color="#cccccc", linewidth=4.0, zorder=0.7, label="default"
        )
        for label, color, sweep in zip(chosen, COLORS, both, strict=True):
            values = sweep.values / one
            lines += axes.plot(values, sweep.grasps, "o-", color=color, markersize=4, label=f"{label}: grasps")
            lines += right.plot(values, sweep.facets, ":", color=color, label=f"{label}: facets")
        axes.set_ylim(0.0, 1.05 * max(1, *(sweep.grasps.max() for sweep in both)))
        right.set_ylim(0.0, 1.4 * max(sweep.facets.max() for sweep in both))  # clear of the grasps where it is level
        axes.set_title(f"{name} ({row.hand})", fontsize=11)
        axes.set_xlabel(f"{name} [{unit}]" if unit else name)
        axes.set_ylabel("grasps")
        right.set_ylabel("facets")
        axes.grid(color="#e4e4e4")
        axes.set_axisbelow(True)
        axes.locator_params(axis="x", integer=not unit)
    figure.legend(handles=[*lines[:4], default], loc="outside upper center", ncols=5)
    figure.savefig(path)


def page(chosen: dict[str, km.Part], sweeps: list[list[Sweep]], papers: bool) -> str:
    """The figure, the numbers and what they mean."""
    names = "the paper's bunny and electric drill" if papers else f"two parts of our own ({' and '.join(chosen)})"
    words = HEAD.format(parts=names).splitlines()
    for row, both in zip(ROWS, sweeps, strict=True):
        words += ["", f"## {both[0].name}", "", *wrap(row.does, 120), ""]
        words += [*wrap(row.seen, 120), ""] if papers else []
        words += table(chosen, both)
    return "\n".join(words) + "\n"


def table(chosen: dict[str, km.Part], both: list[Sweep]) -> list[str]:
    """A row for each value, with the columns that change."""
    columns = {both[0].name: [shown(both[0].name, value) for value in both[0].values]}
    for label, sweep in zip(chosen, both, strict=True):
        columns |= {f"{label}: facets": [str(number) for number in sweep.facets]}
        columns |= {f"{label}: triangles": [f"{mean:.1f}" for mean in sweep.triangles]}
        columns |= {f"{label}: contacts": [str(number) for number in sweep.contacts]}
        columns |= {f"{label}: pairs": [str(number) for number in sweep.pairs]}
        columns |= {f"{label}: grasps": [str(number) for number in sweep.grasps]}
    kept = {head: column for head, column in columns.items() if len(set(column)) > 1}
    rows = zip(*kept.values(), strict=True)
    return [f"| {' | '.join(kept)} |", "|---" + "|--:" * (len(kept) - 1) + "|", *(f"| {' | '.join(r)} |" for r in rows)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=REPOSITORY / "docs")
    folder = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    chosen, papers = parts()
    sweeps = measured(chosen)
    draw(folder / "tunables.png", chosen, sweeps)
    (folder / "tunables.md").write_text(page(chosen, sweeps, papers))


if __name__ == "__main__":
    main()
