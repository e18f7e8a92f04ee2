"""The command ``kumitate grasps``: the grasps of a part by a hand, and what each stage of their planning dropped."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .grasps_sweep import Sweep, plot_sweep, read_sweep, shown, swept, usual_unit
from .output import check_writable, progress_line, say, write_file
from .quantities import parse_quantity

if TYPE_CHECKING:
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..robots.hand import Hand

_DENSITY = 1000.0  # kg/m3, unless given


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
        default = shown(item.name, getattr(GraspParameters(), item.name))
        knobs.add_argument("--" + item.name.replace("_", "-"), help=f"{default} unless given")
    sweep = parser.add_argument_group("one parameter through a row of values, in place of one set of grasps")
    sweep.add_argument(
        "--sweep",
        metavar="NAME=LOW..HIGH[/COUNT]",
        help="print how many facets, contacts and grasps there are at COUNT values of a parameter (12 unless given), "
        "and draw them; here, bare angles are degrees and bare lengths millimetres: theta_parl=120..175",
    )
    sweep.add_argument(
        "--plot",
        type=Path,
        metavar="PNG",
        help="where the plot goes (PNG, PDF or SVG); MESH.HAND.NAME.png unless given",
    )
    parser.set_defaults(run=_grasps)


def _grasps(options: argparse.Namespace) -> int:
    from ..grasping.parameters import GraspParameters
    from ..grasping.part import Part
    from ..grasping.planner import plan_grasps
    from ..grasping.store import cached_grasps
    from ..robots.hand import Hand
    from ..robots.library import load_hand

    _check_sweep(options)
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
    about = [f"{part.name}: {len(part.mesh.faces)} triangles, {part.mass * 1e3:.4g} g{origin}"]
    about += [f"  {note}" for note in (*part.repairs, *part.warnings)]
    if options.sweep is not None:
        return _sweep(options, part, hand, parameters, about)

    output = options.output or options.mesh.with_suffix(f".{hand.name}.npz")
    grasps = (plan_grasps if options.no_cache else cached_grasps)(part, hand, parameters)
    say("\n".join(about))
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


def _check_sweep(options: argparse.Namespace) -> None:
    """Refuse what has no meaning with ``--sweep``, or none without it."""
    if options.sweep is None:
        if options.plot is not None:
            raise InputError("--plot", "given without --sweep", "give both, or --view for a page")
        return
    name, _ = read_sweep(options.sweep, "--sweep")
    for other in ("output", "view", name):
        if getattr(options, other) is not None:
            raise InputError(f"--{other.replace('_', '-')}", f"given with --sweep {options.sweep}", "leave one out")


def _sweep(options: argparse.Namespace, part: Part, hand: Hand, parameters: GraspParameters, about: list[str]) -> int:
    from .view_regrasp import FORMATS

    name, values = read_sweep(options.sweep, "--sweep")
    plot = options.plot or options.mesh.with_suffix(f".{hand.name}.{name}.png")
    if plot.suffix.lower() not in FORMATS:
        raise InputError("--plot", f"{plot} is no kind of picture that can be drawn", f"end it in {', '.join(FORMATS)}")
    check_writable(plot)
    with progress_line() as progress:
        sweep = swept(part, hand, parameters, name, values, progress)
    say("\n".join([*about, *_table(sweep)]))
    write_file(plot, lambda path: plot_sweep(sweep, path))
    say(f"plot -> {plot}")
    return 0 if sweep.grasps.any() else 1


def _table(sweep: Sweep) -> list[str]:
    """The rows that are printed; triangles are those of a facet, in the mean."""
    columns = {
        sweep.name: [shown(sweep.name, value) for value in sweep.values],
        "facets": [f"{number}" for number in sweep.facets],
        "triangles": [f"{mean:.1f}" for mean in sweep.triangles],
        "contacts": [f"{number}" for number in sweep.contacts],
        "pairs": [] if sweep.pairs is None else [f"{number}" for number in sweep.pairs],
        "grasps": [f"{number}" for number in sweep.grasps],
        "s": [f"{seconds:.2f}" for seconds in sweep.seconds],
    }
    cells = [[head, *column] for head, column in columns.items() if column]
    widths = [max(map(len, column)) + 2 for column in cells]
    return [
        "".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in zip(*cells, strict=True)
    ]


def _parameter(name: str, text: str) -> float:
    place = "--" + name.replace("_", "-")
    if name == "n_da":
        if not text.isdecimal():
            raise InputError(place, f"{text!r} is no whole number", "write one such as 8")
        return int(text)
    return parse_quantity(text, "angle" if usual_unit(name)[0] == "deg" else "length", place)
