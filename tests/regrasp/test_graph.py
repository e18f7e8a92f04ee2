"""The search of the regrasp graph against brute force over single grasps; what it strikes out, tells and refuses."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterable, Sequence
from copy import copy

import networkx as nx
import numpy as np
import pytest
from tabletops import Tabletop, tabletop

from kumitate.errors import InputError
from kumitate.regrasp.graph import MOST_REGRASPS, Goal, Held, RegraspGraph
from kumitate.regrasp.handovers import MOST_GRASPS, HandoverPairs, sample_handovers
from kumitate.regrasp.placements import find_placements
from kumitate.regrasp.reach import Holder, Node, Reach, Reacher
from kumitate.regrasp.supports import find_spots

ARMS = ("left", "right")
GRASPS = 70
EVERY_CASE = {0, 1, 2, None}


class Known(Reacher):
    """Answers for some of the grasps of another reacher, with what that one found for all of them."""

    def __init__(self, whole: Reacher, chosen: dict[str, np.ndarray]) -> None:
        holders = {
            arm: Holder.of(whole.scene.robot, arm, whole.holders[arm].grasps[rows]) for arm, rows in chosen.items()
        }
        super().__init__(whole.scene, whole.state, whole.part, holders)
        self.whole, self.chosen = whole, chosen
        self.asked: Counter[str] = Counter()

    def reach(self, node: Node, arm: str, wanted: np.ndarray) -> Reach:
        self.asked[node.name] += int(wanted.sum())
        everything = self.whole.reach(node, arm, np.ones(len(self.whole.holders[arm].grasps), dtype=bool))
        place = np.searchsorted(self.chosen[arm], everything.grasp).clip(max=len(self.chosen[arm]) - 1)
        mine = (self.chosen[arm][place] == everything.grasp) & wanted[place]
        return Reach(place[mine], everything.at[mine], everything.before[mine], everything.above[mine])


class Pool:
    """Placements and handovers of a bracket before two UR3, and what both arms reach there with some grasps."""

    def __init__(self, table: Tabletop) -> None:
        rng = np.random.default_rng(7)
        grasps = table.grasps.thin(GRASPS)
        spots = find_spots(find_placements(table.part), table.support, spacing=0.1).world_from_part
        x, y = spots[:, 0, 3], spots[:, 1, 3]
        near = spots[(x > 0.2) & (x < 0.45) & (np.abs(y) < 0.35)]
        self.placements = [
            table.node(f"placement {i}", pose) for i, pose in enumerate(near[rng.choice(len(near), 16, replace=False)])
        ]
        middle = np.array([0.35, 0.0, table.top + 0.3])
        self.handovers = sample_handovers(table.robot, ARMS, middle, [np.eye(3)], rng)[:10]
        self.reacher = table.reacher(near[0], grasps, ARMS)
        every = np.ones(len(grasps), dtype=bool)
        self.works = {
            (node.name, arm): self.reacher.reach(node, arm, every).mask(len(grasps))
            for node in (*self.placements, *self.handovers)
            for arm in ARMS
        }
        self.clear: dict[tuple[str, str], np.ndarray] = {}
        for giver, taker in itertools.permutations(ARMS):
            pairs = HandoverPairs(self.reacher.holders[giver], self.reacher.holders[taker])
            everything = np.arange(len(grasps))
            self.clear[giver, taker] = pairs.clear(everything, everything)


@pytest.fixture(scope="module")
def pool() -> Pool:
    return Pool(tabletop("ur3_dual", "bracket"))


def brute_force(
    pool: Pool, start: Node, goal: Node, between: Sequence[Node], chosen: dict[str, np.ndarray]
) -> int | None:
    """Regrasps of the shortest way in a graph with a node for each node, arm and grasp; None if there is no way."""
    graph = nx.DiGraph()
    graph.add_nodes_from(["source", "sink"])
    nodes = (start, *between, goal)
    single = {
        node: [(node.name, arm, int(g)) for arm in chosen for g in chosen[arm] if pool.works[node.name, arm][g]]
        for node in nodes
    }
    for a, b in itertools.permutations(nodes, 2):  # carried: the same arm and grasp at both ends
        graph.add_edges_from(((a.name, *way), (b.name, *way)) for _, *way in single[a] if (b.name, *way) in single[b])
    nx.set_edge_attributes(graph, 0, "weight")
    for node in between:
        for here, there in itertools.permutations(single[node], 2):
            (_, giver, g), (_, taker, h) = here, there
            if node.support is not None or (giver != taker and pool.clear[giver, taker][g, h]):
                graph.add_edge(here, there, weight=1)
    graph.add_edges_from((("source", way) for way in single[start]), weight=0)
    graph.add_edges_from(((way, "sink") for way in single[goal]), weight=0)
    try:
        return int(nx.shortest_path_length(graph, "source", "sink", weight="weight"))
    except nx.NetworkXNoPath:
        return None


def drawn(pool: Pool, seed: int):
    """A random start, goal, nodes between and grasps of either arm."""
    rng = np.random.default_rng(seed)
    start, goal, *some = (pool.placements[i] for i in rng.permutation(len(pool.placements))[: rng.integers(2, 7)])
    air = [pool.handovers[i] for i in rng.permutation(len(pool.handovers))[: rng.integers(0, 5)]]
    chosen = {arm: np.sort(rng.choice(GRASPS, rng.integers(10, 31), replace=False)) for arm in ARMS}
    between = [(*some, *air)[i] for i in rng.permutation(len(some) + len(air))]
    return start, goal, between, chosen


def searched(pool: Pool, start: Node, goal: Node, between: Iterable[Node], chosen: dict[str, np.ndarray]):
    graph = RegraspGraph(Known(pool.reacher, chosen), start, None, between)
    return graph, graph.routes([Goal(goal, allowed(chosen))])


def allowed(chosen: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {arm: np.ones(len(rows), dtype=bool) for arm, rows in chosen.items()}


def test_the_first_route_has_as_few_regrasps_as_brute_force_finds(pool):
    cases: Counter[int | None] = Counter()
    for seed in range(100):
        start, goal, between, chosen = drawn(pool, seed)
        expected = brute_force(pool, start, goal, between, chosen)
        if expected is not None and expected > MOST_REGRASPS:
            expected = None
        route = next(searched(pool, start, goal, between, chosen)[1], None)
        assert (None if route is None else route.regrasps) == expected
        cases[expected] += 1
    assert all(cases[case] >= 3 for case in EVERY_CASE)


def test_routes_come_by_their_regrasps_and_every_grasp_on_them_works(pool):
    seen = set()
    for seed in range(40):
        start, goal, between, chosen = drawn(pool, seed)
        routes = list(itertools.islice(searched(pool, start, goal, between, chosen)[1], 40))
        counts = [route.regrasps for route in routes]
        assert counts == sorted(counts)
        seen |= set(counts)
        for route in routes:
            assert route.nodes[0] is start
            assert route.nodes[-1] is goal
            assert len(route.arms) == len(route.masks) == len(route.nodes) - 1
            works = pool.works
            for (a, b), arm, mask in zip(itertools.pairwise(route.nodes), route.arms, route.masks, strict=True):
                grasps = chosen[arm][mask]
                assert len(grasps) > 0
                assert works[a.name, arm][grasps].all()
                assert works[b.name, arm][grasps].all()
            for k, node in enumerate(route.nodes[1:-1], start=1):
                giver, taker = route.arms[k - 1], route.arms[k]
                if node.support is None:
                    given, taken = (chosen[arm][route.masks[i]] for arm, i in ((giver, k - 1), (taker, k)))
                    assert giver != taker
                    assert pool.clear[giver, taker][np.ix_(given, taken)].any(axis=0).all()
    assert seen >= {0, 1, 2, 3}


def test_with_a_direct_way_nothing_between_is_looked_at(pool):
    for seed in range(40):
        start, goal, between, chosen = drawn(pool, seed)
        if brute_force(pool, start, goal, between, chosen) == 0:
            graph, routes = searched(pool, start, goal, (pytest.fail("opened") for _ in between), chosen)
            assert next(routes).nodes == (start, goal)
            assert set(graph.reacher.asked) == {start.name, goal.name}
            return
    pytest.fail("no seed has a direct way")


def test_only_the_arms_and_grasps_that_a_goal_allows_bring_the_part_there(pool):
    arms = set()
    for seed in range(30):
        start, goal, between, chosen = drawn(pool, seed)
        for arm, other in itertools.permutations(ARMS):
            rng = np.random.default_rng(seed)
            some = {arm: rng.random(len(chosen[arm])) < 0.5}
            graph = RegraspGraph(Known(pool.reacher, chosen), start, None, between)
            for route in itertools.islice(graph.routes([Goal(goal, some)], most_regrasps=2), 10):
                assert route.arms[-1] == arm != other
                assert not (route.masks[-1] & ~some[arm]).any()
                arms.add(arm)
    assert arms == set(ARMS)


def test_a_part_that_is_held_starts_with_the_grasp_it_is_held_with(pool):
    found = 0
    for seed in range(60):
        start, goal, between, chosen = drawn(pool, seed)
        for arm in ARMS:
            held = Held(arm, len(chosen[arm]) // 2, np.zeros(6))
            graph = RegraspGraph(Known(pool.reacher, chosen), Node("start", start.world_from_part, None), held, between)
            for route in itertools.islice(graph.routes([Goal(goal, allowed(chosen))], most_regrasps=1), 5):
                assert route.arms[0] == arm
                assert np.flatnonzero(route.masks[0]).tolist() == [held.grasp]
                np.testing.assert_array_equal(graph.ways(graph.start, arm, route.masks[0]).at, [held.joints])
                found += 1
    assert found > 10


def test_a_route_whose_grasps_are_struck_out_does_not_come_again(pool):
    struck = 0
    for seed in range(30):
        start, goal, between, chosen = drawn(pool, seed)
        graph, routes = searched(pool, start, goal, between, chosen)
        before = list(itertools.islice(routes, 200))
        if not 2 <= len(before) < 200:
            continue
        first = before[0]
        source, target, arm = first.nodes[0], first.nodes[1], first.arms[0]
        for grasp in np.flatnonzero(first.masks[0]):
            graph.strike(source, target, arm, int(grasp))
        assert not graph.unstruck(source, target, arm, first.masks[0]).any()
        np.testing.assert_array_equal(graph.unstruck(target, source, arm, first.masks[0]), first.masks[0])

        def links(route):
            return list(zip(route.nodes, route.nodes[1:], route.arms, strict=False))

        after = list(graph.routes([Goal(goal, allowed(chosen))]))
        kept = [route for route in before if (source, target, arm) not in links(route)]
        assert [links(route) for route in after] == [links(route) for route in kept]
        struck += 1
    assert struck > 3


class Told:
    """Pairs of chosen grasps that go together, as a pool tells them."""

    def __init__(self, pool: Pool, giver: str, taker: str, chosen: dict[str, np.ndarray]) -> None:
        self.known = pool.clear[giver, taker][np.ix_(chosen[giver], chosen[taker])]

    def clear(self, given: np.ndarray, taken: np.ndarray) -> np.ndarray:
        return self.known[np.ix_(given, taken)]


def test_given_pairs_decide_which_grasps_meet_at_a_handover(pool):
    """From the left hand into the right one only odd grasps shall go; the other way as ever."""
    fewer = copy(pool)
    odd = np.arange(GRASPS) % 2 == 1
    fewer.clear = {**pool.clear, ("left", "right"): pool.clear["left", "right"] & odd}
    cases: Counter[int | None] = Counter()
    changed = 0
    for seed in range(100):
        start, goal, between, chosen = drawn(pool, seed)
        air = [node for node in between if node.support is None]
        pairs = {("left", "right"): Told(fewer, "left", "right", chosen)}
        graph = RegraspGraph(Known(pool.reacher, chosen), start, None, air, pairs)
        assert graph.pairs("left", "right") is pairs["left", "right"]
        expected = brute_force(fewer, start, goal, air, chosen)
        if expected is not None and expected > MOST_REGRASPS:
            expected = None
        route = next(graph.routes([Goal(goal, allowed(chosen))]), None)
        assert (None if route is None else route.regrasps) == expected
        cases[expected] += 1
        changed += brute_force(pool, start, goal, air, chosen) != expected
    assert all(cases[case] >= 3 for case in (0, 1, None))
    assert changed > 0


def test_goals_that_no_grasp_reaches_are_given_up(pool):
    start, goal, between, chosen = drawn(pool, 0)
    graph, _ = searched(pool, start, goal, between, chosen)
    everywhere = [Goal(node, allowed(chosen)) for node in (*pool.placements, *pool.handovers)]
    reachable = {g.node.name for g in graph.reachable(everywhere)}
    expected = {node for (node, arm), works in pool.works.items() if works[chosen[arm]].any()}
    assert reachable == expected
    assert 0 < len(graph.reachable(everywhere)) < len(everywhere) or expected == {g.node.name for g in everywhere}


def test_what_was_seen_as_a_graph_of_networkx(pool):
    """With few regrasps and all routes asked for, links carry the number of grasps that both ends share."""
    start, goal, between, chosen = next(
        problem for problem in (drawn(pool, seed) for seed in range(100)) if brute_force(pool, *problem) == 2
    )
    graph, _ = searched(pool, start, goal, between, chosen)
    assert list(graph.routes([Goal(goal, allowed(chosen))], most_regrasps=2))
    seen = graph.networkx()
    kinds = nx.get_node_attributes(seen, "kind")
    assert kinds[start.name] == "start"
    assert kinds[goal.name] == "goal"
    for node in between:
        assert kinds[node.name] == ("placement" if node.support else "handover")
    assert seen.number_of_edges() > 0
    for a, b, data in seen.edges(data=True):
        rows = chosen[data["arm"]]
        both = pool.works[a, data["arm"]][rows] & pool.works[b, data["arm"]][rows]
        assert 0 < data["shared"] <= both.sum()
    leaving = [data for _, _, data in seen.edges(start.name, data=True)]
    assert leaving


def test_two_nodes_of_one_name_are_refused(pool):
    start, goal, between, chosen = next(
        problem for problem in (drawn(pool, seed) for seed in range(100)) if brute_force(pool, *problem) != 0
    )
    for wrong in ([between[0], between[0]], [start]):
        graph = RegraspGraph(Known(pool.reacher, chosen), start, None, wrong)
        with pytest.raises(InputError, match="same name"):
            list(graph.routes([Goal(goal, allowed(chosen))]))


def test_at_a_handover_only_well_spread_grasps_are_paired(pool):
    start, _, between, chosen = drawn(pool, 0)
    graph = RegraspGraph(Known(pool.reacher, chosen), start, None, between)
    mask = np.arange(len(chosen["left"])) % 2 == 0
    np.testing.assert_array_equal(graph.spread("left", mask), np.flatnonzero(mask))
    table = tabletop("ur3_dual", "bracket")
    many = RegraspGraph(table.reacher(start.world_from_part, table.grasps.thin(300)), start, None, between)
    spread = many.spread("left", np.ones(300, dtype=bool))
    assert len(spread) == MOST_GRASPS
    assert (np.diff(spread) > 0).all()
