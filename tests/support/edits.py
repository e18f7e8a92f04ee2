"""What mutations of plans are made of: looking for an action, and changing a plan in one place."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from msgspec.structs import replace

from kumitate.tasks.document import Motion, Plan, State, matrix
from kumitate.transforms import Array


def kinds(plan: Plan, *wanted: str) -> list[int]:
    """Numbers of the actions of these kinds."""
    return [i for i, action in enumerate(plan.actions) if action.kind in wanted]


def with_action(plan: Plan, i: int, **changes: object) -> Plan:
    return replace(plan, actions=(*plan.actions[:i], replace(plan.actions[i], **changes), *plan.actions[i + 1 :]))


def with_motion(plan: Plan, i: int, **changes: object) -> Plan:
    return with_action(plan, i, motion=replace(plan.actions[i].motion, **changes))


def with_sample(plan: Plan, i: int, at: int, **row: Iterable[float]) -> Plan:
    """Another row of positions or velocities in action ``i``."""
    changes = {}
    for name, values in row.items():
        rows = list(getattr(plan.actions[i].motion, name))
        rows[at] = tuple(float(x) for x in values)
        changes[name] = tuple(rows)
    return with_motion(plan, i, **changes)


def with_part(plan: Plan, part: str, **changes: object) -> Plan:
    entry = {**plan.task["parts"][part], **changes}
    return replace(plan, task={**plan.task, "parts": {**plan.task["parts"], part: entry}})


def with_goal(plan: Plan, number: int, kind: str, **changes: object) -> Plan:
    goals = list(plan.task["goals"])
    goals[number] = {kind: {**goals[number][kind], **changes}}
    return replace(plan, task={**plan.task, "goals": goals})


def with_states(plan: Plan, first: int, change: Callable[[State], State], last: int | None = None) -> Plan:
    """Other states from the end of action ``first`` to the start of the one after ``last``."""
    actions = list(plan.actions)
    end = len(actions) if last is None else last + 1
    for i in range(first, end):
        start = actions[i].start if i == first else change(actions[i].start)
        actions[i] = replace(actions[i], start=start, end=change(actions[i].end))
    if end < len(actions):
        actions[end] = replace(actions[end], start=change(actions[end].start))
    return replace(plan, actions=tuple(actions))


def faster(motion: Motion, factor: float) -> Motion:
    """The same curve in a fraction of the time."""
    times = tuple(time / factor for time in motion.times)
    velocities = tuple(tuple(factor * v for v in row) for row in motion.velocities)
    rates = {arm: tuple(factor * v for v in row) for arm, row in motion.opening_velocities.items()}
    return replace(motion, times=times, velocities=velocities, opening_velocities=rates)


def detour(motion: Motion, q: Array) -> Motion:
    """Before the motion one to ``q`` and back, at ease."""
    start, still = motion.positions[0], (0.0,) * len(motion.positions[0])
    times = (0.0, 3.0, *(6.0 + time for time in motion.times))
    return Motion(
        times=times,
        positions=(start, tuple(q.tolist()), *motion.positions),
        velocities=(still, still, *motion.velocities),
        openings={arm: (row[0], row[0], *row) for arm, row in motion.openings.items()},
        opening_velocities={arm: (0.0, 0.0, *row) for arm, row in motion.opening_velocities.items()},
    )


def beyond(plan: Plan, i: int, share: float) -> Plan:
    """Action ``i``, but first a part of its way in the opposite direction and back."""
    motion = plan.actions[i].motion
    start, end = np.array(motion.positions[0]), np.array(motion.positions[-1])
    events = tuple(replace(event, time=event.time + 6.0) for event in plan.actions[i].events)
    return with_action(plan, i, motion=detour(motion, start - share * (end - start)), events=events)


def moved(where: object, shift: Array) -> object:
    return matrix(shift @ np.array(where))


def taking(plan: Plan) -> tuple[int, str, str]:
    """The first action in which a hand takes a part, the part and the arm."""
    for i in kinds(plan, "close"):
        for event in plan.actions[i].events:
            return i, event.part, event.carrier
    raise AssertionError("no hand takes a part")


def letting_go(plan: Plan) -> tuple[int, str, str]:
    """The last action in which a hand lets a part go that stands then, the part and the arm."""
    for i in reversed(kinds(plan, "open")):
        for event in plan.actions[i].events:
            if event.part not in plan.actions[i].end.attached:
                return i, event.part, event.carrier
    raise AssertionError("no hand puts a part down")
