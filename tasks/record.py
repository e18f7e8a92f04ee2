"""Writing a job down: its steps as the actions of a plan document."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..grasping.grasps import GraspSet
from ..regrasp.steps import Step
from ..robots.scene import Scene
from ..robots.state import SceneState
from .document import Action, Carried, Event, GraspUse, Motion, State, matrix


def actions_of(scene: Scene, steps: Sequence[Step], goals: Sequence[int | None]) -> tuple[Action, ...]:
    """The actions that ``steps`` are, each working for the goal of its number."""
    return tuple(_action(scene, step, goal) for step, goal in zip(steps, goals, strict=True))


def _action(scene: Scene, step: Step, goal: int | None) -> Action:
    duration = step.trajectory.duration
    return Action(
        kind=step.kind,
        arms=step.arms,
        words=step.words,
        part=step.part,
        start=_state(scene, step.start),
        motion=_motion(step),
        events=tuple(Event(duration if e.at_end else 0.0, e.kind, e.part, e.carrier) for e in step.events),
        grasp=None if step.grasp is None else _grasp(step.grasp),
        goal=goal,
        end=_state(scene, step.end),
    )


def _state(scene: Scene, state: SceneState) -> State:
    return State(
        q=tuple(float(x) for x in state.q),
        openings={arm: float(opening) for arm, opening in state.openings.items()},
        poses={
            name: matrix(scene.world_from_body(state, name)) for name, body in scene.bodies.items() if not body.fixed
        },
        attached={
            name: Carried(entry.carrier, matrix(entry.carrier_from_body)) for name, entry in state.attached.items()
        },
    )


def _motion(step: Step) -> Motion:
    trajectory = step.trajectory
    ends = {arm: (opening, opening) for arm, opening in step.start.openings.items()}
    ends.update(step.openings)
    # From rest to rest over the whole step; a hand that moves does so between two samples.
    shares = np.linspace(0.0, 1.0, len(trajectory.times))
    still = tuple(0.0 for _ in trajectory.times)
    return Motion(
        times=tuple(trajectory.times.tolist()),
        positions=tuple(tuple(row) for row in trajectory.positions.tolist()),
        velocities=tuple(tuple(row) for row in trajectory.velocities.tolist()),
        openings={arm: tuple((a + shares * (b - a)).tolist()) for arm, (a, b) in ends.items()},
        opening_velocities=dict.fromkeys(ends, still),
    )


def _grasp(row: GraspSet) -> GraspUse:
    return GraspUse(
        part_from_hand=matrix(row.part_from_hand[0]),
        opening=float(row.opening[0]),
        approach_opening=float(row.approach_opening[0]),
        contacts=tuple((float(x), float(y), float(z)) for x, y, z in row.contacts[0]),
        normals=tuple((float(x), float(y), float(z)) for x, y, z in row.normals[0]),
        force=float(row.force[0]),
    )
