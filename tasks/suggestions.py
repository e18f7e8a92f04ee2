"""What would help where there is no plan: one thing changed at a time, and every change tried."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import degrees, radians
from pathlib import Path

import msgspec
import numpy as np

from ..errors import KumitateError, PlanningError, TimeLimitError
from ..regrasp.placements import find_placements
from ..robots.library import HANDS
from ..transforms import Array, compose, pose, rotation_about, rpy_from_rotation, transform_points
from .cell import Cell, build_cell
from .deadline import Progress
from .planner import plan
from .reasons import NoPlanError, Report
from .task import At, Mounted, Task

_NEARER = 0.05  # m
_WIDER = 0.3  # m by which a support grows on all sides
_LONGER = 4.0  # times the time limit
_EXACT = 4  # digits of lengths [m] and angles [deg]
Change = tuple[str, Task]  # what it is, in words, and the task with it
_replace = msgspec.structs.replace


def suggestions(
    task: Task,
    folder: str | Path,
    error: PlanningError,
    *,
    seed: int,
    time_limit: float,
    progress: Progress = lambda doing: None,
) -> Iterator[str]:
    """Changes of ``task`` with which there is a verified plan, in words with what to write; each has been tried.

    Args:
        task: The task, which has no plan.
        folder: Where its relative paths start.
        error: Why it has none.
        seed: Seed of all samples and searches.
        time_limit: Bound on the time of each try [s].
        progress: Called with words on what is being tried.
    """
    if isinstance(error, TimeLimitError):
        longer = _LONGER * time_limit
        if _plans(task, folder, seed, longer, progress):
            yield f"with {longer:g} s of time there is a plan"
        return
    report = error.report if isinstance(error, NoPlanError) else Report(None, str(error), ())
    for alternatives in _changes(task, build_cell(task, folder), report):
        for words, changed in alternatives:
            progress(f"whether there is a plan {words}")
            if _plans(changed, folder, seed, time_limit, lambda doing: None):
                yield f"{words} there is a plan"
                break


def _plans(task: Task, folder: str | Path, seed: int, time_limit: float, progress: Progress) -> bool:
    try:
        plan(task, folder, seed=seed, time_limit=time_limit, progress=progress)
    except KumitateError:
        return False
    return True


def _changes(task: Task, cell: Cell, report: Report) -> Iterator[Iterable[Change]]:
    """Changes of one thing each, the likeliest to help first; of alternatives the first that helps will do."""
    named = _named_parts(task)
    parts = [part for part in named if part in _concerned(task, report)] or list(named)
    yield from ([change] for change in _without(task, report, named))
    for part in parts:
        yield from ([change] for change in _nearer(task, cell, part))
    yield from (_with_hand(task, hand) for hand in HANDS)
    yield from (_otherwise(task, cell, part) for part in parts)
    yield from ([change] for change in _wider(task))


def _without(task: Task, report: Report, named: Mapping[str, None]) -> Iterator[Change]:
    """Without each obstacle, and each part that no goal speaks of, that is in the way, the gravest first."""
    met = [body for cause, _ in report.causes for body in cause.bodies]
    met += [body for attempt in report.attempts for body in attempt.bodies]
    met += [body for entry in report.diagnoses if not entry.works for cause in entry.each for body in cause.bodies]
    obstacles = [entry.name for entry in task.cell]
    for name in dict.fromkeys(body for body in met if body in obstacles or (body in task.parts and body not in named)):
        kept = tuple(entry for entry in task.cell if entry.name != name)
        parts = {part: entry for part, entry in task.parts.items() if part != name}
        kind = "obstacle" if name in obstacles else "part"
        yield f"without the {kind} {name}", _replace(task, cell=kept, parts=parts)


def _nearer(task: Task, cell: Cell, part: str) -> Iterator[Change]:
    """With the start of ``part``, or its goal, nearer to the hand whose home is nearest."""
    entry = task.parts[part]
    at = _moved(cell, entry.at)
    yield f"with {part} {1e2 * _NEARER:g} cm nearer ({_xyz(at)})", _with_part(task, part, at)
    for i, goal in enumerate(task.goals):
        wanted = goal.place or goal.hand_over
        if wanted is not None and wanted.part == part and wanted.at is not None:
            at = _moved(cell, wanted.at)
            kind = "place" if goal.place is not None else "hand_over"
            changed = _replace(goal, **{kind: _replace(wanted, at=at)})
            goals = (*task.goals[:i], changed, *task.goals[i + 1 :])
            yield f"with goal {i + 1} {1e2 * _NEARER:g} cm nearer ({_xyz(at)})", _replace(task, goals=goals)


def _moved(cell: Cell, at: At) -> At:
    """``at``, level and nearer to the nearest hand at home."""
    here = np.asarray(at.xyz, dtype=float)
    hands = [cell.robot.hand_pose(arm, cell.robot.home)[:3, 3] for arm in cell.robot.hands]
    way = min((hand - here for hand in hands), key=lambda way: float(np.linalg.norm(way[:2])))[:2]
    length = float(np.linalg.norm(way))
    x, y = here[:2] + min(_NEARER / max(length, 1e-9), 1.0) * way
    return _replace(at, xyz=(_round(x, _EXACT), _round(y, _EXACT), at.xyz[2]))


def _with_hand(task: Task, hand: str) -> Iterator[Change]:
    """With a shipped hand on one of the arms that have another, or on all of them."""
    now = {arm: entry.hand if isinstance(entry, Mounted) else entry for arm, entry in task.hands.items()}
    others = [arm for arm in now if now[arm] != hand]
    for arms in dict.fromkeys([*((arm,) for arm in others), tuple(others)] if others else []):
        changed = _replace(task, hands={**task.hands, **dict.fromkeys(arms, hand)})
        yield f"with {hand} on {' and '.join(arms)}", changed


def _otherwise(task: Task, cell: Cell, part: str) -> Iterator[Change]:
    """With ``part`` standing otherwise at its start, above the same place."""
    world_from_part = pose(task.parts[part].at.xyz, task.parts[part].at.rpy)
    center = transform_points(world_from_part, cell.parts[part].center_of_mass[None])[0]
    bottom = transform_points(world_from_part, cell.parts[part].mesh.vertices)[:, 2].min()
    for surface_from_part in find_placements(cell.parts[part]).surface_from_part:
        if surface_from_part[2, :3] @ world_from_part[2, :3] > 1.0 - 1e-3:
            continue
        for turn in (0.0, np.pi / 2.0):
            there = compose(rotation_about([0.0, 0.0, 1.0], turn), [*center[:2], bottom]) @ surface_from_part
            at = _at(there)
            yield f"with {part} standing otherwise ({_pose(at)})", _with_part(task, part, at)


def _wider(task: Task) -> Iterator[Change]:
    """With free room around each support that is a box, as far as nothing stands there."""
    for i, entry in enumerate(task.cell):
        if entry.support and entry.box is not None:
            x, y, z = (float(side) for side in entry.box)
            box = (_round(x + 2.0 * _WIDER, _EXACT), _round(y + 2.0 * _WIDER, _EXACT), z)
            cells = (*task.cell[:i], _replace(entry, box=box), *task.cell[i + 1 :])
            words = f"with {1e2 * _WIDER:g} cm more of {entry.name} on all sides (box: {_listed(box)})"
            yield words, _replace(task, cell=cells)


def _named_parts(task: Task) -> dict[str, None]:
    """The parts that goals speak of, in their order."""
    parts: dict[str, None] = {}
    for asked in (goal.asked for goal in task.goals):
        names = (asked.part, getattr(asked, "to", None), getattr(asked, "of", None))
        parts.update(dict.fromkeys(name for name in names if name in task.parts))
    return parts


def _concerned(task: Task, report: Report) -> set[str]:
    """The parts at which nothing works, or of the goal that is not reached."""
    failing = {entry.part for entry in report.diagnoses if not entry.works}
    if failing or report.goal is None:
        return failing
    return set(_named_parts(_replace(task, goals=(task.goals[report.goal],))))


def _with_part(task: Task, part: str, at: At) -> Task:
    return _replace(task, parts={**task.parts, part: _replace(task.parts[part], at=at)})


def _at(world_from_part: Array) -> At:
    """The entry of a task for a pose (4, 4), as exact as it is shown."""
    x, y, z = (_round(v, _EXACT) for v in world_from_part[:3, 3])
    roll, pitch, yaw = (radians(_round(degrees(v), _EXACT)) for v in rpy_from_rotation(world_from_part[:3, :3]))
    return At((x, y, z), (roll, pitch, yaw))


def _round(value: float, digits: int) -> float:
    return round(float(value), digits) + 0.0  # no zero with a sign


def _listed(lengths: Iterable[float]) -> str:
    return f"[{', '.join(f'{float(length):g}' for length in lengths)}]"


def _xyz(at: At) -> str:
    """A position as a task file has it."""
    return f"xyz: {_listed(at.xyz)}"


def _pose(at: At) -> str:
    """A pose as a task file has it."""
    return f"{_xyz(at)}, rpy: [{', '.join(f'{degrees(v):g} deg' for v in at.rpy)}]"
