"""The command ``kumitate placements``: how a part rests on a plane, and what tilt topples it."""

from __future__ import annotations

import argparse
from math import degrees
from pathlib import Path

from .output import say, write_file

_DENSITY = 1000.0  # kg/m3; the part is evenly filled, so that its weight changes no placement


def add_placements(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "Print the stable placements of a part on a plane, the hardest to topple first."
    parser.add_argument("mesh", type=Path, help="mesh of the part (STL, OBJ, PLY, OFF, GLB)")
    parser.add_argument("--unit", required=True, help="what one unit of the mesh is: mm, cm, m or in")
    parser.add_argument(
        "--view", type=Path, nargs="?", const=Path(), metavar="HTML", help="write a page to look at too"
    )
    parser.set_defaults(run=_placements)


def _placements(options: argparse.Namespace) -> int:
    from ..grasping.part import Part
    from ..regrasp.placements import SMALLEST_MARGIN, find_placements

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
    return 0 if len(placements) else 1
