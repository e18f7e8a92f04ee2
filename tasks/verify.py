"""An independent check of plans.

It shares nothing with the planner but the plan document and the task's structures: kinematics are read off the URDF,
who carries what follows from the plan's own events, and python-fcl looks at full triangle meshes.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from ..errors import InputError
from ..transforms import checked_pose
from .document import FORMAT, Action, Plan, State
from .models import model_digests
from .verify_cell import Cell, read_cell
from .verify_faults import FAULTS, Fault, Findings, Verification
from .verify_goals import Goals
from .verify_holds import follow
from .verify_motion import Curve, check_motions
from .verify_rest import Resting
from .verify_sweep import Sweeper

__all__ = ["FAULTS", "Fault", "Verification", "verify"]


def verify(plan: Plan) -> Verification:
    """Check that a plan does what its task asks, within all limits and free of collision.

    All kinds of faults are looked for, whatever was found before; only where the document itself is malformed nothing
    else can be looked at.

    Raises:
        InputError: The plan's task is none, or a file of its robot or hands is missing or cannot be read.
    """
    started = perf_counter()
    findings = Findings()
    cell = read_cell(plan, findings)
    if cell is None or not _well_formed(plan, cell, findings):
        return Verification(findings.faults, np.inf, (), 0, 0, perf_counter() - started)
    _check_models(plan, findings)
    curves = [Curve.of(action, cell) for action in plan.actions]
    check_motions(plan, cell, curves, findings)
    stretches, ends = follow(plan, cell, curves, findings)
    sweeper, resting = Sweeper(plan, cell, findings), Resting(cell, findings)
    sweeper.look_inside(stretches[0], curves[0])
    for stretch in stretches:
        sweeper.look(stretch, curves[stretch.action])
    for end in ends:
        resting.look(end, curves[end.action])
    Goals(plan, cell, curves, ends, findings).check()
    return Verification(
        faults=findings.faults,
        clearance=sweeper.clearance,
        nearest=sweeper.nearest,
        samples=sweeper.samples,
        distances=cell.solids.count,
        seconds=perf_counter() - started,
    )


def _check_models(plan: Plan, findings: Findings) -> None:
    now = model_digests(plan.task, Path(plan.folder))
    changed = sorted(name for name in now.keys() | plan.digests.keys() if now.get(name) != plan.digests.get(name))
    if changed:
        findings.add("models", f"not those that the plan was made with: {', '.join(changed)}", bodies=changed)


def _well_formed(plan: Plan, cell: Cell, findings: Findings) -> bool:
    """Whether every array has its length and every name exists, so that the rest can be looked at."""
    before = len(findings)
    if plan.format != FORMAT:
        findings.add("format", f"format {plan.format}, and this version reads {FORMAT}")
    if not plan.actions:
        findings.add("format", "there is no action")
    for i, action in enumerate(plan.actions):
        for name, words in _malformed(action, cell):
            findings.add(name, words, action=i)
    return len(findings) == before


def _malformed(action: Action, cell: Cell) -> Iterator[tuple[str, str]]:
    """Names and words of what keeps an action from being looked at."""
    arms, parts = cell.machine.arms, cell.task.parts
    carriers = {*cell.hands, *parts}
    named = set(action.arms) - set(arms) | {event.part for event in action.events} - set(parts)
    named |= {event.carrier for event in action.events} - carriers
    named |= {action.part or ""} - {"", *parts}
    if named or not 0 < len(set(action.arms)) == len(action.arms):
        yield "names", f"unknown: {', '.join(sorted(named))}" if named else "no arm is named, or one twice"
    if action.goal is not None and not 0 <= action.goal < len(cell.task.goals):
        yield "names", f"there is no goal {action.goal}"
    for what, state in (("start", action.start), ("end", action.end)):
        yield from _malformed_state(what, state, cell)
    motion = action.motion
    times, count = np.array(motion.times, dtype=float), len(motion.times)
    if not count or times[0] != 0.0 or not (np.diff(times) > 0.0).all() or not np.isfinite(times).all():
        yield "times", "they do not increase from 0"
        return
    when = [event.time for event in action.events]
    if when != sorted(when) or not all(0.0 <= time <= times[-1] for time in when):
        yield "times", f"events at {when} s in an action of {times[-1]} s"
    for what, rows in (("positions", motion.positions), ("velocities", motion.velocities)):
        if len(rows) != count or any(len(row) != len(cell.order) for row in rows) or not _finite(rows):
            yield "format", f"{what} are not {count} rows of {len(cell.order)} finite numbers"
    for what, table in (("openings", motion.openings), ("opening velocities", motion.opening_velocities)):
        if set(table) != set(cell.hands):
            yield "names", f"{what} of {sorted(table)}, the hands are {sorted(cell.hands)}"
        elif any(len(row) != count for row in table.values()) or not _finite(list(table.values())):
            yield "format", f"{what} are not {count} finite numbers each"
    if action.grasp is not None:
        numbers = [action.grasp.opening, action.grasp.approach_opening, action.grasp.force]
        if not _finite(numbers) or not _is_pose(action.grasp.part_from_hand):
            yield "format", "the grasp has a number that is not finite, or a matrix that is no pose"


def _malformed_state(what: str, state: State, cell: Cell) -> Iterator[tuple[str, str]]:
    parts = set(cell.task.parts)
    if len(state.q) != len(cell.order) or not _finite(state.q) or not _finite(list(state.openings.values())):
        yield "format", f"the {what} state has {len(state.q)} joints for {len(cell.order)}, or numbers not finite"
    if set(state.openings) != set(cell.hands) or set(state.poses) != parts or not set(state.attached) <= parts:
        yield "names", f"the {what} state does not have the task's hands and parts"
    odd = {entry.carrier for entry in state.attached.values()} - {*cell.hands, *parts}
    if odd:
        yield "names", f"unknown carriers in the {what} state: {', '.join(sorted(odd))}"
    matrices = [*state.poses.values(), *(entry.carrier_from_part for entry in state.attached.values())]
    if not all(_is_pose(entry) for entry in matrices):
        yield "format", f"a matrix of the {what} state is no pose"


def _finite(numbers: Any) -> bool:
    try:
        return bool(np.isfinite(np.array(numbers, dtype=float)).all())
    except (ValueError, TypeError):
        return False


def _is_pose(matrix: Any) -> bool:
    try:
        checked_pose(matrix, "")
    except InputError:
        return False
    return True
