"""Bringing a part where it must be: routes through the regrasp graph, concrete grasps along them, and the motions."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..grasping.grasps import GraspSet
from ..grasping.part import Part
from ..robots.scene import Scene
from ..robots.state import SceneState
from ..transforms import Array
from .clearance import Mask
from .graph import MOST_REGRASPS, Goal, Held, RegraspGraph, Route
from .nodes import between
from .reach import APPROACH, LIFT, Holder, Node, Reach, Reacher
from .report import report_on
from .steps import Attempt, Motions, Step, StepError
from .supports import Support

_log = logging.getLogger(__name__)

_ROUTES_AT_ONCE = 2  # routes with as many regrasps that are compared by their joint travel
_MOST_FAILURES = 24  # motions that may fail before the search ends
_TRIES = 4  # concrete grasps tried along a route
_AT_TARGET = ("transfer", "lower", "open", "retreat")  # motions that fail for what is at the end of a link
_MOST_MEETINGS = 30  # pairs of grasps at a handover that are checked with both arms
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


def bring(
    graph: RegraspGraph, goals: Sequence[Goal], motions: Motions, most_regrasps: int = MOST_REGRASPS
) -> tuple[Route, tuple[Link, ...]]:
    """Search routes to ``goals`` and follow the first that motions are found for; they are added to ``motions``.

    Of routes with equally many regrasps, some are compared by a lower bound on their joint travel.

    Raises:
        NoRegraspError: There is no way.
    """
    failures: list[str] = []
    left = goals
    for regrasps in range(most_regrasps + 1):
        if regrasps and not (left := graph.reachable(left)):
            break
        routes = graph.routes_with(left, regrasps)
        while some := list(itertools.islice(routes, _ROUTES_AT_ONCE)):
            motions.watch()
            chosen = [(route, *choose(graph, route)) for route in some]
            for route, links, travel in sorted(chosen, key=lambda entry: entry[2]):
                if np.isfinite(travel) and (done := _follow_some(graph, route, links, motions, failures)):
                    return route, done
                if len(failures) >= _MOST_FAILURES:
                    raise report_on(graph, goals, failures)
    raise report_on(graph, goals, failures)


def choose(graph: RegraspGraph, route: Route) -> tuple[tuple[Link, ...], float]:
    """The concrete grasps along ``route`` with the least joint travel, and a lower bound on its time [s].

    Nothing and infinity where grasps that were struck out, or arms in each other's way, leave no way.
    """
    ways = [_joined(graph, route, k) for k in range(len(route.arms))]
    clear = {k: _clear(graph, route, k, ways) for k in range(1, len(ways)) if route.nodes[k].support is None}
    for _ in range(_MOST_MEETINGS):
        rows, travel = _cheapest([cost for _, cost in ways], clear)
        if not np.isfinite(travel):
            break
        links = tuple(entry[0][row] for entry, row in zip(ways, rows, strict=True))
        apart = [k for k in clear if not _arms_clear(graph, route.nodes[k], links[k - 1], links[k])]
        if not apart:
            return links, travel
        for k in apart:
            clear[k][rows[k - 1], rows[k]] = False
    return (), np.inf


def _cheapest(costs: Sequence[Array], clear: Mapping[int, Mask]) -> tuple[list[int], float]:
    """The row of each link that together cost least, and what they cost.

    Behind a placement any row will do; behind a handover, the links in ``clear``, only those (i, j) that go together.
    """
    best = [cost.copy() for cost in costs]
    for k in range(len(costs) - 1, 0, -1):
        if k in clear:
            best[k - 1] += np.where(clear[k], best[k], np.inf).min(axis=1, initial=np.inf)
    rows: list[int] = []
    total = 0.0
    for k, cost in enumerate(best):
        open_ = np.where(clear[k][rows[-1]], cost, np.inf) if k in clear else cost
        if not np.isfinite(open_.min(initial=np.inf)):
            return [], np.inf
        rows.append(int(open_.argmin()))
        total += costs[k][rows[-1]]
    return rows, total


def _clear(graph: RegraspGraph, route: Route, k: int, ways: Sequence[tuple[list[Link], Array]]) -> Mask:
    """Which ways of the links before and behind a handover (i, j) have hands that go together."""
    pairs = graph.pairs(route.arms[k - 1], route.arms[k])
    given, taken = (np.array([link.grasp for link in ways[n][0]], dtype=np.intp) for n in (k - 1, k))
    return pairs.clear(given, taken)


def _arms_clear(graph: RegraspGraph, node: Node, giver: Link, taker: Link) -> bool:
    """Whether the robot is free while ``taker`` comes to the part at ``node``, and once ``giver`` leaves it."""
    reacher = graph.reacher
    state = reacher.state_at(node)
    for (stays, joints), (moves, places) in (
        ((giver, giver.target.at), (taker, (taker.source.before, taker.source.at))),
        ((taker, taker.source.at), (giver, (giver.target.before,))),
    ):
        still, moving = reacher.holders[stays.arm], reacher.holders[moves.arm]
        pads = [*still.pads(reacher.part, stays.grasp), *moving.open_contacts(reacher.part, moves.grasp)]
        there = state.with_contacts([*state.contacts, *pads])
        there = there.with_opening(stays.arm, still.grasps.opening[stays.grasp])
        there = there.with_opening(moves.arm, moving.grasps.approach_opening[moves.grasp])
        checker, q = reacher.scene.checker(there, {giver.arm, taker.arm}), np.array(there.q)
        q[still.arm.indices] = joints[0]
        for place in places:
            q[moving.arm.indices] = place[0]
            if not checker.free(q):
                return False
    return True


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
    links = [Link(arm, int(here.grasp[i[r]]), here.take(i[[r]]), there.take(j[[r]])) for r in kept[: 4 * _PAIRED]]
    return links, cost[kept[: 4 * _PAIRED]]


def _follow_some(
    graph: RegraspGraph, route: Route, links: tuple[Link, ...], motions: Motions, failures: list[str]
) -> tuple[Link, ...]:
    """The links of ``route`` for which motions were found, trying other grasps where they fail; nothing if none do."""
    start = motions.mark()
    for _ in range(_TRIES):
        if not links or len(failures) >= _MOST_FAILURES:
            break
        done = 0
        try:
            for done in range(len(links)):
                _follow(graph, route, links, done, motions)
        except StepError as error:
            motions.back_to(start)
            failures.append(Attempt(error, f"{route.nodes[done].name} to {route.nodes[done + 1].name}"))
            _log.info("%s", failures[-1])
            _give_up(graph, route, links, done, error)
            links, _ = choose(graph, route)
        else:
            return links
    return ()


def _give_up(graph: RegraspGraph, route: Route, links: Sequence[Link], k: int, error: StepError) -> None:
    """Strike out what the failed motion of link ``k`` was to or from: a way of an arm to have the part at a node."""
    link, source, target = links[k], route.nodes[k], route.nodes[k + 1]
    if error.arm != link.arm:
        graph.reacher.give_up(source, error.arm, links[k - 1].grasp, links[k - 1].target.at[0])
    elif error.kind in _AT_TARGET:
        graph.reacher.give_up(target, link.arm, link.grasp, link.target.at[0])
    elif graph.held is None or source is not graph.start:
        graph.reacher.give_up(source, link.arm, link.grasp, link.source.at[0])
    else:
        graph.strike(source, target, link.arm, link.grasp)


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
