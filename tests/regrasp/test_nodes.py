"""Nodes between start and goal: they rest on supports, stand clear of everything, and the shortest ways come first."""

from __future__ import annotations

import numpy as np
import pytest
from tabletops import HANDS, TABLES, robot_with_hands, tabletop

from kumitate.regrasp.nodes import between, spots_for
from kumitate.regrasp.placements import find_placements
from kumitate.regrasp.reach import Holder, Node, Reacher
from kumitate.regrasp.supports import Support
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body
from kumitate.transforms import pose, transform_points

ARMS = tuple(HANDS)


class Shop:
    """A bracket on a table with a post and a shelf that stand on it, and a lamp that hangs high above."""

    def __init__(self) -> None:
        self.table = tabletop("ur3_dual", "bracket")
        size, at = TABLES["ur3_dual"]
        self.top = self.table.top
        bodies = {
            "table": (Body.box("table", size, fixed=True), pose(at)),
            "post": (Body.box("post", [0.06, 0.06, 0.2], fixed=True), pose([0.3, 0.0, self.top + 0.1], [0, 0, 0.4])),
            "shelf": (Body.box("shelf", [0.2, 0.3, 0.1], fixed=True), pose([0.6, 0.0, self.top + 0.05])),
            "lamp": (Body.box("lamp", [0.3, 0.3, 0.1], fixed=True), pose([0.4, 0.2, self.top + 0.6])),
        }
        self.bodies = [body for body, _ in bodies.values()]
        part = Body.from_mesh("bracket", self.table.part.mesh)
        self.scene = Scene.of(robot_with_hands("ur3_dual"), [*self.bodies, part])
        self.start = Node("start", self.table.at([0.3, -0.3, 0.025]), "table")
        self.goal = Node("goal", self.table.at([0.3, 0.3, 0.025], [0, 0, 1.0]), "table")
        self.poses = {name: at for name, (_, at) in bodies.items()}
        self.state = self.scene.state({**self.poses, "bracket": self.start.world_from_part})
        self.supports = [Support.top_of(bodies[n][0], bodies[n][1]) for n in ("table", "shelf")]

    def reacher(self, arms=ARMS) -> Reacher:
        grasps = self.table.grasps.thin(10)
        return Reacher(self.scene, self.state, "bracket", {a: Holder.of(self.scene.robot, a, grasps) for a in arms})

    def between(self, arms=ARMS, supports=None, seed=0) -> list[Node]:
        supports = self.supports if supports is None else supports
        rng = np.random.default_rng(seed)
        return list(between(self.reacher(arms), self.table.part, self.start, [self.goal], supports, rng))


@pytest.fixture(scope="module")
def shop() -> Shop:
    return Shop()


@pytest.fixture(scope="module")
def placements(shop) -> list[Node]:
    return spots_for(shop.reacher(), find_placements(shop.table.part), shop.start, [shop.goal], shop.supports)


def test_placements_rest_on_their_supports_and_touch_nothing_else(shop, placements):
    reacher = shop.reacher()
    assert {node.support for node in placements} == {"table", "shelf"}
    for node in placements:
        lowest = transform_points(node.world_from_part, shop.table.part.mesh.vertices)[:, 2].min()
        assert lowest == pytest.approx(shop.top + (0.1 if node.support == "shelf" else 0.0), abs=1e-9)
        assert shop.scene.checker(reacher.state_at(node)).static == ()


def test_names_differ_and_tell_the_placement_the_turn_and_the_support(shop, placements):
    assert len({node.name for node in placements}) == len(placements)
    stable = find_placements(shop.table.part)
    for node in placements:
        which = int(node.name.split()[1].rstrip(","))
        turn = np.radians(float(node.name.split("turned ")[1].split(" deg")[0]))
        expected = pose(rpy=[0.0, 0.0, turn])[:3, :3] @ stable.surface_from_part[which - 1, :3, :3]
        np.testing.assert_allclose(node.world_from_part[:3, :3], expected, atol=1e-9)
        assert f"on {node.support}" in node.name


def test_of_every_placement_turn_and_support_the_few_on_the_shortest_way_come_in_order(shop, placements):
    def way(node: Node) -> float:
        ends = (shop.start.world_from_part, shop.goal.world_from_part)
        return float(sum(np.linalg.norm(node.world_from_part[:3, 3] - end[:3, 3]) for end in ends))

    kinds: dict[str, list[float]] = {}
    for node in placements:
        kinds.setdefault(node.name.rsplit(" (", 1)[0], []).append(way(node))
    on_table = [kind for kind in kinds if kind.endswith("on table")]
    assert len(on_table) == 4 * len(find_placements(shop.table.part))
    for ways in kinds.values():
        assert 1 <= len(ways) <= 5
        np.testing.assert_array_equal(ways, np.sort(ways))
    firsts = [i for i, node in enumerate(placements) if node.name.endswith("(1)")]
    fifths = [i for i, node in enumerate(placements) if node.name.endswith("(5)")]
    assert max(firsts) < min(fifths)


def test_what_hangs_high_keeps_no_spot_and_what_stands_does(shop, placements):
    places = np.array([node.world_from_part[:2, 3] for node in placements if node.support == "table"])
    assert (np.abs(places - [0.4, 0.2]).max(axis=1) < 0.15).any()  # below the lamp
    seen = [transform_points(n.world_from_part, shop.table.part.mesh.vertices) for n in placements]
    post = transform_points(shop.poses["post"], shop.bodies[1].mesh.vertices)
    middle = post.mean(axis=0)[:2]
    assert all(np.linalg.norm(points[:, :2] - middle, axis=1).min() > 0.03 for points in seen)


@pytest.mark.parametrize("spacing", [0.2, 0.02])
def test_only_the_placements_that_are_given_are_spread_and_as_densely_as_asked(shop, spacing):
    stable = find_placements(shop.table.part).take(np.array([1]))
    nodes = spots_for(shop.reacher(), stable, shop.start, [shop.goal], shop.supports[:1], spacing)
    up = [node.world_from_part[2, :3] for node in nodes]
    np.testing.assert_allclose(up, np.tile(stable.surface_from_part[0, 2, :3], (len(nodes), 1)), atol=1e-9)
    weights = [transform_points(node.world_from_part, shop.table.part.center_of_mass[None])[0] for node in nodes]
    between_two = (np.array(weights)[:, None, :2] - np.array(weights)[:, :2]) / spacing
    np.testing.assert_allclose(between_two, np.round(between_two), atol=1e-6)
    assert (np.abs(np.abs(between_two).max(axis=2) - 1.0) < 1e-6).any()  # neighbours on the grid


def test_placements_and_handovers_come_in_turns(shop, placements):
    nodes = shop.between()
    air = [node for node in nodes if node.support is None]
    assert [node.name for node in nodes if node.support] == [node.name for node in placements]
    assert 0 < len(air) <= 64
    assert [node.support is None for node in nodes[: 2 * len(air)]] == [False, True] * len(air)
    assert len({node.name for node in nodes}) == len(nodes)


def test_one_arm_has_no_handovers_and_without_supports_there_are_no_placements(shop):
    assert all(node.support for node in shop.between(arms=("left",)))
    assert all(node.support is None for node in shop.between(supports=[]))
    assert shop.between(arms=("left",), supports=[]) == []


def test_the_same_seed_gives_the_same_nodes(shop):
    a, b, c = (shop.between(seed=seed) for seed in (1, 1, 2))
    assert [(n.name, n.world_from_part.tobytes()) for n in a] == [(n.name, n.world_from_part.tobytes()) for n in b]
    assert [(n.name, n.world_from_part.tobytes()) for n in a] != [(n.name, n.world_from_part.tobytes()) for n in c]
