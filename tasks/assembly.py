"""Joining two parts: in the air, a hand to each, or on what the other part stands on."""

from __future__ import annotations

import itertools
import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..errors import NoRegraspError, PlanningError
from ..regrasp.clearance import Mask
from ..regrasp.graph import MOST_REGRASPS, Goal, RegraspGraph
from ..regrasp.handovers import sample_handovers
from ..regrasp.planner import Link
from ..regrasp.reach import APPROACH, Holder, Node, Reach, Rows
from ..regrasp.steps import Attempt, Event, StepError
from ..robots.straight import INSERTION
from ..transforms import Array, compose, invert, pose, pose_distance
from .fit import Fit, Insertion
from .job import Job
from .meetings import Meeting, along_and_back, mated, meetings, same_pose
from .task import At, Attach

_log = logging.getLogger(__name__)

_MOST_POSES = 192  # assembly poses that are looked at
_BATCH, _BATCH_REGRASPED = 2, 3  # of them with hands that go together, that are compared
_MOST_BATCHES = 3  # of those, that are tried one after the other
_SAME = 1e-6  # rad or m; joints of one way are found anew within this
_MOST_CAUSES = 4
_UPWARD = 0.3  # of a push that points up
_PIN_REACH, _PIN_TURN = 5e-3, float(np.radians(10.0))  # m and rad between a pinned grasp and the planned ones it allows


class NoMeetingError(PlanningError):
    """Two parts do not come together.

    Attributes:
        report: What was tried and why it failed, a sentence each.
        why: How many assembly poses, or ways to hold a part at them, fell to which cause.
    """

    def __init__(self, part: str, to: str, report: Sequence[str], why: Counter[str]) -> None:
        """Name the parts and the last reason."""
        self.report, self.why = tuple(report), why
        last = f": {report[-1]}" if report else ""
        super().__init__(f"no way to join {part} to {to}{last}")


def attach(job: Job, goal: Attach, later: Sequence[Attach]) -> None:
    """Bring both parts of ``goal`` together and join them; ``later`` are goals that join more to the same part.

    The other part is held in the air; if it shall be put down afterwards, or there is no other way, it may stay where
    it stands.

    Raises:
        NoMeetingError: There is no way.
    """
    failures: list[str] = []
    why: Counter[str] = Counter()
    if touching := in_the_way(job, goal):
        raise NoMeetingError(goal.part, goal.to, [touching], why)
    if len(job.cell.robot.hands) < 2:
        failures.append("joining in the air takes two hands, and the robot has one")
    if goal.then == "place" and _where_it_stands(job, goal, failures):
        return
    if _in_the_air(job, goal, later, failures, why):
        return
    if goal.then == "hold" and _where_it_stands(job, goal, failures):
        return
    raise NoMeetingError(goal.part, goal.to, failures, why)


def in_the_way(job: Job, goal: Attach) -> str:
    """What the parts touch of each other on the straight way, whoever holds them, in words; empty if nothing."""
    to, scene = job.root(goal.to), job.cell.scene
    insertion = insertion_of(job, goal)
    # Parts that are joined may touch, but no deeper than the contact tolerance against the way.
    loose = compose(np.eye(3), -scene.contact_tolerance * insertion.way / np.linalg.norm(insertion.way))
    pairs = list(itertools.product(job.whole(to).bodies(), job.whole(goal.part).bodies()))
    for left, look in zip(insertion.distances, insertion.looks(), strict=True):
        for (other, there), (mine, at) in pairs:
            still, moved, from_to = scene.bodies[other], scene.bodies[mine], invert(there)
            if still.touches(moved, from_to @ look @ at) and still.touches(moved, from_to @ loose @ look @ at):
                return f"{mine} against {other} {1e3 * left:.0f} mm before it is in place, whoever holds them"
    return ""


def ways_left(job: Job, goal: Attach) -> Iterator[tuple[str, str, int, int]]:
    """For either part and each pair of arms: part, the other, how many grasps leave the straight way free, of how many.

    Whoever holds the other part, and wherever.
    """
    to = job.root(goal.to)
    for arm, to_arm in _arms(job, goal, to) or [(arm, arm) for arm in job.cell.robot.hands]:
        fit = _fit(job, goal, to, arm, to_arm)
        for part, other, holder, clear in (
            (to, goal.part, fit.holder, fit.holding),
            (goal.part, to, fit.mover, fit.moving),
        ):
            every = np.ones(len(holder.grasps), dtype=bool)
            yield part, other, int(clear(every).sum()), len(every)


# In the air -----------------------------------------------------------------------------------------------------------


def _in_the_air(job: Job, goal: Attach, later: Sequence[Attach], failures: list[str], every: Counter[str]) -> bool:
    """Join the parts in the air, if there is a way: as few regrasps as possible, and the goals to come in mind.

    First both parts are taken directly, then the other part is regrasped before, then the part, then both; with grasps
    that leave the goals to come free as long as there are such.
    """
    to = job.root(goal.to)
    job.tell(f"where {goal.part} and {to} may meet")
    graphs = {name: job.graph(name, []) for name in (goal.part, to)}
    poses = _poses(job, goal, to)
    fits = [_fit(job, goal, to, arm, to_arm) for arm, to_arm in _arms(job, goal, to)]
    for ahead, (direct_part, direct_to) in itertools.product(
        (True, False) if later else (False,), ((True, True), (True, False), (False, True), (False, False))
    ):
        if ahead and not direct_part:
            continue
        for fit in fits:
            job.tell(f"which grasps of {goal.part} and {to} go together")
            hold = fit.holding(_wanted(graphs[to], fit.to_arm, direct_to) & _pinned(fit.holder, goal.to_grasp))
            move = fit.moving(_wanted(graphs[goal.part], fit.arm, direct_part) & _pinned(fit.mover, goal.grasp))
            for after in later if ahead else ():
                hold &= _fit(job, after, to, fit.arm, fit.to_arm).holding(hold)
            failures.append(
                f"{fit.to_arm} arm holds {to}, {fit.arm} arm brings {goal.part}: {hold.sum()} and {move.sum()} grasps"
                f" {'to take them with where they are' if direct_part and direct_to else 'after a regrasp'}"
            )
            job.tell(f"where {goal.part} and {to} meet")
            why: Counter[str] = Counter()
            found = meetings(job.cell.scene, graphs, fit, hold, move, poses, why)
            first, most = (to if direct_part else goal.part), int(not (direct_part or direct_to))
            for _ in range(_MOST_BATCHES):
                some = list(itertools.islice(found, _BATCH if direct_part and direct_to else _BATCH_REGRASPED))
                if _join_one(job, graphs, some, first, most, failures):
                    return True
            every.update(why)
            if why.total():
                causes = ", ".join(f"{count} {cause}" for cause, count in why.most_common(_MOST_CAUSES) if count)
                failures.append(f"of the {len(poses)} assembly poses none serves: {causes}")
    return False


def _join_one(
    job: Job, graphs: dict[str, RegraspGraph], some: list[Meeting], first: str, most_regrasps: int, failures: list[str]
) -> bool:
    """Join the parts at one of the meetings, if there is a way, trying one after the other."""
    while some:
        fit = some[0].fit
        try:
            _join(job, graphs, some, first, most_regrasps)
        except (NoRegraspError, StepError) as error:
            failures += _told(error)
            _log.info("%s and %s do not meet: %s", fit.part, fit.to, error)
        else:
            return True
    return False


def _told(error: NoRegraspError | StepError) -> list[str]:
    """What failed, and the motions that did."""
    if isinstance(error, StepError):
        return [Attempt(error)]
    return [str(error), *(line for line in error.report if isinstance(line, Attempt))]


def _arms(job: Job, goal: Attach, to: str) -> list[tuple[str, str]]:
    """Which arm moves the part and which holds the other, as far as neither is pinned; as they hold them now first."""
    held = job.held(to)
    pairs = itertools.permutations(job.cell.robot.hands, 2)
    open_ = [(arm, other) for arm, other in pairs if goal.arm in (None, arm) and goal.to_arm in (None, other)]
    return sorted(open_, key=lambda pair: held is not None and held.arm != pair[1])


def insertion_of(job: Job, goal: Attach) -> Insertion:
    """How the part of ``goal`` comes to the other, in the frame of what that is assembled to."""
    root_from_to = invert(job.pose(job.root(goal.to))) @ job.pose(goal.to)
    direction = np.asarray(goal.insert.direction, dtype=float)
    way = root_from_to[:3, :3] @ (goal.insert.distance * direction / np.linalg.norm(direction))
    return Insertion(root_from_to @ pose(goal.at.xyz, goal.at.rpy), way)


def pinned_pose(job: Job, goal: Attach, where: At) -> Array:
    """Pose (4, 4) of what the other part of ``goal`` is assembled to, with that part at ``where``."""
    return np.asarray(pose(where.xyz, where.rpy) @ invert(job.pose(goal.to)) @ job.pose(job.root(goal.to)))


def _fit(job: Job, goal: Attach, to: str, arm: str, to_arm: str) -> Fit:
    return Fit(job.cell.scene, insertion_of(job, goal), job.whole(goal.part), job.whole(to), arm, to_arm)


def _wanted(graph: RegraspGraph, arm: str, direct: bool) -> Mask:
    """The grasps (n,) of ``arm``: all, or those with which it can take the part where it is."""
    every = np.ones(len(graph.reacher.holders[arm].grasps), dtype=bool)
    return graph.leaving_start(arm, every) if direct else every


def _pinned(holder: Holder, pin: At | None) -> Mask:
    """The grasps (n,) that a pinned pose of the hand on the part allows; all if none is pinned."""
    if pin is None:
        return np.ones(len(holder.grasps), dtype=bool)
    distance, angle = pose_distance(holder.grasps.part_from_hand, pose(pin.xyz, pin.rpy))
    return np.asarray((distance <= _PIN_REACH) & (angle <= _PIN_TURN))


def _poses(job: Job, goal: Attach, to: str) -> list[Array]:
    """Poses (4, 4) of the part that is joined to: where it is held already, then all over the shared workspace.

    Those come last at which the other part is pushed upward: it would hang on what it was pushed onto.
    """
    if goal.where is not None:
        return [pinned_pose(job, goal, goal.where)]
    held = [job.pose(to)] if job.held(to) is not None else []
    middle = (job.pose(to)[:3, 3] + job.pose(goal.part)[:3, 3]) / 2.0
    rng = np.random.default_rng([job.seed, len(job.motions.steps)])
    nodes = sample_handovers(job.cell.robot, list(job.cell.robot.hands), middle, [job.pose(to)[:3, :3]], rng)
    way = insertion_of(job, goal).way
    push = way / np.linalg.norm(way)
    poses = [*held, *(node.world_from_part for node in nodes[:_MOST_POSES])]
    return sorted(poses, key=lambda world_from_to: bool(world_from_to[2, :3] @ push > _UPWARD))


def _join(job: Job, graphs: dict[str, RegraspGraph], some: list[Meeting], first: str, most_regrasps: int) -> None:
    """Bring both parts to one of the meetings, the ``first`` one with all the regrasps that it takes, and join them.

    The other one may be regrasped by its one arm at most so often. A meeting that turns out not to work is taken off
    the list.

    Raises:
        NoRegraspError, StepError: A way was not found; nothing has been added to the job then.
    """
    fit, mark, tried = some[0].fit, job.mark(), list(some)
    second, side = (fit.part, 0) if first == fit.to else (fit.to, 1)
    goals = [_goal(meeting, first) for meeting in some]
    try:
        graph = job.graph(first, [goal.node for goal in goals], graphs[first].reacher)
        link = _bring(job, graph, goals, [_ways(m, first, m.pairs[:, side]) for m in some])
        meeting = some[[same_pose(goal.node.world_from_part, job.pose(first)) for goal in goals].index(True)]
        tried = [meeting]
        held = meeting.held if first == fit.to else meeting.moved
        taken = (held.grasp == link.grasp) & (np.abs(held.at - link.target.at).max(axis=1) < _SAME)
        fitting = meeting.pairs[taken[meeting.pairs[:, side]]]
        last = _goal(meeting, second)
        ways = _ways(meeting, second, fitting[:, 1 - side])
        grasp = _bring(job, job.graph(second, [last.node]), [last], [ways], most_regrasps).grasp
        _insert(job, fit, link.grasp if first == fit.part else grasp)
    except (NoRegraspError, StepError):
        job.back_to(mark)
        for meeting in tried:
            some.remove(meeting)
        raise


def _goal(meeting: Meeting, name: str) -> Goal:
    """A part at ``meeting``, before the straight way; grasps are told by the ways admitted there."""
    fit = meeting.fit
    at, holder = (meeting.world_from_to, fit.holder) if name == fit.to else (meeting.world_from_part, fit.mover)
    return _held_goal(name, at, holder)


def _held_goal(name: str, world_from_part: Array, holder: Holder) -> Goal:
    node = Node(f"{name} at the meeting", world_from_part, None, to_leave=False)
    return Goal(node, {holder.arm.name: np.ones(len(holder.grasps), dtype=bool)})


def _ways(meeting: Meeting, name: str, rows: Rows) -> Reach:
    """The ways ``rows`` (k,) to hold a part at ``meeting``, each once."""
    return (meeting.held if name == meeting.fit.to else meeting.moved).take(np.unique(rows))


def _bring(
    job: Job, graph: RegraspGraph, goals: Sequence[Goal], ways: Sequence[Reach], most_regrasps: int = MOST_REGRASPS
) -> Link:
    """Bring a part to one of ``goals``, to each in one of its ``ways``.

    Raises:
        NoRegraspError: There is no way.
    """
    for goal, entry in zip(goals, ways, strict=True):
        graph.reacher.admit(goal.node, next(iter(goal.allowed)), entry)
    return job.bring(graph, goals, most_regrasps)


# On a support ---------------------------------------------------------------------------------------------------------


def _where_it_stands(job: Job, goal: Attach, failures: list[str]) -> bool:
    """Join the part to the other where that stands, if there is a way."""
    to = job.root(goal.to)
    if job.rests_on(to) is None or goal.to_arm is not None or goal.where is not None:
        return False
    mark, graph = job.mark(), job.graph(goal.part, [])
    for arm in job.cell.robot.hands if goal.arm is None else [goal.arm]:
        fit = _fit(job, goal, to, arm, arm)
        move = fit.moving(_pinned(fit.mover, goal.grasp))
        last = _held_goal(goal.part, job.pose(to) @ fit.insertion.before(), fit.mover)
        ways = along_and_back(fit, job.pose(to), graph.reacher.hand_ways(last.node, arm, move, Counter()))
        job.tell(f"{goal.part} to {to} where it stands")
        try:
            onward = job.graph(goal.part, [last.node], graph.reacher)
            _insert(job, fit, _bring(job, onward, [last], [replace(ways, above=ways.at, before=ways.at)]).grasp)
        except (NoRegraspError, StepError) as error:
            job.back_to(mark)
            failures.append(f"{to} stays on {job.rests_on(to)}, {arm} arm brings {goal.part}: {error}")
            failures += _told(error)
        else:
            return True
    return False


def _insert(job: Job, fit: Fit, grasp: int) -> None:
    """Push the part onto the other, let it go and draw the hand back.

    Raises:
        StepError: A motion was not found.
    """
    motions, part, arm = job.motions, fit.part, fit.arm
    motions.state = motions.state.with_contacts([*motions.state.contacts, mated(fit.insertion, part, fit.to)])
    motions.line(
        arm,
        motions.hand_for(arm, part, job.pose(fit.to) @ fit.insertion.at),
        "insert",
        f"{arm} hand pushes {part} onto {fit.to}",
        part,
        grasp=fit.mover.row(grasp),
        tolerance=INSERTION,
        events=[Event("attach", part, fit.to, at_end=True)],
    )
    motions.give(fit.mover, part, grasp)
    motions.retreat(fit.mover, part, grasp, APPROACH)
