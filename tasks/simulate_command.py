"""The command ``kumitate simulate``: how well the grasps of a part hold, and how far the part moves, in physics."""

from __future__ import annotations

import argparse
from dataclasses import replace
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .grasp_options import add_grasp_options, plot_path, read_grasp_options, whole_number
from .output import check_writable, progress_line, say, say_json, write_file
from .quantities import parse_quantity

if TYPE_CHECKING:
    from ..grasping.grasps import GraspSet
    from ..physics.trials import Trials
    from ..transforms import Array

_CURE = "run: pip install 'kumitate[sim]'"
_QUARTERS = 4
_QUANTILES = {"median": 0.5, "p95": 0.95, "largest": 1.0}


def add_simulate(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = (
        "Try the grasps of a part in physics: it lies on a table, the hand closes, lifts it and is shaken. Prints how"
        " many held and how far the part moved, and writes the grasps with what was measured. Ends with 1 when there"
        " is no grasp to try."
    )
    add_grasp_options(parser)
    parser.add_argument(
        "--count", help="try at most so many grasps, evenly from best to worst; all that can be tried unless given"
    )
    parser.add_argument(
        "--off", default="0 mm", help='the hand stands off by up to this at random, such as "1 mm"; not unless given'
    )
    parser.add_argument(
        "--output",
        type=Path,
        metavar="NPZ",
        help="where the grasps go; MESH.HAND.simulated.npz beside the mesh unless given",
    )
    parser.add_argument(
        "--plot", type=Path, metavar="PNG", help="where the plot goes (PNG, PDF or SVG); beside the grasps unless given"
    )
    parser.add_argument("--json", action="store_true", help="print the answer for programs")
    parser.set_defaults(run=_simulate)


def _simulate(options: argparse.Namespace) -> int:
    _need_physics()
    from ..grasping.store import cached_grasps
    from ..physics.chart import plot_trials
    from ..physics.trials import on_the_table, run_trials
    from ..regrasp.placements import find_placements

    count, off = _count(options.count), _off(options.off)
    asked = read_grasp_options(options)
    output = options.output or options.mesh.with_suffix(f".{asked.hand.name}.simulated.npz")
    plot = plot_path(options, output.with_suffix(".png"))
    if len({path.resolve() for path in (options.mesh, output, plot)}) < 3:
        raise InputError("--output", "mesh, grasps and plot are not three files", "name every file differently")
    check_writable(output)
    tell = (lambda line: None) if options.json else say
    for line in asked.about:
        tell(line)
    with progress_line() as progress:
        progress("grasps")
        grasps = cached_grasps(asked.part, asked.hand, asked.parameters)
        progress("placements")
        placements = find_placements(asked.part)
        there = on_the_table(asked.hand, grasps, placements)
        answer = {"grasps": len(grasps), "placements": len(placements)}
        answer |= {"upright": int(there.upright.sum()), "possible": len(there.grasp)}
        tell(f"{len(grasps)} grasps by {asked.hand.name}, {len(placements)} stable placements")
        if not len(there.grasp):
            because = _nothing_to_try(answer)
            tell(f"nothing to try: {because}")
            if options.json:
                say_json({**answer, "tried": 0, "because": because})
            return 1
        trials = run_trials(
            asked.part, asked.hand, grasps, placements, count=count, off=off,
            progress=lambda done, of: progress(f"trial {done + 1} of {of}"),
        )  # fmt: skip
    answer |= _measures(trials, grasps)
    for line in _lines(answer):
        tell(line)
    measured = replace(grasps, measured=trials.measured(len(grasps)))
    write_file(output, measured.save)
    write_file(plot, lambda path: plot_trials(trials, grasps, path))
    tell(f"grasps -> {output}")
    tell(f"plot -> {plot}")
    if options.json:
        say_json({**answer, "output": str(output), "plot": str(plot)})
    return 0


def _need_physics() -> None:
    """Check, before any work, that there is what the trials run in: no other command needs it."""
    try:
        import manifold3d  # noqa: F401
        import mujoco  # noqa: F401
    except ImportError as error:
        raise InputError("simulate", f"needs MuJoCo and Manifold ({error})", _CURE) from error


def _count(text: str | None) -> int | None:
    count = None if text is None else whole_number(text, "--count")
    if count == 0:
        raise InputError("--count", "none would be tried", "give at least 1")
    return count


def _off(text: str) -> float:
    off = parse_quantity(text, "length", "--off")
    if off < 0.0:
        raise InputError("--off", f"{text!r} is negative", 'give a length such as "1 mm"')
    return off


def _nothing_to_try(counts: dict[str, Any]) -> str:
    if not counts["grasps"]:
        return "there is no grasp"
    if not counts["placements"]:
        return "the part has no stable placement"
    if not counts["upright"]:
        return "no grasp approaches within 40 deg of the vertical"
    return f"the hand meets the table in each of the {counts['upright']} grasps within 40 deg of the vertical"


def _measures(trials: Trials, grasps: GraspSet) -> dict[str, Any]:
    """What the trials say [m, rad, s]: how many held, how the part moved in those that did, and which ones failed."""
    import numpy as np

    held, run = trials.held, trials.seconds > 0.0
    quarters = np.array_split(np.argsort(grasps.quality[trials.grasp], kind="stable"), _QUARTERS)
    dx, dy = np.abs(trials.shift[held, :2]).max(axis=0, initial=0.0)
    return {
        "tried": len(trials),
        "simulated": int(run.sum()),
        "lifted": int(trials.lifted.sum()),
        "held": int(held.sum()),
        "displacement": _quantiles(trials.displacement[held]),
        "dx": float(dx),
        "dy": float(dy),
        "turn": _quantiles(trials.turn[held]),
        "slip": _quantiles(trials.slip[held]),
        "quarters": [{"tried": len(chosen), "failed": int((~held[chosen]).sum())} for chosen in quarters],
        "seconds": float(trials.seconds[run].mean()),
    }


def _quantiles(values: Array) -> dict[str, float]:
    """Median, 95 % quantile and the largest of some values; 0 of none."""
    import numpy as np

    return {name: float(np.quantile(values, share)) if len(values) else 0.0 for name, share in _QUANTILES.items()}


def _lines(answer: dict[str, Any]) -> list[str]:
    """The answer for people."""
    lines = [
        f"{answer['upright']} approach within 40 deg of the vertical, {answer['possible']} of them clear of the table",
        f"{answer['tried']} tried, {answer['lifted']} lifted, {answer['held']} held after shaking",
        f"{'of those held':<18}{'median':>10}{'95 %':>10}{'largest':>10}",
    ]
    for name, unit, per in (("displacement", "mm", 1e3), ("turn", "deg", degrees(1.0)), ("slip", "mm", 1e3)):
        lines.append(f"{f'{name} {unit}':<18}" + "".join(f"{value * per:>10.3f}" for value in answer[name].values()))
    quarters = ", ".join(f"{quarter['failed']} of {quarter['tried']}" for quarter in answer["quarters"])
    twins = answer["tried"] - answer["simulated"]
    return [
        *lines,
        f"largest |dx| {answer['dx'] * 1e3:.3f} mm, largest |dy| {answer['dy'] * 1e3:.3f} mm",
        f"failures by quarter of the quality, the lowest first: {quarters}",
        f"{answer['seconds']:.2f} s a trial" + f"; for {twins} another tells, with the hand turned round" * (twins > 0),
    ]
