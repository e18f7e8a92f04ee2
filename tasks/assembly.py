"""Joining two parts in the air: where and how the assembly is held, which arm holds what, and the last straight way."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import NoRegraspError, PlanningError
from ..regrasp.clearance import Mask
from ..regrasp.graph import Goal, RegraspGraph
from ..regrasp.handovers import sample_handovers
from ..regrasp.reach import APPROACH, Holder, Node, Reach, Rows, followed_line
from ..regrasp.steps import Event, StepError
from ..robots.state import Attachment, Contact, SceneState
from ..robots.straight import INSERTION
from ..transforms import Array, invert, pose
from .fit import Fit, Insertion
from .job import Job
from .task import Attach

_log = logging.getLogger(__name__)

_MOST_POSES = 96  # assembly poses that are looked at
_ENOUGH, _ENOUGH_REGRASPED = 3, 5  # of them with hands that go together, that are tried
_SPREAD = 48  # grasps a side that are tried at an assembly pose
_TOGETHER = 12  # pairs of grasps whose whole robot is checked at an assembly pose
_EACH = 2  # of them for each grasp of the part that is joined to
_PRECISION = 1e-4  # m and rad within which a part was brought where it should be
_LOOKS = 5  # configurations of the straight way that are checked before it is planned


@dataclass(frozen=True, eq=False)
class Meeting:
    """An assembly pose with grasps that go together there.

    Attributes:
        world_from_to: Pose (4, 4) of the part that the other is joined to.
        fit: Which arm does what.
        pairs: (k, 2) grasps of that part and of the moved one.
    """

    world_from_to: Array
    fit: Fit
    pairs: Rows


class NoMeetingError(PlanningError):
    """Two parts do not come together.

    Attributes:
        report: What was tried and why it failed, a sentence each.
    """

    def __init__(self, part: str, to: str, report: Sequence[str]) -> None:
        """Name the parts and the last reason."""
        self.report = tuple(report)
        last = f": {report[-1]}" if report else ""
        super().__init__(f"no way to join {part} to {to}{last}")


def attach(job: Job, goal: Attach, later: Sequence[Attach]) -> None:
    """Bring both parts of ``goal`` together and join them; ``later`` are goals that join more to the same part.

    Raises:
        NoMeetingError: There is no way.
    """
    to = job.root(goal.to)
    fits = [_fit(job, goal, to, arm, to_arm) for arm, to_arm in _arms(job, goal, to)]
    graphs = {name: job.graph(name, []) for name in (goal.part, to)}
    poses = list(_poses(job, goal, to))
    failures: list[str] = []
    for direct_part, direct_to, ahead in (
        (True, True, True),
        (True, False, True),
        (True, True, False),
        (True, False, False),
        (False, True, False),
        (False, False, False),
    ):
        if ahead and not later:
            continue
        for fit in fits:
            hold = fit.holding(_wanted(graphs[to], fit.to_arm, direct_to))
            move = fit.moving(_wanted(graphs[goal.part], fit.arm, direct_part))
            for after in later if ahead else ():
                hold &= _fit(job, after, to, fit.arm, fit.to_arm).holding(hold)
            failures.append(
                f"{fit.to_arm} arm holds {to}, {fit.arm} arm brings {goal.part}: {hold.sum()} and {move.sum()} grasps"
                f" {'to take them with where they are' if direct_part and direct_to else 'after a regrasp'}"
            )
            job.tell(f"where {goal.part} and {to} meet")
            found = _meetings(job, graphs, goal.part, to, fit, hold, move, poses)
            meetings = list(itertools.islice(found, _ENOUGH if direct_part and direct_to else _ENOUGH_REGRASPED))
            while meetings:
                try:
                    first, most = (to if direct_part else goal.part), int(not (direct_part or direct_to))
                    _join(job, graphs, goal.part, to, meetings, first, most)
                except (NoRegraspError, StepError) as error:
                    failures.append(str(error))
                    _log.info("%s and %s do not meet: %s", goal.part, to, error)
                else:
                    return
    raise NoMeetingError(goal.part, goal.to, failures)


def _arms(job: Job, goal: Attach, to: str) -> Iterator[tuple[str, str]]:
    """Which arm moves the part and which holds the other, as far as neither is pinned."""
    held = job.held(to)
    for arm, to_arm in itertools.permutations(job.cell.robot.hands, 2):
        if goal.arm in (None, arm) and goal.to_arm in (None, to_arm) and (held is None or held.arm == to_arm):
            yield arm, to_arm


def _fit(job: Job, goal: Attach, to: str, arm: str, to_arm: str) -> Fit:
    root_from_to = invert(job.pose(to)) @ job.pose(goal.to)
    direction = np.asarray(goal.insert.direction, dtype=float)
    way = root_from_to[:3, :3] @ (goal.insert.distance * direction / np.linalg.norm(direction))
    insertion = Insertion(root_from_to @ pose(goal.at.xyz, goal.at.rpy), way)
    return Fit(job.cell.scene, insertion, job.whole(goal.part), job.whole(to), arm, to_arm)


def _wanted(graph: RegraspGraph, arm: str, direct: bool) -> Mask:
    """The grasps (n,) of ``arm``: all, or those with which it can take the part where it is."""
    every = np.ones(len(graph.reacher.holders[arm].grasps), dtype=bool)
    return graph.leaving_start(arm, every) if direct else every


def _poses(job: Job, goal: Attach, to: str) -> Iterator[Array]:
    """Poses (4, 4) of the part that is joined to: where it is held already, then all over the shared workspace."""
    if goal.where is not None:
        yield pose(goal.where.xyz, goal.where.rpy)
        return
    if job.held(to) is not None:
        yield job.pose(to)
    middle = (job.pose(to)[:3, 3] + job.pose(goal.part)[:3, 3]) / 2.0
    turned = [job.pose(to)[:3, :3]]
    rng = np.random.default_rng([job.seed, len(job.motions.steps)])
    nodes = sample_handovers(job.cell.robot, list(job.cell.robot.hands), middle, turned, rng)
    for node in nodes[:_MOST_POSES]:
        yield node.world_from_part


def _meetings(
    job: Job,
    graphs: dict[str, RegraspGraph],
    part: str,
    to: str,
    fit: Fit,
    hold: Mask,
    move: Mask,
    poses: Sequence[Array],
) -> Iterator[Meeting]:
    """Poses at which grasps of ``hold`` and ``move`` (n,) go together, hands and robot free of collision."""
    some_hold, some_move = (_some(holder, mask) for holder, mask in ((fit.holder, hold), (fit.mover, move)))
    if not (some_hold.any() and some_move.any()):
        return
    clear = fit.pairs(*(np.flatnonzero(mask) for mask in (some_hold, some_move)))
    if not clear.any():
        return
    numbers = [np.cumsum(mask) - 1 for mask in (some_hold, some_move)]
    for world_from_to in poses:
        before = Node(f"{part} at a meeting", world_from_to @ fit.insertion.before(), None, to_leave=False)
        moved = graphs[part].reacher.hand_ways(before, fit.arm, some_move)
        arm, flanges = fit.mover.arm, before.world_from_part @ fit.mover.part_from_flange[moved.grasp]
        way = np.tile(world_from_to[:3, :3] @ fit.insertion.way, (len(moved.grasp), 1))
        ends, followed = followed_line(arm, moved.at, flanges, way)
        leaving = -APPROACH * (before.world_from_part @ fit.mover.grasps.part_from_hand[moved.grasp])[:, :3, 2]
        flanges[:, :3, 3] += way
        _, left = followed_line(arm, ends, flanges, leaving)
        moved = replace(moved, above=ends).take(followed & left)
        if not len(moved.grasp):
            continue
        here = Node(f"{to} at a meeting", world_from_to, None, to_leave=False)
        held = _held_ways(graphs[to], here, fit.to_arm, some_hold)
        if not len(held.grasp):
            continue
        rows = np.argwhere(clear[np.ix_(numbers[0][held.grasp], numbers[1][moved.grasp])])
        if not len(rows):
            continue
        home = job.cell.robot.home
        travel = [
            np.abs(ways.at[r] - home[a.indices]).max(axis=1)
            for ways, a, r in zip((held, moved), (fit.holder.arm, arm), rows.T, strict=True)
        ]
        quality = fit.holder.grasps.quality[held.grasp[rows[:, 0]]] + fit.mover.grasps.quality[moved.grasp[rows[:, 1]]]
        cost = np.maximum(*travel) - quality
        good: list[tuple[int, int]] = []
        looked = 0
        for row in np.argsort(cost, kind="stable"):
            i, j = rows[row]
            pair = (int(held.grasp[i]), int(moved.grasp[j]))
            if sum(pair[0] == hold for hold, _ in good) < _EACH:
                joints = (held.at[i], (moved.at[j], moved.above[j]))
                looked += 1
                if _together(job, part, to, fit, *pair, joints):
                    good.append(pair)
            if looked == _TOGETHER:
                break
        if good:
            yield Meeting(world_from_to, fit, np.array(good, dtype=np.intp))


def _held_ways(graph: RegraspGraph, node: Node, arm: str, mask: Mask) -> Reach:
    """The ways of ``arm`` to hold the part at ``node``; where it is held there already, that one."""
    if graph.held is not None and _same(node.world_from_part, graph.start.world_from_part):
        return graph.ways(graph.start, arm, mask)
    return graph.reacher.hand_ways(node, arm, mask)


def _some(holder: Holder, mask: Mask) -> Mask:
    """At most a few well-spread grasps of ``mask`` (n,)."""
    (indices,) = np.nonzero(mask)
    some = np.zeros_like(mask)
    some[indices[holder.grasps[indices].spread(_SPREAD)]] = True
    return some


def _together(
    job: Job, part: str, to: str, fit: Fit, hold: int, move: int, joints: tuple[Array, tuple[Array, Array]]
) -> bool:
    """Whether robot and both held parts are free of collision here and there along the straight way."""
    scene, state = job.cell.scene, job.motions.state
    attached, poses = dict(state.attached), dict(state.poses)
    q, openings = np.array(state.q), dict(state.openings)
    contacts = [*state.contacts]
    for name, holder, grasp in ((to, fit.holder, hold), (part, fit.mover, move)):
        arm = holder.arm.name
        attached[name] = Attachment(arm, invert(holder.part_from_flange[grasp]))
        poses.pop(name, None)
        openings[arm] = float(holder.grasps.opening[grasp])
        contacts = [c for c in contacts if name not in (c.first, c.second)] + holder.pads(name, grasp)
    contacts.append(_mated(fit.insertion, part, to))
    q[fit.holder.arm.indices] = joints[0]
    checker = scene.checker(SceneState(q, openings, poses, attached, tuple(contacts)), {fit.arm, fit.to_arm})
    for at in np.linspace(*joints[1][::-1], _LOOKS):
        q[fit.mover.arm.indices] = at
        if not checker.free(q):
            return False
    return True


def _mated(insertion: Insertion, part: str, to: str) -> Contact:
    """The contact that the parts may have: free again a bit back along the way."""
    return Contact(to, part, -insertion.way / np.linalg.norm(insertion.way))


def _join(
    job: Job,
    graphs: dict[str, RegraspGraph],
    part: str,
    to: str,
    meetings: list[Meeting],
    first: str,
    most_regrasps: int,
) -> None:
    """Bring both parts to one of ``meetings``, the ``first`` one with all the regrasps that it takes, and join them.

    The other one may be regrasped by its one arm at most so often.
    A meeting that turns out not to work is taken off the list.

    Raises:
        NoRegraspError, StepError: A way was not found; nothing has been added to the job then.
    """
    mark, second = job.mark(), part if first == to else to
    fit = meetings[0].fit
    holders = {to: fit.holder, part: fit.mover}
    side = {to: 0, part: 1}
    goals = [
        _goal(first, _part_at(meeting, first, to), holders[first], meeting.pairs[:, side[first]])
        for meeting in meetings
    ]
    graph = job.graph(first, [goal.node for goal in goals], graphs[first].reacher)
    tried = list(meetings)
    try:
        link = job.bring(graph, goals)
        world_from_first = job.pose(first)
        meeting = next(
            m for m, g in zip(meetings, goals, strict=True) if _same(g.node.world_from_part, world_from_first)
        )
        tried = [meeting]
        pairs = meeting.pairs[meeting.pairs[:, side[first]] == link.grasp]
        goal = _goal(second, _part_at(meeting, second, to), holders[second], pairs[:, side[second]])
        grasp = job.bring(job.graph(second, [goal.node]), [goal], most_regrasps).grasp
        _insert(job, part, to, fit, link.grasp if first == part else grasp)
    except (NoRegraspError, StepError):
        job.back_to(mark)
        for meeting in tried:
            meetings.remove(meeting)
        raise


def _part_at(meeting: Meeting, name: str, to: str) -> Array:
    """Where a part is at ``meeting`` before the straight way (4, 4)."""
    return meeting.world_from_to if name == to else meeting.world_from_to @ meeting.fit.insertion.before()


def _goal(name: str, world_from_part: Array, holder: Holder, grasps: Rows) -> Goal:
    allowed = np.zeros(len(holder.grasps), dtype=bool)
    allowed[grasps] = True
    return Goal(Node(f"{name} at the meeting", world_from_part, None, to_leave=False), {holder.arm.name: allowed})


def _same(a: Array, b: Array) -> bool:
    return bool(np.abs(a - b).max() < _PRECISION)


def _insert(job: Job, part: str, to: str, fit: Fit, grasp: int) -> None:
    """Push ``part`` onto ``to``, let it go and draw the hand back.

    Raises:
        StepError: A motion was not found.
    """
    motions, arm = job.motions, fit.arm
    motions.state = motions.state.with_contacts([*motions.state.contacts, _mated(fit.insertion, part, to)])
    motions.line(
        arm,
        motions.hand_for(arm, part, job.pose(to) @ fit.insertion.at),
        "insert",
        f"{arm} hand pushes {part} onto {to}",
        part,
        grasp=fit.mover.row(grasp),
        tolerance=INSERTION,
        events=[Event("attach", part, to, at_end=True)],
    )
    motions.give(fit.mover, part, grasp)
    motions.retreat(fit.mover, part, grasp, APPROACH)
