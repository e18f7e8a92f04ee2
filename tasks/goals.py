"""The goals that bring one part somewhere: to a pose on a support, to an arm, down after an assembly; and home."""

from __future__ import annotations

import numpy as np

from ..regrasp.graph import Goal
from ..regrasp.nodes import spots_for
from ..regrasp.placements import find_placements
from .interlock import hand_over_interlocked
from .job import Job, any_grasp
from .meetings import same_pose
from .targets import hold_nodes, lies_in, place_nodes
from .task import HandOver, Place

_MOST_SPOTS = 24  # where an assembly may be put down


def place(job: Job, goal: Place) -> None:
    """Put the part of ``goal`` down where it may be.

    Raises:
        InputError: Nothing is there that the part could rest on.
        NoRegraspError: There is no way.
    """
    part = job.root(goal.part)
    if goal.area is not None and lies_in(job, goal.part, goal.area):
        return
    nodes = place_nodes(job, goal)
    if job.rests_on(part) is not None and any(same_pose(job.pose(part), node.world_from_part) for node in nodes):
        return
    graph = job.graph(part, nodes)
    job.bring(graph, [Goal(node, any_grasp(graph, goal.arm)) for node in nodes])


def hand_over(job: Job, goal: HandOver) -> None:
    """Give the part of ``goal`` to an arm, which ends holding it at a pose.

    Raises:
        InputError: The hands shall interlock, and cannot.
        NoRegraspError: There is no way.
    """
    if goal.interlocked:
        hand_over_interlocked(job, goal)
        return
    part, nodes = job.root(goal.part), hold_nodes(job, goal)
    graph = job.graph(part, nodes)
    job.bring(graph, [Goal(node, any_grasp(graph, goal.to)) for node in nodes])


def put_down(job: Job, part: str) -> None:
    """Put ``part``, with what is assembled to it, down on any support.

    Raises:
        NoRegraspError: There is no way.
    """
    graph = job.graph(part, [])
    stable = find_placements(job.whole(part).part)
    nodes = spots_for(graph.reacher, stable, graph.start, [], job.cell.supports)[:_MOST_SPOTS]
    job.bring(graph, [Goal(node, any_grasp(graph, None)) for node in nodes])


def go_home(job: Job) -> None:
    """Bring the arms that hold nothing home."""
    job.tell("the way home")
    robot, state = job.cell.robot, job.motions.state
    busy = {state.carrier(body)[0] for body in state.attached}
    away = {
        arm: robot.home[mounted.indices]
        for arm, mounted in robot.arms.items()
        if arm not in busy and np.abs(state.q - robot.home)[mounted.indices].max() > 0.0
    }
    if away:
        words = f"{' and '.join(away)} arm{'s go' if len(away) > 1 else ' goes'} home"
        job.motions.free(away, "transit", words, None)


def make_way(job: Job) -> bool:
    """Bring the arms that hold something, and are in the way, home with it; whether any has moved.

    Raises:
        StepError: A motion was not found.
    """
    robot, state = job.cell.robot, job.motions.state
    held = {state.carrier(body)[0]: body for body in state.attached if job.root(body) == body}
    away = [arm for arm in held if arm and np.abs(state.q - robot.home)[robot.arm(arm).indices].max() > 0.0]
    for arm in away:
        part = held[arm]
        words = f"{arm} arm makes way with {part}"
        job.motions.free({arm: robot.home[robot.arm(arm).indices]}, "transfer", words, part, grasp=job.used(part))
    return bool(away)
