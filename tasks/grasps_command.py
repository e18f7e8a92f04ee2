"""The command ``kumitate grasps``: the grasps of a part by a hand, and what each stage of their planning dropped."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import InputError
from .output import say, write_file
from .quantities import parse_quantity

_DENSITY = 1000.0  # kg/m3, unless given
_ANGLES = ("theta_pln", "theta_fct", "theta_parl")


def add_grasps(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    from ..grasping.parameters import GraspParameters

    parser.description = "Plan the grasps of a part, print what each stage kept, and write them to an .npz file."
    parser.add_argument("mesh", type=Path, help="mesh of the part (STL, OBJ, PLY, OFF, GLB)")
    parser.add_argument("--unit", required=True, help="what one unit of the mesh is: mm, cm, m or in")
    parser.add_argument("--hand", required=True, help="a shipped hand, or the YAML file of your own")
    weight = parser.add_mutually_exclusive_group()
    weight.add_argument("--mass", help='mass of the part, such as "50 g"')
    weight.add_argument("--density", help=f'density of the part; "{_DENSITY:g} kg/m3" unless given')
    parser.add_argument("--output", type=Path, help="where the grasps go; MESH.HAND.npz beside the mesh unless given")
    parser.add_argument(
        "--view", type=Path, nargs="?", const=Path(), metavar="HTML", help="write a page to look at too"
    )
    parser.add_argument("--no-cache", action="store_true", help="plan even if these grasps are in the cache")
    knobs = parser.add_argument_group("parameters of the planner, under the paper's names")
    for item in fields(GraspParameters):
        default = _shown(item.name, getattr(GraspParameters(), item.name))
        knobs.add_argument("--" + item.name.replace("_", "-"), help=f"{default} unless given")
    parser.set_defaults(run=_grasps)


def _shown(name: str, value: float) -> str:
    """A parameter as a user writes it."""
    if name == "n_da":
        return f"{value}"
    return f"{value * 57.29577951308232:.4g} deg" if name in _ANGLES else f"{value * 1e3:g} mm"


def _grasps(options: argparse.Namespace) -> int:
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..grasping.planner import plan_grasps
    from ..grasping.store import cached_grasps
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
    output = options.output or options.mesh.with_suffix(f".{hand.name}.npz")

    grasps = (plan_grasps if options.no_cache else cached_grasps)(part, hand, parameters)
    origin = f" at {density:g} kg/m3" if density else ""
    say(f"{part.name}: {len(part.mesh.faces)} triangles, {part.mass * 1e3:.4g} g{origin}")
    for note in (*part.repairs, *part.warnings):
        say(f"  {note}")
    say(f"{'stage':<18}{'taken':>8}{'kept':>8}{'ms':>8}  dropped")
    for stage in grasps.record:
        dropped = ", ".join(f"{count} {reason}" for reason, count in stage.dropped.items() if count)
        say(f"{stage.name:<18}{stage.taken:>8}{stage.kept:>8}{stage.seconds * 1e3:>8.0f}  {dropped}".rstrip())
    write_file(output, grasps.save)
    say(f"{len(grasps)} grasps -> {output}")
    if options.view is not None:
        from .view_grasps import write_grasp_page

        page = options.view if options.view.name else output.with_suffix(".html")
        write_file(page, lambda path: write_grasp_page(path, part, hand, parameters, grasps))
        say(f"view -> {page}")
    return 0 if len(grasps) else 1


def _parameter(name: str, text: str) -> float:
    place = "--" + name.replace("_", "-")
    if name == "n_da":
        if not text.isdecimal():
            raise InputError(place, f"{text!r} is no whole number", "write one such as 8")
        return int(text)
    return parse_quantity(text, "angle" if name in _ANGLES else "length", place)
