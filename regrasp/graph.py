"""The regrasp graph: placements, handovers and goals of one part, joined where an arm's grasps work at both ends.

A node carries, for each arm, a mask over the part's grasps; never one node a grasp. Masks are found when the search
opens a node, and only for the grasps that matter there.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import networkx as nx
import numpy as np

from ..errors import InputError
from ..transforms import Array
from .clearance import Mask
from .handovers import MOST_GRASPS, HandoverPairs
from .reach import Node, Reach, Reacher, Rows

MOST_REGRASPS = 3
_AT_ONCE, _ENOUGH = 10, 20  # givers looked at together at a handover, and takers that suffice on the last link
_MOST_AT_HANDOVER = 200  # grasps of an arm that are looked at for one handover
_MOST_LINKS = 20_000  # links between nodes that are looked at for each number of regrasps
_MOST_TESTS = 100_000  # tests of a grasp at a node, likewise


@dataclass(frozen=True, eq=False)
class Held:
    """Where a part is held by an arm: its grasp and the arm's joints (dof,)."""

    arm: str
    grasp: int
    joints: Array


@dataclass(frozen=True, eq=False)
class Goal:
    """A node to reach, and the grasps (n,) by arm with which the part may come there; no other arm may."""

    node: Node
    allowed: Mapping[str, Mask]


@dataclass(frozen=True, eq=False)
class Route:
    """A way through the graph.

    Attributes:
        nodes: From the start to the goal.
        arms: The arm that carries the part along each of the k links.
        masks: The grasps (n,) with which it can, for each link.
    """

    nodes: tuple[Node, ...]
    arms: tuple[str, ...]
    masks: tuple[Mask, ...]

    @property
    def regrasps(self) -> int:
        """How often the part is held anew on the way."""
        return len(self.arms) - 1


class RegraspGraph:
    """The graph of one part, searched for the fewest regrasps first.

    Args:
        reacher: Finds the grasps that work at a node.
        start: Where the part is.
        held: How it is held there, if it is.
        nodes: Placements and handovers on the way; those in the air are handovers.
        pairs: Which grasps of a giver and a taker go together, where more is asked than that they are clear.
    """

    def __init__(
        self,
        reacher: Reacher,
        start: Node,
        held: Held | None,
        nodes: Iterable[Node],
        pairs: Mapping[tuple[str, str], HandoverPairs] | None = None,
    ) -> None:
        self.reacher, self.start, self.held, self._source = reacher, start, held, nodes
        self._struck: set[tuple[str, str, str, int]] = set()
        self._pairs = dict(pairs or {})
        self._looked = self._most_tests = 0
        self._links: dict[tuple[str, str, str], int] = {}

    @cached_property
    def nodes(self) -> tuple[Node, ...]:
        """Placements and handovers on the way; found when a direct way was not.

        Raises:
            InputError: Two have the same name.
        """
        nodes = tuple(self._source)
        if len({self.start.name, *(node.name for node in nodes)}) < 1 + len(nodes):
            raise InputError("regrasp graph", "two nodes have the same name", "name every node differently")
        return nodes

    @property
    def arms(self) -> tuple[str, ...]:
        """The arms that have grasps of the part."""
        return tuple(self.reacher.holders)

    def routes(self, goals: Sequence[Goal], most_regrasps: int = MOST_REGRASPS) -> Iterator[Route]:
        """Ways to any of ``goals``, those with the fewest regrasps first; exact over the sampled nodes."""
        for regrasps in range(most_regrasps + 1):
            yield from self.routes_with(goals, regrasps)

    def routes_with(self, goals: Sequence[Goal], regrasps: int) -> Iterator[Route]:
        """Ways to any of ``goals`` with exactly so many regrasps."""
        self._looked, self._most_tests = 0, self.reacher.looked + _MOST_TESTS
        wanted = {arm: np.ones(len(self.reacher.holders[arm].grasps), dtype=bool) for arm in self.arms}
        if regrasps == 0:
            wanted = {arm: self._allowed(arm, goals) for arm in self.arms}
        leaving = {arm: self.leaving_start(arm, mask) for arm, mask in wanted.items()}
        yield from self._extended(Route((self.start,), (), ()), leaving, goals, regrasps)

    def strike(self, source: Node, target: Node, arm: str, grasp: int) -> None:
        """Remember that ``arm`` cannot carry the part from ``source`` to ``target`` with ``grasp``."""
        self._struck.add((source.name, target.name, arm, grasp))

    def reachable(self, goals: Sequence[Goal]) -> list[Goal]:
        """Those of ``goals`` to which some allowed grasp can bring the part, from wherever it is taken."""
        return [
            goal
            for goal in goals
            if any(len(self.reacher.reach(goal.node, arm, mask).grasp) for arm, mask in goal.allowed.items())
        ]

    def unstruck(self, source: Node, target: Node, arm: str, mask: Mask) -> Mask:
        """The grasps of ``mask`` (n,) that were not struck out between two nodes."""
        struck = [g for s, t, a, g in self._struck if (s, t, a) == (source.name, target.name, arm)]
        if not struck:
            return mask
        left = mask.copy()
        left[struck] = False
        return left

    def pairs(self, giver: str, taker: str) -> HandoverPairs:
        """Which grasps of two arms go together at a handover."""
        if (giver, taker) not in self._pairs:
            holders = self.reacher.holders
            self._pairs[giver, taker] = HandoverPairs(holders[giver], holders[taker])
        return self._pairs[giver, taker]

    def ways(self, node: Node, arm: str, mask: Mask) -> Reach:
        """The ways of ``arm`` to have the part at ``node`` with grasps of ``mask``; one where it is held at first."""
        if self.held is not None and node is self.start:
            joints = self.held.joints[None]
            return Reach(np.array([self.held.grasp], dtype=np.intp), joints, joints, joints)
        return self.reacher.reach(node, arm, mask)

    def networkx(self) -> nx.MultiGraph:
        """What the search has seen: nodes, and for each link that it found the arm and the number of shared grasps."""
        graph = nx.MultiGraph()
        graph.add_node(self.start.name, kind="start")
        for node in self.nodes:
            graph.add_node(node.name, kind="placement" if node.support else "handover")
        for (source, target, arm), shared in self._links.items():
            if target not in graph:
                graph.add_node(target, kind="goal")
            if shared:
                graph.add_edge(source, target, arm=arm, shared=shared)
        return graph

    # Search -----------------------------------------------------------------------------------------------------------

    def _extended(
        self, route: Route, leaving: Mapping[str, Mask], goals: Sequence[Goal], regrasps: int
    ) -> Iterator[Route]:
        """``route``, which arms can leave with any of the grasps ``leaving``, taken to the goals with more regrasps."""
        here = route.nodes[-1]
        if regrasps == 0:
            for goal, arm in itertools.product(goals, leaving):
                if arm in goal.allowed:
                    shared = self._shared(here, goal.node, arm, leaving[arm] & goal.allowed[arm])
                    if shared.any():
                        yield _along(route, goal.node, arm, shared)
            return
        last, able = goals if regrasps == 1 else None, [arm for arm in leaving if leaving[arm].any()]
        for node, arm in itertools.product(self.nodes if able else (), able):
            if self._looked >= _MOST_LINKS or self.reacher.looked >= self._most_tests:
                return
            seen = node in route.nodes and node.support is not None  # in the air, hands may meet again
            if seen or (last and not self._near_goal(node, arm, last)):
                continue
            shared = self._shared(here, node, arm, leaving[arm])
            if shared.any():
                taken = {taker: self._taken(node, arm, shared, taker, last) for taker in self.arms}
                yield from self._extended(_along(route, node, arm, shared), taken, goals, regrasps - 1)

    def _near_goal(self, node: Node, arm: str, goals: Sequence[Goal]) -> bool:
        """Whether some arm can take the part from ``node``, where ``arm`` has brought it, to a goal."""
        return any(
            self._to_goal(node, taker, goals).any() for taker in self.arms if node.support is not None or taker != arm
        )

    def _to_goal(self, node: Node, arm: str, goals: Sequence[Goal]) -> Mask:
        """The grasps (n,) with which ``arm`` can bring the part from ``node`` to any of the goals."""
        found = np.zeros(len(self.reacher.holders[arm].grasps), dtype=bool)
        for goal in goals:
            if arm in goal.allowed:
                there = self.reacher.reach(goal.node, arm, goal.allowed[arm]).mask(len(found))
                found |= self._shared(node, goal.node, arm, there)
        return found

    def _shared(self, source: Node, target: Node, arm: str, mask: Mask) -> Mask:
        """The grasps of ``mask`` (n,) with which ``arm`` can carry the part from ``source`` to ``target``."""
        self._looked += 1
        if not mask.any():
            return mask
        shared = mask
        for node in (source, target):
            if node.to_leave and node.support is None and node is not self.start:
                shared = _few(shared)
            if shared.any():
                shared = shared & self.ways(node, arm, shared).mask(len(mask))
        shared = self.unstruck(source, target, arm, shared)
        key = (source.name, target.name, arm)
        self._links[key] = max(self._links.get(key, 0), int(shared.sum()))
        return shared

    def _taken(self, node: Node, arm: str, shared: Mask, taker: str, goals: Sequence[Goal] | None) -> Mask:
        """The grasps (n,) with which ``taker`` can have the part at ``node``, where ``arm`` brings it with ``shared``.

        With ``goals``, only those with which it can go on to one of them.
        """
        holder = self.reacher.holders[taker]
        wanted = np.ones(len(holder.grasps), dtype=bool) if goals is None else self._to_goal(node, taker, goals)
        if node.support is not None:
            return self.reacher.reach(node, taker, wanted).mask(len(wanted))
        if taker == arm:
            return np.zeros(len(wanted), dtype=bool)
        can = self.reacher.reach(node, taker, _few(wanted)).mask(len(wanted))
        given, taken = self.spread(arm, shared), self.spread(taker, can)
        both = np.zeros(len(wanted), dtype=bool)
        for some in np.array_split(given, max(len(given) // _AT_ONCE, 1)):
            both[taken] |= self.pairs(arm, taker).clear(some, taken).any(axis=0)
            if goals is not None and both.sum() >= _ENOUGH:
                break
        return both

    def spread(self, arm: str, mask: Mask) -> Rows:
        """At most a hundred well-spread grasps of ``mask``, as indices: those that handovers pair."""
        (indices,) = np.nonzero(mask)
        return indices[self.reacher.holders[arm].grasps[indices].spread(MOST_GRASPS)]

    def leaving_start(self, arm: str, wanted: Mask) -> Mask:
        """Which of the ``wanted`` grasps (n,) ``arm`` can take the part with where it is."""
        if self.held is None:
            return self.reacher.reach(self.start, arm, wanted).mask(len(wanted))
        mask = np.zeros(len(wanted), dtype=bool)
        if self.held.arm == arm:
            mask[self.held.grasp] = wanted[self.held.grasp]
        return mask

    def _allowed(self, arm: str, goals: Sequence[Goal]) -> Mask:
        mask = np.zeros(len(self.reacher.holders[arm].grasps), dtype=bool)
        for goal in goals:
            if arm in goal.allowed:
                mask |= goal.allowed[arm]
        return mask


def _few(mask: Mask) -> Mask:
    """At most two hundred grasps of ``mask`` (n,), of all qualities alike: those that are looked at for a handover."""
    (indices,) = np.nonzero(mask)
    if len(indices) <= _MOST_AT_HANDOVER:
        return mask
    few = np.zeros_like(mask)
    few[indices[np.linspace(0, len(indices) - 1, _MOST_AT_HANDOVER).astype(int)]] = True
    return few


def _along(route: Route, node: Node, arm: str, shared: Mask) -> Route:
    return Route((*route.nodes, node), (*route.arms, arm), (*route.masks, shared))
