"""One parameter of the grasp planner through a row of values: what becomes of facets, contacts and grasps."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from math import pi
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .quantities import parse_quantity

if TYPE_CHECKING:
    from ..grasping.facets import Indices
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..robots.hand import Hand
    from ..transforms import Array

_SWEEP = re.compile(r"\s*(\w+)\s*=\s*(\S+?)\s*([a-z]*)\s*\.\.\s*(\S+?)\s*([a-z]*)\s*(?:/\s*(\d+)\s*)?")
_VALUES, _MOST_VALUES = 12, 100
_SIDE, _DOTS = (9.0, 6.5), 120  # inches; dots an inch
_INK, _BLUE, _GREEN = "#222222", "#1f6feb", "#2ca02c"


@dataclass(frozen=True, eq=False)
class Sweep:
    """What the planner makes of a part at n values of one parameter.

    Attributes:
        part: Name of the part.
        hand: Name of the hand.
        name: The parameter.
        values: (n,) its values, in SI units.
        facets: (n,) number of facets.
        triangles: (n,) mean number of triangles of a facet.
        contacts: (n,) contacts that both refinements leave, once for each facet that they lie in.
        pairs: (n,) contact pairs; None for a suction cup.
        grasps: (n,) grasps.
        seconds: (n,) processor time of planning [s].
    """

    part: str
    hand: str
    name: str
    values: Array
    facets: Indices
    triangles: Array
    contacts: Indices
    pairs: Indices | None
    grasps: Indices
    seconds: Array


def usual_unit(name: str) -> tuple[str, float]:
    """The unit that a parameter is written in, and one of it in SI: the paper's thetas are angles, n_da is a number."""
    if name == "n_da":
        return "", 1.0
    return ("deg", pi / 180.0) if name.startswith("theta_") else ("mm", 1e-3)


def shown(name: str, value: float) -> str:
    """A parameter as a user writes it."""
    unit, one = usual_unit(name)
    return f"{value / one:.4g} {unit}".rstrip()


def read_sweep(text: str, place: str) -> tuple[str, list[float]]:
    """A parameter and evenly spaced values [SI] out of words such as ``theta_parl=120..175`` or ``t_dct=0..6 mm/4``.

    A unit on either end serves both. Bare angles are degrees here and bare lengths millimetres.

    Args:
        text: ``NAME=LOW..HIGH``, or ``NAME=LOW..HIGH/COUNT`` for another number of values than twelve.
        place: Where it stands, for the message.

    Raises:
        InputError: It is not of that form, or the range is empty.
    """
    from ..grasping.parameters import GraspParameters

    names, match = [item.name for item in fields(GraspParameters)], _SWEEP.fullmatch(text)
    if match is None or match[1] not in names:
        cure = f"write one such as theta_parl=120..175 or theta_parl=120..175/6; parameters: {', '.join(names)}"
        raise InputError(place, f"{text!r} is no range of a parameter", cure)
    name, low_number, low_unit, high_number, high_unit = match.groups()[:5]
    count = _VALUES if match[6] is None else int(match[6])
    low = _bound(name, low_number, low_unit or high_unit, place)
    high = _bound(name, high_number, high_unit or low_unit, place)
    if not low < high:
        raise InputError(place, f"{text!r} is an empty range", "give the lower end first, and a higher one")
    if not 2 <= count <= _MOST_VALUES:
        raise InputError(place, f"{count} values", f"give from 2 to {_MOST_VALUES}")
    values = [*(low + (high - low) * i / (count - 1) for i in range(count - 1)), high]
    return name, sorted(set(map(round, values))) if name == "n_da" else values


def _bound(name: str, number: str, unit: str, place: str) -> float:
    """One end of a range [SI]."""
    if name == "n_da":
        if unit or not number.isdecimal():
            raise InputError(place, f"{number + unit!r} is no whole number", "write one such as 8")
        return int(number)
    usual, _ = usual_unit(name)
    return parse_quantity(f"{number} {unit or usual}", "angle" if usual == "deg" else "length", place)


def swept(
    part: Part,
    hand: Hand,
    parameters: GraspParameters,
    name: str,
    values: Sequence[Any],
    progress: Callable[[str], None] = lambda doing: None,
) -> Sweep:
    """Plan the grasps of a part at each of n values of one parameter, nothing out of the cache.

    Args:
        part: The part.
        hand: The hand.
        parameters: The other parameters.
        name: The parameter.
        values: (n,) its values, in SI units.
        progress: Told what is being planned.

    Raises:
        InputError: A value out of range.
    """
    import numpy as np

    from ..grasping.facets import segment
    from ..grasping.planner import plan_grasps

    rows = []
    for chosen in [replace(parameters, **{name: value}) for value in values]:  # all are checked before the first
        progress(f"{name} = {shown(name, getattr(chosen, name))}")
        started = process_time()
        grasps = plan_grasps(part, hand, chosen)
        seconds = process_time() - started
        kept = {stage.name: stage.kept for stage in grasps.record}
        triangles = len(segment(part, chosen.theta_pln, chosen.theta_fct).faces) / kept["segmentation"]
        counts = (kept["segmentation"], kept["refinement 2"], kept.get("contact pairs", 0), len(grasps))
        rows.append((*counts, triangles, seconds))
    table = np.array(rows)
    facets, contacts, pairs, found = table[:, :4].T.astype(np.int64)
    return Sweep(
        part=part.name,
        hand=hand.name,
        name=name,
        values=np.array(values, dtype=float),
        facets=facets,
        triangles=table[:, 4],
        contacts=contacts,
        pairs=pairs if hand.pads else None,
        grasps=found,
        seconds=table[:, 5],
    )


def plot_sweep(sweep: Sweep, path: str | Path) -> None:
    """Draw facets, their size, contacts and grasps over the values; PNG, PDF or SVG by the file's suffix."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIDE, dpi=_DOTS, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{sweep.part} by {sweep.hand}", color=_INK, parse_math=False)
    unit, one = usual_unit(sweep.name)
    contacts = {"contacts": sweep.contacts}
    panels: tuple[tuple[str, dict[str, Any]], ...] = (
        ("facets", {"": sweep.facets}),
        ("triangles of a facet, mean", {"": sweep.triangles}),
        ("contacts", contacts if sweep.pairs is None else {**contacts, "contact pairs": sweep.pairs}),
        ("grasps", {"": sweep.grasps}),
    )
    for axes, (title, lines) in zip(figure.subplots(2, 2, sharex=True).flat, panels, strict=True):
        for color, (label, line) in zip((_BLUE, _GREEN), lines.items(), strict=False):
            axes.plot(sweep.values / one, line, "o-", color=color, markersize=4, label=label)
        axes.set_title(title, fontsize=10, color=_INK)
        axes.set_ylim(0.0, 1.08 * max(1.0, *map(max, lines.values())))
        axes.locator_params(axis="x", integer=sweep.name == "n_da")
        axes.grid(color="#dddddd")
        if len(lines) > 1:
            axes.legend()
    figure.supxlabel(f"{sweep.name} [{unit}]" if unit else sweep.name, parse_math=False)
    figure.savefig(path)
