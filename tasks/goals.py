"""The goals that bring one part somewhere: to a pose on a support, to an arm, down after an assembly; and home."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..regrasp.clearance import Mask
from ..regrasp.graph import Goal, RegraspGraph
from ..regrasp.nodes import spots_for
from ..regrasp.reach import Node
from ..transforms import Array, invert, pose
from .job import Job
from .meetings import same_pose
from .task import HandOver, Place

_MOST_SPOTS = 24  # where an assembly may be put down
_REACH = 1e-3  # m; a support lies no farther below a part


def place(job: Job, goal: Place) -> None:
    """Put the part of ``goal`` down at its pose.

    Raises:
        InputError: Nothing is there that the part could rest on.
        NoRegraspError: There is no way.
    """
    part = job.root(goal.part)
    wanted = pose(goal.at.xyz, goal.at.rpy) @ invert(job.pose(goal.part)) @ job.pose(part)
    support = _support_below(job, part, wanted)
    if job.rests_on(part) is not None and same_pose(job.pose(part), wanted):
        return
    node = Node(f"{part} at its goal", wanted, support)
    graph = job.graph(part, [node])
    job.bring(graph, [Goal(node, _any_grasp(graph, goal.arm))])


def hand_over(job: Job, goal: HandOver) -> None:
    """Give the part of ``goal`` to an arm, which ends holding it at a pose.

    Raises:
        NoRegraspError: There is no way.
    """
    part = job.root(goal.part)
    wanted = pose(goal.at.xyz, goal.at.rpy) @ invert(job.pose(goal.part)) @ job.pose(part)
    node = Node(f"{part} held by the {goal.to} arm", wanted, None, to_leave=False)
    graph = job.graph(part, [node])
    job.bring(graph, [Goal(node, _any_grasp(graph, goal.to))])


def put_down(job: Job, part: str) -> None:
    """Put ``part``, with what is assembled to it, down on any support.

    Raises:
        NoRegraspError: There is no way.
    """
    graph = job.graph(part, [])
    nodes = spots_for(graph.reacher, job.whole(part).part, graph.start, [], job.cell.supports)[:_MOST_SPOTS]
    job.bring(graph, [Goal(node, _any_grasp(graph, None)) for node in nodes])


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


def _any_grasp(graph: RegraspGraph, pinned: str | None) -> dict[str, Mask]:
    holders = graph.reacher.holders
    return {arm: np.ones(len(h.grasps), dtype=bool) for arm, h in holders.items() if pinned in (None, arm)}


def _support_below(job: Job, part: str, wanted: Array) -> str:
    """The body that ``part`` rests on at ``wanted`` (4, 4): it touches it once it is a millimetre lower."""
    lower = wanted.copy()
    lower[2, 3] -= _REACH
    scene, state = job.cell.scene, job.motions.state
    whole = {part, *job.whole(part).others}
    for name, body in scene.bodies.items():
        there = invert(lower) @ scene.world_from_body(state, name)
        if name not in whole and not state.carrier(name)[0] and scene.bodies[part].touches(body, there):
            return name
    raise InputError(f"goal: place {part}", "nothing is below it there", "give a pose at which it rests on something")
