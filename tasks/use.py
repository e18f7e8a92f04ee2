"""Using a tool: its frame straight to a pose, and straight back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import NoRegraspError
from ..regrasp.clearance import Mask
from ..regrasp.graph import MOST_REGRASPS, Goal, RegraspGraph
from ..regrasp.reach import Node, Reach, followed_line
from ..regrasp.steps import Attempt, Kind, StepError
from ..robots.state import Contact
from ..robots.straight import INSERTION
from ..transforms import Array, compose, invert, pose
from .job import Job, any_grasp
from .meetings import same_pose
from .targets import turned
from .task import Use

_MOST_CAUSES = 4
_MOST_TRIES = 8  # ways that are tried, once the tool can be brought there


@dataclass(frozen=True, eq=False)
class _Stroke:
    """One way to use a tool.

    Attributes:
        before: The tool before its straight way.
        end: The tool at its end, where it may touch what it works on.
        way: The straight way (3,) in the world [m].
    """

    before: Node
    end: Node
    way: Array


def use(job: Job, goal: Use) -> None:
    """Bring the tool's frame to where ``goal`` wants it and back, regrasping the tool before if that takes it.

    Raises:
        NoRegraspError: There is no way.
    """
    part = job.root(goal.part)
    strokes = list(_strokes(job, goal, part))
    why: Counter[str] = Counter()
    failures: list[str] = []
    graph = job.graph(part, [])
    allowed = any_grasp(graph, goal.arm)
    goals = [Goal(stroke.before, allowed) for stroke in strokes]
    for most_regrasps in (0, MOST_REGRASPS):
        for arm, mask in allowed.items():
            wanted = graph.leaving_start(arm, mask) if most_regrasps == 0 else mask
            for stroke in strokes:
                graph.reacher.admit(stroke.before, arm, _ways(graph, stroke, arm, wanted, why))
        if _stroke_one(job, part, strokes, graph, goals, most_regrasps, failures):
            return
    causes = ", ".join(f"{count} {cause}" for cause, count in why.most_common(_MOST_CAUSES) if count)
    report = [f"{goal.frame} of {part} at its goal, of {len(strokes)} turns: {causes or 'some grasps work'}", *failures]
    raise NoRegraspError(part, f"its {goal.frame} does not come to where it is used", report)


def stroke_nodes(job: Job, goal: Use) -> tuple[list[Node], list[Node]]:
    """Where the tool of ``goal`` is before its straight way, and at its end; for each turn."""
    strokes = list(_strokes(job, goal, job.root(goal.part)))
    return [stroke.before for stroke in strokes], [stroke.end for stroke in strokes]


def _strokes(job: Job, goal: Use, part: str) -> Iterator[_Stroke]:
    """Ways to use the tool: one, or one for each turn."""
    named = job.cell.task.parts[goal.part].frames[goal.frame]
    frame_from_root = invert(pose(named.xyz, named.rpy)) @ invert(job.pose(goal.part)) @ job.pose(part)
    world_from_of = np.eye(4) if goal.of is None else job.pose(goal.of)
    direction = np.asarray(goal.approach.direction, dtype=float)
    direction = world_from_of[:3, :3] @ direction / np.linalg.norm(direction)
    way = float(goal.approach.distance) * direction
    touching: tuple[Contact, ...] = ()
    if goal.of is not None:
        back = -world_from_of[:3, :3].T @ direction
        touching = tuple(Contact(goal.of, body, back) for body, _ in job.whole(part).bodies())
    for i, frame in enumerate(turned(goal.at, goal.any_turn)):
        end = world_from_of @ frame @ frame_from_root
        words = f"{part} with its {goal.frame}" + (f", turn {i + 1}," if goal.any_turn else "")
        yield _Stroke(
            Node(f"{words} before its goal", compose(np.eye(3), -way) @ end, None, to_leave=False),
            Node(f"{words} at its goal", end, None, to_leave=False, touching=touching),
            way,
        )


def _ways(graph: RegraspGraph, stroke: _Stroke, arm: str, wanted: Mask, why: Counter[str]) -> Reach:
    """The ways of ``arm`` to have the tool before its straight way, from which that can be followed."""
    reacher, holder = graph.reacher, graph.reacher.holders[arm]
    reacher.admit(stroke.end, arm, reacher.hand_ways(stroke.end, arm, wanted, why))
    ends = reacher.reach(stroke.end, arm, wanted)
    flanges = stroke.end.world_from_part @ holder.part_from_flange[ends.grasp]
    joints, followed = followed_line(holder.arm, ends.at, flanges, np.tile(-stroke.way, (len(flanges), 1)))
    why["no inverse kinematics along the straight way"] += int((~followed).sum())
    return Reach(ends.grasp, joints, joints, joints).take(followed)


def _stroke_one(
    job: Job,
    part: str,
    strokes: Sequence[_Stroke],
    graph: RegraspGraph,
    goals: Sequence[Goal],
    most_regrasps: int,
    failures: list[str],
) -> bool:
    """Whether the tool could be used in one of the ways, trying one after the other."""
    mark = job.mark()
    onward = job.graph(part, [entry.node for entry in goals], graph.reacher)
    for _ in range(_MOST_TRIES):
        try:
            link = job.bring(onward, goals, most_regrasps)
        except NoRegraspError as error:
            failures += error.report
            return False
        at = job.pose(part)
        stroke = next(entry for entry in strokes if same_pose(entry.before.world_from_part, at))
        try:
            _press(job, part, stroke)
        except StepError as error:
            job.back_to(mark)
            failures.append(Attempt(error))
            graph.reacher.give_up(stroke.before, link.arm, link.grasp, link.target.at[0])
        else:
            return True
    return False


def _press(job: Job, part: str, stroke: _Stroke) -> None:
    """The straight way and back.

    Raises:
        StepError: A motion was not found.
    """
    motions, (arm, _) = job.motions, job.motions.state.carrier(part)
    grasp, before = job.used(part), motions.state
    motions.state = before.with_contacts([*before.contacts, *stroke.end.touching])
    ways: tuple[tuple[Kind, Node, str], ...] = (
        ("press", stroke.end, f"{arm} hand brings {part} to where it is used"),
        ("withdraw", stroke.before, f"{arm} hand draws {part} back"),
    )
    for kind, node, words in ways:
        hand = motions.hand_for(arm, part, node.world_from_part)
        motions.line(arm, hand, kind, words, part, grasp=grasp, tolerance=INSERTION)
    motions.state = motions.state.with_contacts(before.contacts)
