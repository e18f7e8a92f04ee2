"""Bringing a part where it must be: routes through the regrasp graph, concrete grasps along them, and the motions."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..grasping.grasps import GraspSet
from ..grasping.part import Part
from ..robots.scene import Scene
from ..robots.state import SceneState
from ..transforms import Array
from .graph import MOST_REGRASPS, Goal, Held, RegraspGraph, Route
from .handovers import HandoverPairs
from .nodes import between
from .reach import APPROACH, LIFT, Holder, Node, Reach, Reacher
from .report import report_on
from .steps import Motions, Step, StepError
from .supports import Support

_ROUTES_AT_ONCE = 4  # routes with as many regrasps that are compared by their joint travel
_MOST_ROUTES = 24
_TRIES = 4  # concrete grasps tried along a route
_PAIRED = 40  # ways a side of a handover that are paired, those with the least travel


@dataclass(frozen=True, eq=False)
class Link:
    """A concrete link of a route: an arm with one grasp, and its joints at both ends (one row each)."""

    arm: str
    grasp: int
    source: Reach
    target: Reach


@dataclass(frozen=True, eq=False)
class Regrasp:
    """How a part comes to its goal.

    Attributes:
        steps: The motions.
        route: The way through the graph.
        links: The concrete grasps along it.
        state: Where everything is at the end.
    """

    steps: tuple[Step, ...]
    route: Route
    links: tuple[Link, ...]
    state: SceneState


def plan_regrasp(
    scene: Scene,
    state: SceneState,
    part: Part,
    grasps: Mapping[str, GraspSet],
    goals: Sequence[Node],
    supports: Sequence[Support] = (),
    *,
    rests_on: str | None = None,
    held: Held | None = None,
    arms: Sequence[str] | None = None,
    speed: float = 0.5,
    seed: int = 0,
) -> Regrasp:
    """Bring a part from where it is to the first of ``goals`` that can be reached, with as few regrasps as possible.

    Args:
        scene: The scene, with a body of the part's name.
        state: Where everything is; the part rests with its contact among the state's contacts, or is held.
        part: The part.
        grasps: Its grasps by arm.
        goals: Where it may end: placements, where it is let go, or poses in the air (not ``to_leave``).
        supports: Where it may be put down on the way.
        rests_on: The body on which it rests at the start, if it does.
        held: How it is held at the start, if it is.
        arms: The arms that may bring it to the goal; any unless given.
        speed: Share of the velocity limits to use.
        seed: Seed of all samples and searches.

    Raises:
        NoRegraspError: There is no way; the error names the cause and what was tried.
    """
    holders = {arm: Holder.of(scene.robot, arm, found) for arm, found in grasps.items()}
    start = Node("start", scene.world_from_body(state, part.name), rests_on)
    reacher = Reacher(scene, state, part.name, holders)
    rng = np.random.default_rng(seed)
    graph = RegraspGraph(reacher, start, held, between(reacher, part, start, goals, supports, rng))
    allowed = {arm: np.ones(len(h.grasps), dtype=bool) for arm, h in holders.items() if arms is None or arm in arms}
    motions = Motions(scene, state, speed, seed)
    route, links = bring(graph, [Goal(goal, allowed) for goal in goals], motions)
    return Regrasp(tuple(motions.steps), route, links, motions.state)


def bring(graph: RegraspGraph, goals: Sequence[Goal], motions: Motions) -> tuple[Route, tuple[Link, ...]]:
    """Search routes to ``goals`` and follow the first that motions are found for; they are added to ``motions``.

    Of routes with equally many regrasps, some are compared by a lower bound on their joint travel.

    Raises:
        NoRegraspError: There is no way.
    """
    failures: list[str] = []
    tried = 0
    for regrasps in range(MOST_REGRASPS + 1):
        routes = graph.routes_with(goals, regrasps)
        while some := list(itertools.islice(routes, _ROUTES_AT_ONCE)):
            chosen = [(route, *choose(graph, route)) for route in some]
            for route, links, travel in sorted(chosen, key=lambda entry: entry[2]):
                if np.isfinite(travel) and (done := _follow_some(graph, route, links, motions, failures)):
                    return route, done
                tried += 1
            if tried >= _MOST_ROUTES:
                raise report_on(graph, goals, failures)
    raise report_on(graph, goals, failures)


def choose(graph: RegraspGraph, route: Route) -> tuple[tuple[Link, ...], float]:
    """The concrete grasps along ``route`` with the least joint travel, and a lower bound on its time [s].

    Nothing and infinity where grasps that were struck out leave no way.
    """
    chains, total = [_joined(graph, route, k) for k in range(len(route.arms))], 0.0
    # Behind a placement any grasp will do; behind a handover only those that go with the giver's.
    best = [cost.copy() for _, cost in chains]
    for k in range(len(chains) - 2, -1, -1):
        if route.nodes[k + 1].support is None:
            clear = _pairs(graph, route, k).clear(_grasps(chains[k][0]), _grasps(chains[k + 1][0]))
            best[k] += np.where(clear, best[k + 1], np.inf).min(axis=1, initial=np.inf)
    links: list[Link] = []
    for k, (ways, _) in enumerate(chains):
        cost = best[k]
        if k and route.nodes[k].support is None:
            clear = _pairs(graph, route, k - 1).clear(np.array([links[-1].grasp]), _grasps(ways))[0]
            cost = np.where(clear, cost, np.inf)
        elif len(cost):
            total += cost.min()
        if not len(cost) or not np.isfinite(cost.min()):
            return (), np.inf
        links.append(ways[int(cost.argmin())])
    return tuple(links), total


def _joined(graph: RegraspGraph, route: Route, k: int) -> tuple[list[Link], Array]:
    """The ways along link ``k`` with the least joint travel, a few of each of the most useful grasps, and its time."""
    arm, source, target = route.arms[k], route.nodes[k], route.nodes[k + 1]
    mask = graph.unstruck(source, target, arm, route.masks[k])
    here, there = graph.ways(source, arm, mask), graph.ways(target, arm, mask)
    i, j = np.nonzero(here.grasp[:, None] == there.grasp)
    robot = graph.reacher.scene.robot
    speed = robot.velocity[robot.arm(arm).indices]
    time = (np.abs(here.above[i] - there.above[j]) / speed).max(axis=1, initial=0.0)
    quality = graph.reacher.holders[arm].grasps.quality[here.grasp[i]]
    cost = time + (1.0 - quality)  # a firm grasp is worth a second
    handover = [n for n in (source, target) if n.support is None and n in graph.nodes]
    kept = np.argsort(cost, kind="stable")[: None if not handover else 4 * _PAIRED]
    if handover:
        spread = graph.spread(arm, route.masks[k])
        kept = np.concatenate([kept[:_PAIRED], kept[_PAIRED:][np.isin(here.grasp[i[kept[_PAIRED:]]], spread)]])
    links = [Link(arm, int(here.grasp[i[r]]), here.take([i[r]]), there.take([j[r]])) for r in kept[: 4 * _PAIRED]]
    return links, cost[kept[: 4 * _PAIRED]]


def _pairs(graph: RegraspGraph, route: Route, k: int) -> HandoverPairs:
    return graph.pairs(route.arms[k], route.arms[k + 1])


def _grasps(links: Sequence[Link]) -> np.ndarray:
    return np.array([link.grasp for link in links], dtype=np.intp)


def _follow_some(
    graph: RegraspGraph, route: Route, links: tuple[Link, ...], motions: Motions, failures: list[str]
) -> tuple[Link, ...]:
    """The links of ``route`` for which motions were found, trying other grasps where they fail; nothing if none do."""
    start = motions.mark()
    for _ in range(_TRIES):
        if not links:
            break
        done = 0
        try:
            for done in range(len(links)):
                _follow(graph, route, links, done, motions)
        except StepError as error:
            motions.back_to(start)
            failures.append(f"{route.nodes[done].name} to {route.nodes[done + 1].name}: {error}")
            graph.strike(route.nodes[done], route.nodes[done + 1], links[done].arm, links[done].grasp)
            links, _ = choose(graph, route)
        else:
            return links
    return ()


def _follow(graph: RegraspGraph, route: Route, links: Sequence[Link], k: int, motions: Motions) -> None:
    """The motions of one link: take the part, lift it or be given it, carry it, put it down."""
    link, source, target = links[k], route.nodes[k], route.nodes[k + 1]
    part, holder = graph.reacher.part, graph.reacher.holders[link.arm]
    if graph.held is None or source is not graph.start:
        motions.take(holder, part, link.grasp, link.source.before[0])
    if k and source.support is None:
        giver = graph.reacher.holders[links[k - 1].arm]
        motions.give(giver, part, links[k - 1].grasp)
        motions.retreat(giver, part, links[k - 1].grasp, APPROACH)
    if source.support is not None:
        motions.lift(holder, part, link.grasp, LIFT)
    words = f"{link.arm} arm carries {part}"
    motions.free({link.arm: link.target.above[0]}, "transfer", words, part, grasp=holder.row(link.grasp))
    if target.support is not None:
        motions.lower(holder, part, link.grasp, target.world_from_part, target.support)
        motions.give(holder, part, link.grasp)
        motions.retreat(holder, part, link.grasp, APPROACH)
