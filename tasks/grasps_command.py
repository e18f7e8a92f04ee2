"""The command ``kumitate grasps``: the grasps of a part by a hand, and what each stage of their planning dropped."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import InputError
from .grasp_options import Request, add_grasp_options, plot_path, read_grasp_options
from .grasps_sweep import Sweep, plot_sweep, read_sweep, shown, swept
from .output import progress_line, say, write_file


def add_grasps(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "Plan the grasps of a part, print what each stage kept, and write them to an .npz file."
    add_grasp_options(parser)
    parser.add_argument("--output", type=Path, help="where the grasps go; MESH.HAND.npz beside the mesh unless given")
    parser.add_argument(
        "--view", type=Path, nargs="?", const=Path(), metavar="HTML", help="write a page to look at too"
    )
    parser.add_argument("--no-cache", action="store_true", help="plan even if these grasps are in the cache")
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
    from ..grasping.planner import plan_grasps
    from ..grasping.store import cached_grasps

    _check_sweep(options)
    asked = read_grasp_options(options)
    part, hand, parameters = asked.part, asked.hand, asked.parameters
    if options.sweep is not None:
        return _sweep(options, asked)

    output = options.output or options.mesh.with_suffix(f".{hand.name}.npz")
    grasps = (plan_grasps if options.no_cache else cached_grasps)(part, hand, parameters)
    say("\n".join(asked.about))
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


def _sweep(options: argparse.Namespace, asked: Request) -> int:
    name, values = read_sweep(options.sweep, "--sweep")
    plot = plot_path(options, options.mesh.with_suffix(f".{asked.hand.name}.{name}.png"))
    with progress_line() as progress:
        sweep = swept(asked.part, asked.hand, asked.parameters, name, values, progress)
    say("\n".join([*asked.about, *_table(sweep)]))
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
