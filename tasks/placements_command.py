"""The command ``kumitate placements``: how a part rests on a plane, and what tilt topples it."""

from __future__ import annotations

import argparse
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .output import say, write_file

if TYPE_CHECKING:
    from ..grasping.part import Part
    from ..regrasp.placements import Placements

_DENSITY = 1000.0  # kg/m3; the part is evenly filled, so that its weight changes no placement


def add_placements(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "Print the stable placements of a part on a plane, the hardest to topple first."
    parser.add_argument("mesh", type=Path, help="mesh of the part (STL, OBJ, PLY, OFF, GLB)")
    parser.add_argument("--unit", required=True, help="what one unit of the mesh is: mm, cm, m or in")
    parser.add_argument(
        "--view", type=Path, nargs="?", const=Path(), metavar="HTML", help="write a page to look at too"
    )
    parser.add_argument("--hand", help="a shipped hand, or the YAML file of your own, for --graph")
    parser.add_argument(
        "--graph",
        type=Path,
        metavar="PNG",
        help="draw the placements and how many grasps of the hand each two share, on a bare plane (PNG, PDF or SVG)",
    )
    parser.set_defaults(run=_placements)


def _placements(options: argparse.Namespace) -> int:
    from ..grasping.part import Part
    from ..regrasp.placements import SMALLEST_MARGIN, find_placements

    if (options.hand is None) != (options.graph is None):
        given, missing = ("--hand", "--graph") if options.graph is None else ("--graph", "--hand")
        raise InputError(given, f"given without {missing}", "give both or neither")
    part = Part.load(options.mesh, unit=options.unit, density=_DENSITY)
    placements = find_placements(part)
    say(f"{part.name}: {len(part.mesh.faces)} triangles")
    for note in (*part.repairs, *part.warnings):
        say(f"  {note}")
    say(f"{'placement':<12}{'margin deg':>12}{'height mm':>12}{'base mm2':>12}{'share %':>10}")
    numbers = zip(placements.margin, placements.height, placements.support.area, placements.share, strict=True)
    for i, (margin, height, area, share) in enumerate(numbers, start=1):
        say(f"{i:<12}{degrees(margin):>12.1f}{height * 1e3:>12.1f}{area * 1e6:>12.0f}{share * 100:>10.1f}")
    say(f"{len(placements)} stable placements with a margin of at least {degrees(SMALLEST_MARGIN):g} deg")
    if options.view is not None:
        from .view_placements import write_placement_page

        page = options.view if options.view.name else options.mesh.with_suffix(".placements.html")
        write_file(page, lambda path: write_placement_page(path, part, placements))
        say(f"view -> {page}")
    if options.graph is not None:
        _draw(options.graph, part, placements, options.hand)
    return 0 if len(placements) else 1


def _draw(path: Path, part: Part, placements: Placements, name: str) -> None:
    from ..grasping.store import cached_grasps
    from ..robots.hand import Hand
    from ..robots.library import load_hand
    from .view_regrasp import FORMATS, feasible, shared_graph, write_regrasp_picture

    if path.suffix.lower() not in FORMATS:
        raise InputError(
            "--graph", f"{path} is no kind of picture that can be drawn", f"end it in {', '.join(FORMATS)}"
        )
    hand = Hand.load(name) if Path(name).suffix in (".yaml", ".yml") else load_hand(name)
    grasps = cached_grasps(part, hand)
    graph = shared_graph(feasible(hand, grasps, placements))
    title = f"{part.name}: {len(grasps)} grasps by {hand.name} at {_DENSITY:g} kg/m3"
    write_file(path, lambda beside: write_regrasp_picture(beside, part, placements, graph, title))
    pairs = len(placements) * (len(placements) - 1) // 2
    say(f"{title}; {graph.number_of_edges()} of {pairs} pairs of placements share some")
    say(f"graph -> {path}")
