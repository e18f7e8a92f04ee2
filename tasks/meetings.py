"""Where two parts can meet: assembly poses at which grasps of both go together, hands, arms and parts free."""

from __future__ import annotations

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
    scene: Scene, graphs: Mapping[str, RegraspGraph], fit: Fit, hold: Mask, move: Mask, poses: Iterable[Array]
) -> Iterator[Meeting]:
    """Assembly poses at which grasps of ``hold`` and ``move`` (n,) go together.

    Args:
        scene: The scene.
        graphs: The regrasp graphs of both parts, from where they are.
        fit: Which grasps go together, whatever the pose.
        hold: Grasps of the part that is joined to.
        move: Grasps of the moved part.
        poses: Poses (4, 4) of the part that is joined to, in the order in which they are looked at.
    """
    hold, move = _some(fit.holder, hold), _some(fit.mover, move)
    if not (hold.any() and move.any()):
        return
    clear = np.zeros((len(hold), len(move)), dtype=bool)
    clear[np.ix_(hold, move)] = fit.pairs(np.flatnonzero(hold), np.flatnonzero(move))
    for world_from_to in poses:
        moved = moving_ways(graphs[fit.part], fit, world_from_to, move)
        if not len(moved.grasp):
            continue
        held = _holding_ways(graphs[fit.to], fit, world_from_to, hold)
        rows = np.argwhere(clear[np.ix_(held.grasp, moved.grasp)])
        pairs = _together(scene, graphs[fit.to].reacher.state, fit, held, moved, rows)
        if len(pairs):
            yield Meeting(world_from_to, fit, held, replace(moved, above=moved.at), pairs)


def moving_ways(graph: RegraspGraph, fit: Fit, world_from_to: Array, move: Mask) -> Reach:
    """The ways of the moving arm, ``above`` being at the end of the straight way, from which the hand can draw back."""
    node = Node(f"{fit.part} at a meeting", world_from_to @ fit.insertion.before(), None, to_leave=False)
    ways = graph.reacher.hand_ways(node, fit.arm, move)
    arm, flanges = fit.mover.arm, node.world_from_part @ fit.mover.part_from_flange[ways.grasp]
    way = np.tile(world_from_to[:3, :3] @ fit.insertion.way, (len(flanges), 1))
    ends, followed = followed_line(arm, ways.at, flanges, way)
    flanges[:, :3, 3] += way
    back = -APPROACH * (node.world_from_part @ fit.mover.grasps.part_from_hand[ways.grasp])[:, :3, 2]
    _, left = followed_line(arm, ends, flanges, back)
    return replace(ways, above=ends).take(followed & left)


def mated(insertion: Insertion, part: str, to: str) -> Contact:
    """The contact that joined parts may have: free again a bit back along the way."""
    return Contact(to, part, -insertion.way / np.linalg.norm(insertion.way))


def same_pose(a: Array, b: Array) -> bool:
    """Whether poses (4, 4) are alike, but for what inverse kinematics leaves."""
    return bool(np.abs(a - b).max() < _SAME)


def _holding_ways(graph: RegraspGraph, fit: Fit, world_from_to: Array, hold: Mask) -> Reach:
    """The ways of the holding arm; where it holds the part there already, that one."""
    if graph.held is not None and same_pose(world_from_to, graph.start.world_from_part):
        held = graph.ways(graph.start, fit.to_arm, hold)
        return held.take(hold[held.grasp] & (graph.held.arm == fit.to_arm))
    node = Node(f"{fit.to} at a meeting", world_from_to, None, to_leave=False)
    return graph.reacher.hand_ways(node, fit.to_arm, hold)


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
            both = _both_held(state, fit, hold, move)
            if _free_along(scene, both, fit, held.at[i[row]], moved.at[j[row]], moved.above[j[row]]):
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


def _free_along(scene: Scene, state: SceneState, fit: Fit, hold: Array, start: Array, end: Array) -> bool:
    """Whether all is free here and there along the straight way, the end first."""
    checker, q = scene.checker(state, {fit.arm, fit.to_arm}), np.array(state.q)
    q[fit.holder.arm.indices] = hold
    for joints in np.linspace(end, start, _LOOKS):
        q[fit.mover.arm.indices] = joints
        if not checker.free(q):
            return False
    return True
