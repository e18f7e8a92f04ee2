"""What commands that plan the grasps of a part by a hand are told: the part, its weight, the hand, the parameters."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .grasps_sweep import shown, usual_unit
from .output import check_writable
from .quantities import parse_quantity

if TYPE_CHECKING:
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..robots.hand import Hand

_DENSITY = 1000.0  # kg/m3, unless given


@dataclass(frozen=True, eq=False)
class Request:
    """Whose grasps are asked for.

    Attributes:
        part: The part.
        hand: The hand.
        parameters: The planner's parameters.
        about: Lines on the part: its weight, what was repaired, what to know.
    """

    part: Part
    hand: Hand
    parameters: GraspParameters
    about: tuple[str, ...]


def add_grasp_options(parser: argparse.ArgumentParser) -> None:
    """Describe them."""
    from ..grasping.parameters import GraspParameters

    parser.add_argument("mesh", type=Path, help="mesh of the part (STL, OBJ, PLY, OFF, GLB)")
    parser.add_argument("--unit", required=True, help="what one unit of the mesh is: mm, cm, m or in")
    parser.add_argument("--hand", required=True, help="a shipped hand, or the YAML file of your own")
    weight = parser.add_mutually_exclusive_group()
    weight.add_argument("--mass", help='mass of the part, such as "50 g"')
    weight.add_argument("--density", help=f'density of the part; "{_DENSITY:g} kg/m3" unless given')
    knobs = parser.add_argument_group("parameters of the planner, under the paper's names")
    for item in fields(GraspParameters):
        default = shown(item.name, getattr(GraspParameters(), item.name))
        knobs.add_argument("--" + item.name.replace("_", "-"), help=f"{default} unless given")


def read_grasp_options(options: argparse.Namespace) -> Request:
    """What the options ask for.

    Raises:
        InputError: One is no quantity of its kind or out of range, or mesh or hand cannot be loaded.
    """
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..robots.hand import Hand
    from ..robots.library import load_hand

    given: dict[str, str | None] = {item.name: getattr(options, item.name) for item in fields(GraspParameters)}
    numbers: dict[str, Any] = {k: _parameter(k, text) for k, text in given.items() if text is not None}
    parameters = GraspParameters(**numbers)
    mass = None if options.mass is None else parse_quantity(options.mass, "mass", "--mass")
    density = None
    if mass is None:
        density = _DENSITY if options.density is None else parse_quantity(options.density, "density", "--density")
    hand = Hand.load(options.hand) if Path(options.hand).suffix in (".yaml", ".yml") else load_hand(options.hand)
    part = Part.load(options.mesh, unit=options.unit, mass=mass, density=density)
    origin = f" at {density:g} kg/m3" if density else ""
    about = f"{part.name}: {len(part.mesh.faces)} triangles, {part.mass * 1e3:.4g} g{origin}"
    notes = (f"  {note}" for note in (*part.repairs, *part.warnings))
    return Request(part, hand, parameters, (about, *notes))


def plot_path(options: argparse.Namespace, usual: Path) -> Path:
    """Where ``--plot`` wants the plot; at the ``usual`` place unless it was given.

    Raises:
        InputError: The suffix is that of no picture, or the file cannot be written.
    """
    from .view_regrasp import FORMATS

    plot: Path = options.plot or usual
    if plot.suffix.lower() not in FORMATS:
        raise InputError("--plot", f"{plot} is no kind of picture that can be drawn", f"end it in {', '.join(FORMATS)}")
    check_writable(plot)
    return plot


def whole_number(text: str, place: str) -> int:
    """A whole number that an option gives.

    Raises:
        InputError: It is none.
    """
    if not text.isdecimal():
        raise InputError(place, f"{text!r} is no whole number", "write one such as 8")
    return int(text)


def _parameter(name: str, text: str) -> float:
    place = "--" + name.replace("_", "-")
    if name == "n_da":
        return whole_number(text, place)
    return parse_quantity(text, "angle" if usual_unit(name)[0] == "deg" else "length", place)
