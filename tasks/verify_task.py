"""The task of a plan document, as the verifier reads it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import msgspec
import numpy as np

from ..errors import InputError
from .task import Attach, Axis, Goal, HandOver, Insert, Place, Task, Use

_CURE = "give the plan as `kumitate plan` wrote it"


def read_task(builtins: Mapping[str, Any]) -> Task:
    """The task of a plan document, in which every quantity is a number.

    Raises:
        InputError: It is no task, names what it does not have, or says what means nothing.
    """
    try:
        task = msgspec.convert(builtins, Task, dec_hook=lambda kind, value: kind(value))
    except (msgspec.ValidationError, ValueError, TypeError) as error:
        raise _refused(f"no task ({error})") from error
    for goal in task.goals:
        _check_goal(goal, task)
    weights = [weight for part in task.parts.values() for weight in (part.mass, part.density) if weight is not None]
    if not all(weight > 0.0 for weight in weights):
        raise _refused("a part weighs nothing")
    if not all(side > 0.0 for part in task.parts.values() for region in part.no_touch for side in region.box):
        raise _refused("a region that no hand may touch is empty")
    if not 0.0 < task.speed <= 1.0:
        raise _refused(f"the speed is {task.speed}, no share of the limits")
    names = [*task.parts, *(entry.name for entry in task.cell), *task.hands]
    if len(set(names)) < len(names):
        raise _refused(f"a name is taken: {names}")
    return task


def _check_goal(goal: Goal, task: Task) -> None:
    """A goal is one, of parts, arms, obstacles and frames that there are, with axes and ways that are some."""
    bodies = {*task.parts, *(entry.name for entry in task.cell)}
    match goal.attach, goal.place, goal.hand_over, goal.use:
        case Attach() as attach, None, None, None:
            _known({attach.part, attach.to}, task.parts)
            _known({attach.arm, attach.to_arm}, task.hands)
            _check_way(attach.part, attach.insert)
        case None, Place() as place, None, None:
            _known({place.part}, task.parts)
            _known({place.arm}, task.hands)
            _check_axes(place.any_turn)
            if (place.at is None) == (place.area is None):
                raise _refused(f"{place.part} has not one place, a pose or an area")
            if place.area is not None:
                _known({place.area.on}, bodies - set(task.parts))
                _check_axes(place.area.up)
                if place.area.corners is not None and not np.ptp(place.area.corners, axis=0).all():
                    raise _refused(f"the area of {place.part} is empty")
        case None, None, HandOver() as hand_over, None:
            _known({hand_over.part}, task.parts)
            _known({hand_over.to}, task.hands)
            _check_axes(hand_over.any_turn)
        case None, None, None, Use() as use:
            _known({use.part}, task.parts)
            _known({use.arm}, task.hands)
            _known({use.of}, bodies - {use.part})
            _known({use.frame}, task.parts[use.part].frames)
            _check_axes(use.any_turn)
            _check_way(use.part, use.approach)
        case _:
            raise _refused("a goal is not one of attach, place, hand_over, use")


def _check_way(part: str, way: Insert) -> None:
    _check_axes(way.direction)
    if way.distance <= 0.0:
        raise _refused(f"{part} has no way to go")


def _check_axes(axis: Axis | None) -> None:
    if axis is not None and not (np.isfinite(axis).all() and any(axis)):
        raise _refused(f"{axis} is no direction")


def _known(names: Collection[str | None], there: Collection[str]) -> None:
    odd = sorted(name for name in names if name is not None and name not in there)
    if odd:
        raise _refused(f"a name is unknown: {', '.join(odd)}")


def _refused(problem: str) -> InputError:
    return InputError("plan: task", problem, _CURE)
