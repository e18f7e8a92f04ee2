"""Handing a part over with interlocked fingers: the taker's single finger between the giver's two."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError, NoRegraspError
from ..grasping.interlock import faced, facing_grasps
from ..regrasp.clearance import Mask
from ..regrasp.graph import Goal, Held, RegraspGraph
from ..regrasp.handovers import MOST_GRASPS, HandoverPairs
from ..regrasp.nodes import between
from ..regrasp.reach import Holder, Node, Reach, Reacher
from .job import Job, Whole, any_grasp
from .targets import hold_nodes
from .task import HandOver


class LockedPairs(HandoverPairs):
    """Which grasps of a giver and a taker go together: those whose fingers interlock, if they are clear.

    Args:
        giver: The giver's grasps.
        taker: The taker's.
        faced: (k,) the grasp of the giver that each of the taker's faces; -1 for none.
    """

    def __init__(self, giver: Holder, taker: Holder, faced: npt.NDArray[np.intp]) -> None:
        super().__init__(giver, taker)
        self._faced = faced

    @property
    def facing(self) -> Mask:
        """Which of the taker's grasps (k,) face one of the giver's."""
        return np.asarray(self._faced >= 0)

    def _look(self, pairs: npt.NDArray[np.intp]) -> Mask:
        locked = np.asarray(pairs[:, 0] == self._faced[pairs[:, 1]])
        locked[locked] = super()._look(pairs[locked])
        return locked


@dataclass(frozen=True, eq=False)
class _Lock:
    """Grasps of a giver, those of the taker that face them, and how the part is held now, told in these."""

    holders: dict[str, Holder]
    pairs: LockedPairs
    held: Held | None


def hand_over_interlocked(job: Job, goal: HandOver) -> None:
    """Give the part of ``goal`` to its arm from hand to hand, the fingers interlocked.

    Raises:
        InputError: The hands have not one finger against two.
        NoRegraspError: There is no way.
    """
    part, nodes = job.root(goal.part), hold_nodes(job, goal)
    report: list[str] = []
    givers = [arm for arm, hand in job.cell.robot.hands.items() if arm != goal.to and hand.kind == "three_finger"]
    if not givers:
        problem = f"no hand that could give {goal.part} to the {goal.to} one has one finger against two"
        raise InputError("goal: hand_over", problem, "give both arms such hands, or leave interlocked out")
    for giver in givers:
        graph = job.graph(part, [])
        takeable = graph.leaving_start(giver, any_grasp(graph, giver)[giver])
        for words, rows in (("that it can be taken with", takeable), ("after a regrasp", ~takeable)):
            job.tell(f"grasps of {part} that interlock")
            lock = _lock(job, job.whole(part), giver, goal.to, np.flatnonzero(rows))
            facing = lock.pairs.facing
            report.append(f"{facing.sum()} interlocked grasps by {giver} and {goal.to} arm, of those {words}")
            if facing.any():
                try:
                    graph = _graph(job, part, nodes, lock, (giver, goal.to))
                    job.bring(graph, [Goal(node, {goal.to: facing}) for node in nodes])
                    return
                except NoRegraspError as error:
                    report += error.report
    raise NoRegraspError(part, "no interlocked handover was found", report)


def _lock(job: Job, whole: Whole, giver: str, taker: str, rows: npt.NDArray[np.intp]) -> _Lock:
    """Well-spread grasps ``rows`` of the giver's with those of the taker's that face them."""
    part, hand = whole.part.name, job.cell.robot.hands[taker]
    given = whole.holders[giver].grasps[rows]
    facing = facing_grasps(job.cell.parts[part], hand, given, job.cell.parameters[part])
    job.motions.watch()
    facing = job.holder(whole, taker, facing).grasps.thin(MOST_GRASPS)
    own = faced(given, facing)
    grasps = {giver: given[own], taker: facing}
    order = np.arange(len(own))
    held = job.held(part)
    if held is not None and held.arm == giver and held.grasp in rows[own]:
        held = Held(giver, int(np.flatnonzero(rows[own] == held.grasp)[0]), held.joints)
    elif held is not None and held.arm in grasps:
        now = whole.holders[held.arm].row(held.grasp)
        held = Held(held.arm, len(grasps[held.arm]), held.joints)
        grasps[held.arm] = grasps[held.arm].joined(now)
        order = order if held.arm == giver else np.append(order, -1)
    holders = {arm: Holder.of(job.cell.robot, arm, found) for arm, found in grasps.items()}
    return _Lock(holders, LockedPairs(holders[giver], holders[taker], order), held)


def _graph(job: Job, part: str, goals: list[Node], lock: _Lock, arms: tuple[str, str]) -> RegraspGraph:
    """The regrasp graph in which the taker has the part from the giver's hand only."""
    reacher = Reacher(job.cell.scene, job.motions.state, part, lock.holders, job.motions.watch)
    start = Node("start", job.pose(part), job.rests_on(part))
    rng = np.random.default_rng([job.seed, len(job.motions.steps)])
    nodes = list(between(reacher, job.whole(part).part, start, goals, job.cell.supports, rng))
    taker = lock.holders[arms[1]]
    none = np.zeros((0, taker.arm.chain.dof))
    for node in (start, *(node for node in nodes if node.support is not None)):
        reacher.admit(node, arms[1], Reach(np.zeros(0, dtype=np.intp), none, none, none))
    return RegraspGraph(reacher, start, lock.held, nodes, {arms: lock.pairs})
