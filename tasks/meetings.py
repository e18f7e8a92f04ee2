"""Where two parts can meet: assembly poses at which grasps of both go together, hands, arms and parts free."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..regrasp.clearance import Mask
from ..regrasp.graph import RegraspGraph
from ..regrasp.reach import APPROACH, Holder, Node, Reach, Rows, followed_line
from ..robots.scene import Scene
from ..robots.state import Attachment, Contact, SceneState
from ..transforms import Array, invert
from .fit import Fit, Insertion

_SPREAD = 48  # grasps a side that are tried at an assembly pose
_TOGETHER = 12  # pairs of grasps whose whole robot is checked at an assembly pose
_EACH = 2  # of them for each grasp of the part that is joined to
_LOOKS = 5  # configurations of the straight way that are checked before it is planned
_LOOKS_BACK = 3  # and of the hand's way back
_SAME = 1e-4  # m and rad


@dataclass(frozen=True, eq=False)
class Meeting:
    """An assembly pose with grasps that go together there.

    Attributes:
        world_from_to: Pose (4, 4) of the part that the other is joined to.
        fit: Which arm does what.
        held: Ways of the arm that holds that part.
        moved: Ways of the arm that moves the other, before the straight way.
        pairs: (k, 2) ways of both that go together, as their numbers.
    """

    world_from_to: Array
    fit: Fit
    held: Reach
    moved: Reach
    pairs: Rows

    @property
    def world_from_part(self) -> Array:
        """Pose (4, 4) of the moved part before its straight way."""
        return np.asarray(self.world_from_to @ self.fit.insertion.before())


def meetings(
    scene: Scene,
    graphs: Mapping[str, RegraspGraph],
    fit: Fit,
    hold: Mask,
    move: Mask,
    poses: Iterable[Array],
    why: Counter[str],
) -> Iterator[Meeting]:
    """Assembly poses at which grasps of ``hold`` and ``move`` (n,) go together.

    Args:
        scene: The scene.
        graphs: The regrasp graphs of both parts, from where they are.
        fit: Which grasps go together, whatever the pose.
        hold: Grasps of the part that is joined to.
        move: Grasps of the moved part.
        poses: Poses (4, 4) of the part that is joined to, in the order in which they are looked at.
        why: Takes the count of what fell to which cause.
    """
    hold, move = _some(fit.holder, hold), _some(fit.mover, move)
    if not (hold.any() and move.any()):
        return
    clear = np.zeros((len(hold), len(move)), dtype=bool)
    clear[np.ix_(hold, move)] = fit.pairs(np.flatnonzero(hold), np.flatnonzero(move))
    for world_from_to in poses:
        before = Node(f"{fit.part} at a meeting", world_from_to @ fit.insertion.before(), None, to_leave=False)
        moved = graphs[fit.part].reacher.hand_ways(before, fit.arm, move, why)
        if not len(moved.grasp):
            continue
        held = _holding_ways(graphs[fit.to], fit, world_from_to, hold, why)
        used = np.asarray(clear[np.ix_(held.grasp, moved.grasp)].any(axis=0))
        along = along_and_back(fit, world_from_to, moved.take(used))
        why["no inverse kinematics along the straight way and back"] += int(used.sum()) - len(along.grasp)
        moved = along
        rows = np.argwhere(clear[np.ix_(held.grasp, moved.grasp)])
        pairs = _together(scene, graphs[fit.to].reacher.state, fit, held, moved, rows)
        why["robot or parts in collision while they are joined"] += int(len(rows) > len(pairs) == 0)
        if len(pairs):
            yield Meeting(world_from_to, fit, held, replace(moved, above=moved.at, before=moved.at), pairs)


def along_and_back(fit: Fit, world_from_to: Array, ways: Reach) -> Reach:
    """Those of the moving arm's ``ways`` that lead on along the straight way, and from there the hand back.

    Their ``above`` is then at the end of the straight way, ``before`` where the hand has drawn back to.
    """
    if not len(ways.grasp):
        return ways
    world_from_part = world_from_to @ fit.insertion.before()
    arm, flanges = fit.mover.arm, world_from_part @ fit.mover.part_from_flange[ways.grasp]
    way = np.tile(world_from_to[:3, :3] @ fit.insertion.way, (len(flanges), 1))
    ends, followed = followed_line(arm, ways.at, flanges, way)
    flanges[:, :3, 3] += way
    back = -APPROACH * (world_from_part @ fit.mover.grasps.part_from_hand[ways.grasp])[:, :3, 2]
    drawn_back, left = followed_line(arm, ends, flanges, back)
    return replace(ways, above=ends, before=drawn_back).take(followed & left)


def mated(insertion: Insertion, part: str, to: str) -> Contact:
    """The contact that joined parts may have: free again a bit back along the way."""
    return Contact(to, part, -insertion.way / np.linalg.norm(insertion.way))


def same_pose(a: Array, b: Array) -> bool:
    """Whether poses (4, 4) are alike, but for what inverse kinematics leaves."""
    return bool(np.abs(a - b).max() < _SAME)


def _holding_ways(graph: RegraspGraph, fit: Fit, world_from_to: Array, hold: Mask, why: Counter[str]) -> Reach:
    """The ways of the holding arm; where it holds the part there already, that one."""
    if graph.held is not None and same_pose(world_from_to, graph.start.world_from_part):
        held = graph.ways(graph.start, fit.to_arm, hold)
        return held.take(hold[held.grasp] & (graph.held.arm == fit.to_arm))
    node = Node(f"{fit.to} at a meeting", world_from_to, None, to_leave=False)
    return graph.reacher.hand_ways(node, fit.to_arm, hold, why)


def _some(holder: Holder, mask: Mask) -> Mask:
    """At most a few well-spread grasps of ``mask`` (n,)."""
    (indices,) = np.nonzero(mask)
    some = np.zeros_like(mask)
    some[indices[holder.grasps[indices].spread(_SPREAD)]] = True
    return some


def _together(scene: Scene, state: SceneState, fit: Fit, held: Reach, moved: Reach, rows: Rows) -> Rows:
    """Those of the pairs of ways ``rows`` (m, 2) with which the whole robot is free (k, 2).

    Pairs near home and of good quality are looked at first, and not many with the same grasp of the part that is
    joined to.
    """
    home, (i, j) = scene.robot.home, rows.T
    travel = np.maximum(
        np.abs(held.at - home[fit.holder.arm.indices]).max(axis=1, initial=0.0)[i],
        np.abs(moved.at - home[fit.mover.arm.indices]).max(axis=1, initial=0.0)[j],
    )
    quality = fit.holder.grasps.quality[held.grasp[i]] + fit.mover.grasps.quality[moved.grasp[j]]
    good: list[int] = []
    looked = 0
    for row in np.argsort(travel - quality, kind="stable"):
        hold, move = int(held.grasp[i[row]]), int(moved.grasp[j[row]])
        if looked == _TOGETHER:
            break
        if (held.grasp[i[good]] == hold).sum() < _EACH:
            looked += 1
            q = state.q.copy()
            q[fit.holder.arm.indices] = held.at[i[row]]
            way = moved.take(j[row : row + 1])
            if _free_along(scene, _both_held(state.with_q(q), fit, hold, move), fit, way, move):
                good.append(int(row))
    return rows[good]


def _both_held(state: SceneState, fit: Fit, hold: int, move: int) -> SceneState:
    """``state`` with both parts in their hands."""
    attached, poses, openings = dict(state.attached), dict(state.poses), dict(state.openings)
    contacts = list(state.contacts)
    for name, holder, grasp in ((fit.to, fit.holder, hold), (fit.part, fit.mover, move)):
        poses.pop(name, None)
        attached[name] = Attachment(holder.arm.name, invert(holder.part_from_flange[grasp]))
        openings[holder.arm.name] = float(holder.grasps.opening[grasp])
        contacts += holder.pads(name, grasp)
    contacts.append(mated(fit.insertion, fit.part, fit.to))
    return SceneState(state.q, openings, poses, attached, tuple(contacts))


def _free_along(scene: Scene, state: SceneState, fit: Fit, way: Reach, grasp: int) -> bool:
    """Whether all is free here and there along the straight way, the end first, as the hand draws back, and at home."""
    joined = replace(state.attached[fit.part], carrier=fit.to, carrier_from_body=fit.insertion.at)
    leaving = replace(state, attached={**state.attached, fit.part: joined})
    leaving = leaving.with_opening(fit.arm, fit.mover.grasps.approach_opening[grasp])
    coming = np.linspace(way.above[0], way.at[0], _LOOKS)
    drawing_back = np.linspace(way.above[0], way.before[0], _LOOKS_BACK)
    leaving_ways = [*drawing_back, scene.robot.home[fit.mover.arm.indices]]
    for looked, places in ((state, coming), (leaving, leaving_ways)):
        checker, q = scene.checker(looked, {fit.arm, fit.to_arm}), state.q.copy()
        for joints in places:
            q[fit.mover.arm.indices] = joints
            if not checker.free(q):
                return False
    return True
