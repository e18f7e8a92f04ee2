"""A job under way: the cell, the motions so far, and what is known of the parts that they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..grasping.grasps import GraspSet
from ..grasping.joined import hold_whole, join_parts
from ..grasping.part import Part
from ..grasping.store import cached_grasps, grasp_key
from ..regrasp.clearance import Mask, hands_hit
from ..regrasp.graph import MOST_REGRASPS, Goal, Held, RegraspGraph
from ..regrasp.nodes import between
from ..regrasp.planner import Link, bring
from ..regrasp.reach import Holder, Node, Reacher
from ..regrasp.rest import root_of
from ..regrasp.steps import Motions
from ..robots.state import Body, SceneState
from ..transforms import Array, invert, pose
from .cell import Cell
from .deadline import Deadline

_SAME = 1e-9
_MOST_GRASPS = 1000  # well-spread grasps of a part; more take time and open hardly any new way


@dataclass(frozen=True, eq=False)
class Mark:
    """A moment of a job: how many steps there were, where everything was, and how it was held."""

    steps: int
    state: SceneState
    used: dict[str, GraspSet]


@dataclass(frozen=True, eq=False)
class Whole:
    """A part with all that is assembled to it, in its own frame.

    Attributes:
        part: Both joined into one.
        others: Names of what is assembled to it.
        poses: Pose (4, 4) of each of those in the part's frame.
        holders: The grasps of the whole by the arms' hands.
    """

    part: Part
    others: tuple[str, ...]
    poses: tuple[Array, ...]
    holders: dict[str, Holder]

    def bodies(self) -> list[tuple[str, Array]]:
        """Its bodies by name, each with its pose (4, 4) in the part's frame."""
        return [(self.part.name, np.eye(4)), *zip(self.others, self.poses, strict=True)]


class Job:
    """Plans one thing after the other in a cell; what is planned so far is in ``motions``.

    Attributes:
        cell: The cell.
        seed: Seed of all samples and searches.
        motions: The motions so far, and where everything is after them.
        tell: Reports what is being done.
    """

    def __init__(self, cell: Cell, seed: int, deadline: Deadline) -> None:
        self.cell, self.seed, self.tell = cell, seed, deadline.tell
        self.motions = Motions(cell.scene, cell.state, cell.task.speed, seed, deadline.check)
        self._used: dict[str, GraspSet] = {}
        self._grasps: dict[tuple[str, ...], GraspSet] = {}
        self._wholes: dict[tuple[object, ...], Whole] = {}

    # Parts ------------------------------------------------------------------------------------------------------------

    def root(self, part: str) -> str:
        """The part that ``part`` is assembled to, directly or not; itself if to none."""
        return root_of(self.motions.state, part)

    def pose(self, part: str) -> Array:
        """Pose (4, 4) of ``part`` in the world."""
        return self.cell.scene.world_from_body(self.motions.state, part)

    def rests_on(self, part: str) -> str | None:
        """The body on which ``part`` rests, if it does."""
        state = self.motions.state
        if part in state.attached:
            return None
        below = (c.first for c in state.contacts if c.second == part and c.first in self.cell.scene.bodies)
        return next(below, None)

    def held(self, part: str) -> Held | None:
        """How an arm holds ``part``, if one does."""
        arm = self.motions.state.carrier(part)[0]
        if not arm:
            return None
        used, holders = self._used[part], self.whole(part).holders
        same = np.abs(holders[arm].grasps.part_from_hand - used.part_from_hand).max(axis=(1, 2)) < _SAME
        if not same.any():  # the whole is too heavy for it, or in its way; still that is how it is held
            same = np.append(same, True)
            holders[arm] = Holder.of(self.cell.robot, arm, holders[arm].grasps.joined(used))
        return Held(arm, int(same.argmax()), self.motions.state.q[self.cell.robot.arm(arm).indices])

    def used(self, part: str) -> GraspSet:
        """The grasp, as a set of one, with which an arm holds ``part``."""
        return self._used[part]

    def whole(self, part: str) -> Whole:
        """``part`` with all that is assembled to it now, and the grasps that hold it."""
        state = self.motions.state
        others = sorted(name for name in state.attached if name != part and self.root(name) == part)
        part_from_world = invert(self.pose(part))
        poses = [part_from_world @ self.pose(other) for other in others]
        key = (part, *others, *(float(round(x, 6)) for pose in poses for x in pose.ravel()))
        if key not in self._wholes:
            alone = self.cell.parts[part]
            joined = join_parts([alone, *(self.cell.parts[other] for other in others)], [np.eye(4), *poses])
            made = Whole(joined, tuple(others), tuple(poses), {})
            for arm in self.cell.robot.hands:
                made.holders[arm] = self.holder(made, arm, self.grasps(part, arm))
            self._wholes[key] = made
        return self._wholes[key]

    def holder(self, whole: Whole, arm: str, grasps: GraspSet) -> Holder:
        """Those of ``grasps`` of a part alone that hold the ``whole`` of it and what is assembled to it."""
        robot, part = self.cell.robot, whole.part.name
        hand = robot.hands[arm]
        holder = Holder.of(robot, arm, hold_whole(grasps, self.cell.parts[part], whole.part, hand))
        regions = [
            (Body.box("region", region.box), from_part @ pose(region.at.xyz, region.at.rpy))
            for name, from_part in whole.bodies()
            for region in self.cell.task.parts[name].no_touch
        ]
        others = [(self.cell.scene.bodies[name], at) for name, at in zip(whole.others, whole.poses, strict=True)]
        for body, at in (*others, *regions):
            base = holder.part_from_flange @ holder.arm.flange_from_base
            clear = ~hands_hit(hand, base, holder.grasps.opening, body, at)
            holder = Holder.of(robot, arm, holder.grasps[clear])
        return holder

    def grasps(self, part: str, arm: str) -> GraspSet:
        """The grasps of ``part`` alone by the hand of ``arm``; of those that were simulated the ones that held."""
        hand, simulated = self.cell.robot.hands[arm], self.cell.simulated.get((part, arm))
        made, parameters = self.cell.parts[part], self.cell.parameters[part]
        key = (grasp_key(made, hand, parameters), hand.name, *self.cell.task.parts[part].grasps.measured)
        if key not in self._grasps:
            self.tell(f"grasps of {part} by {hand.name}")
            grasps = cached_grasps(made, hand, parameters) if simulated is None else simulated.held()
            self._grasps[key] = grasps.thin(_MOST_GRASPS)
        return self._grasps[key]

    # Moving -----------------------------------------------------------------------------------------------------------

    def mark(self) -> Mark:
        """Where to come back to with `back_to`."""
        return Mark(len(self.motions.steps), self.motions.state, dict(self._used))

    def back_to(self, mark: Mark) -> None:
        """Forget all motions since `mark`."""
        del self.motions.steps[mark.steps :]
        self.motions.state, self._used = mark.state, dict(mark.used)

    def graph(self, part: str, goals: Sequence[Node], reacher: Reacher | None = None) -> RegraspGraph:
        """The regrasp graph of ``part``, with what is assembled to it, from where it is now.

        A ``reacher`` of another such graph from here may be given, so that nothing is asked twice.
        """
        whole = self.whole(part)
        start = Node("start", self.pose(part), self.rests_on(part))
        reacher = reacher or Reacher(self.cell.scene, self.motions.state, part, whole.holders, self.motions.watch)
        rng = np.random.default_rng([self.seed, len(self.motions.steps)])
        nodes = between(reacher, whole.part, start, goals, self.cell.supports, rng)
        return RegraspGraph(reacher, start, self.held(part), nodes)

    def bring(self, graph: RegraspGraph, goals: Sequence[Goal], most_regrasps: int = MOST_REGRASPS) -> Link:
        """Bring the part of ``graph`` to one of ``goals``; the last link of its way.

        Raises:
            NoRegraspError: There is no way.
        """
        part = graph.reacher.part
        self.tell(f"a way for {part}")
        _, links = bring(graph, goals, self.motions, most_regrasps)
        self._used[part] = graph.reacher.holders[links[-1].arm].row(links[-1].grasp)
        return links[-1]


def any_grasp(graph: RegraspGraph, pinned: str | None) -> dict[str, Mask]:
    """All grasps by arm; of one arm only, if that is ``pinned``."""
    holders = graph.reacher.holders
    return {arm: np.ones(len(h.grasps), dtype=bool) for arm, h in holders.items() if pinned in (None, arm)}
