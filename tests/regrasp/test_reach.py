"""Reach: poses by forward kinematics, freedom by the reference, answers that do not depend on how they are asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tabletops import robot_with_hands, tabletop
from witness import Witness

from kumitate.errors import InputError, UnknownNameError
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.reach import (
    APPROACH,
    LIFT,
    Holder,
    Node,
    Reacher,
    followed_line,
)
from kumitate.robots.library import load_hand, load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact
from kumitate.transforms import invert, pose, pose_distance

ARMS = ("left", "right")
N = 60


@pytest.fixture(scope="module", params=["ur3_dual", "nextage"])
def table(request):
    return tabletop(request.param, "bracket")


@pytest.fixture(scope="module")
def grasps(table):
    return table.grasps.thin(N)


@pytest.fixture(scope="module")
def nodes(table):
    """On its side, on its edge, in the air to be handed over, and in the air to be held."""
    x = 0.3 if table.robot.name == "ur3_dual" else 0.4
    lying, standing = table.at([x, 0.15, 0.025]), table.at([x, -0.15, 0.0], [np.pi / 2.0, 0.0, 0.5])
    over = table.at([x, 0.0, 0.25], [0.3, 0.2, 0.1])
    return [
        table.node("lying", lying),
        table.node("standing", standing),
        Node("over", over, None),
        Node("held", over, None, to_leave=False),
    ]


@pytest.fixture(scope="module")
def asked(table, grasps, nodes):
    """A reacher, and all that it finds at each node."""
    reacher = table.reacher(nodes[0].world_from_part, grasps)
    every = np.ones(N, dtype=bool)
    return reacher, {(node.name, arm): reacher.reach(node, arm, every) for node in nodes for arm in ARMS}


def test_every_node_is_reached_and_nowhere_with_all_grasps(asked, nodes):
    found = asked[1]
    for node in nodes:
        counts = [len(np.unique(found[node.name, arm].grasp)) for arm in ARMS]
        assert max(counts) > 3
        assert max(counts) < N


def test_poses_of_the_flange_are_those_that_the_grasps_ask_for(table, grasps, nodes, asked):
    """By the reference's own kinematics; how the hand frame lies on the flange comes from hand and mount."""
    witness = Witness(table.scene)
    for node in nodes:
        for arm in ARMS:
            reach = asked[1][node.name, arm]
            assert (np.diff(reach.grasp) >= 0).all()
            mounted = table.robot.arms[arm]
            chosen = grasps[reach.grasp]
            hands = node.world_from_part @ chosen.part_from_hand
            flanges = hands @ invert(mounted.flange_from_base @ mounted.hand.base_from_hand(chosen.opening))
            back = -APPROACH * hands[:, :3, 2] if node.to_leave else 0.0
            up = [0.0, 0.0, LIFT] if node.support else [0.0, 0.0, 0.0]
            for joints, shift in ((reach.at, 0.0), (reach.before, back), (reach.above, up)):
                wanted = flanges.copy()
                wanted[:, :3, 3] += shift
                for q, target in zip(table.robot.with_joints(table.robot.home, arm, joints), wanted, strict=True):
                    assert (q >= table.robot.lower - 1e-9).all()
                    assert (q <= table.robot.upper + 1e-9).all()
                    witness.poses(asked[0].state, q)
                    distance, angle = pose_distance(witness._frame(f"{arm}_flange"), target)
                    assert distance < 2e-6
                    assert angle < 2e-6


def test_the_robot_is_free_there_by_the_reference(table, grasps, nodes, asked):
    reacher, found = asked
    witness, looked = Witness(table.scene), 0
    for node in nodes:
        there, lifted = reacher.state_at(node), reacher.state.with_pose("bracket", node.world_from_part)
        lifted = lifted.with_pose("bracket", pose([0.0, 0.0, LIFT]) @ node.world_from_part)
        for arm in ARMS:
            reach = found[node.name, arm]
            places = [(there, reach.at), (there, reach.before)] if node.to_leave else []
            places += [(lifted, reach.above)] if node.support else []
            for state, joints in places:
                for grasp, q in zip(reach.grasp, table.robot.with_joints(state.q, arm, joints), strict=True):
                    opened = state.with_opening(arm, grasps.approach_opening[grasp])
                    assert witness.crossing(witness.along(opened, q[None]), state.contacts) == set()
                    looked += 1
    assert looked > 100


def test_closed_hands_touch_the_part_with_their_pads_and_nothing_else(table, grasps, nodes, asked):
    reacher, found = asked
    witness = Witness(table.scene)
    for node in nodes:
        state = reacher.state_at(node)
        for arm in ARMS:
            reach = found[node.name, arm]
            for grasp, q in zip(reach.grasp, table.robot.with_joints(state.q, arm, reach.at), strict=True):
                closed = state.with_opening(arm, grasps.opening[grasp])
                pads = reacher.holders[arm].pads("bracket", int(grasp))
                assert witness.crossing(witness.along(closed, q[None]), [*state.contacts, *pads]) == set()


def test_what_is_dropped_for_the_table_really_comes_within_a_millimetre_of_it(table, grasps, nodes):
    """Counted one by one: a hand closed, open, and open where it comes from."""
    node = nodes[0]
    reacher = table.reacher(node.world_from_part, grasps, ["left"])
    reacher.reach(node, "left", np.ones(N, dtype=bool))
    hand, body = table.robot.hands["left"], table.scene.bodies["table"]
    holder = reacher.holders["left"]
    hits = np.zeros(N, dtype=bool)
    looks = ((grasps.approach_opening, 0.0), (grasps.opening, 0.0), (grasps.approach_opening, APPROACH))
    for openings, back in looks:
        hands = node.world_from_part @ holder.part_from_flange @ holder.arm.flange_from_base
        hands[:, :3, 3] -= back * (node.world_from_part @ grasps.part_from_hand)[:, :3, 2]
        pieces = invert(table.world_from_table) @ hands[:, None] @ hand.base_from_piece(openings)
        for i, row in enumerate(pieces):
            hits[i] |= any(body.touches(p, at, 1e-3) for p, at in zip(hand.pieces, row, strict=True))
    dropped = reacher.dropped()["lying", "left"]
    assert dropped["hand against table"] == hits.sum() > 0


def test_asking_in_parts_gives_the_same_answers_as_asking_at_once(table, grasps, nodes, asked, rng):
    reacher = table.reacher(nodes[0].world_from_part, grasps)
    parts = np.array_split(rng.permutation(N), 4)
    for node in nodes[:3]:
        for arm in ARMS:
            whole = asked[1][node.name, arm]
            for rows in parts:
                wanted = np.isin(np.arange(N), rows)
                got, expected = reacher.reach(node, arm, wanted), whole.take(wanted[whole.grasp])
                np.testing.assert_array_equal(got.grasp, expected.grasp)
                for name in ("at", "before", "above"):
                    np.testing.assert_allclose(getattr(got, name), getattr(expected, name), atol=1e-6)
    assert reacher.dropped() == {key: asked[0].dropped()[key] for key in reacher.dropped()}
    assert reacher.tested() == {key: asked[0].tested()[key] for key in reacher.tested()}


def test_causes_add_up_to_what_was_tested_and_does_not_work(table, grasps, nodes, rng):
    reacher = table.reacher(nodes[0].world_from_part, grasps)
    seen = set()
    for node in nodes:
        for arm in ARMS:
            wanted = rng.random(N) < 0.7
            reach = reacher.reach(node, arm, wanted)
            asked_for, works = reacher.tested()[node.name, arm]
            assert asked_for == wanted.sum()
            assert works == len(np.unique(reach.grasp))
            dropped = reacher.dropped()[node.name, arm]
            assert dropped.total() == asked_for - works
            seen |= {cause for cause, n in dropped.items() if n}
    assert "hand against table" in seen
    assert any(cause.startswith("no inverse kinematics") for cause in seen)


def test_what_is_known_is_not_found_again_and_nodes_with_the_same_pose_share_it(table, grasps, nodes, monkeypatch):
    reacher = table.reacher(nodes[0].world_from_part, grasps, ["left"])
    every = np.ones(N, dtype=bool)
    first = reacher.reach(nodes[0], "left", every)
    monkeypatch.setattr(Reacher, "_evaluate", lambda *_: pytest.fail("asked again"))
    again = reacher.reach(table.node("another name", nodes[0].world_from_part), "left", every)
    np.testing.assert_array_equal(first.at, again.at)
    assert len(reacher.reach(nodes[0], "left", ~every).grasp) == 0


def test_a_part_that_stands_in_something_has_no_ways_and_the_cause_is_told(table, grasps):
    sunk = table.node("sunk", table.at([0.3, 0.1, 0.01]))
    reacher = table.reacher(sunk.world_from_part, grasps, ["left"])
    assert len(reacher.reach(sunk, "left", np.ones(N, dtype=bool)).grasp) == 0
    assert reacher.dropped() == {("sunk", "left"): {"part against table / bracket": N}}


@pytest.mark.parametrize("others", [(), ("other",)])
def test_a_part_may_touch_what_its_node_says_and_nothing_else(others):
    """A block held against a post; another post on its other side is in the way all the same."""
    table = tabletop("ur3_dual", "block")
    at = table.at([0.3, 0.1, 0.3])
    beside = {"post": pose(at[:3, 3] + [-0.025, 0.0, 0.0]), "other": pose(at[:3, 3] + [0.025, 0.0, 0.0])}
    posts = [Body.box(name, [0.02] * 3, fixed=True) for name in ("post", *others)]
    scene = Scene.of(table.robot, [*posts, Body.from_mesh("block", table.part.mesh)])
    state = scene.state({"block": table.at([0.3, -0.3, 0.1]), **{post.name: beside[post.name] for post in posts}})
    holder = Holder.of(table.robot, "left", table.grasps.thin(N))
    found = {}
    for touching in ((), (Contact("post", "block", [1.0, 0.0, 0.0]),)):
        reacher = Reacher(scene, state, "block", {"left": holder})
        node = Node("held", at, None, to_leave=False, touching=touching)
        assert reacher.state_at(node).contacts == touching
        ways = reacher.reach(node, "left", np.ones(N, dtype=bool))
        found[len(touching)] = len(ways.grasp), set(reacher.dropped()["held", "left"])
    assert found[0] == (0, {"part against post / block"})
    assert (found[1][0] > 0) == (not others)
    assert not others or found[1][1] == {"part against other / block"}


def test_grasps_whose_knuckles_would_close_on_the_part_are_dropped():
    """The planner drops them; a user's own may reach so far around the block that knuckles close on its end."""
    table = tabletop("ur3_dual", "block")
    planned, hand, body = table.grasps.thin(N), table.robot.hands["left"], table.scene.bodies["block"]
    grasps = replace(planned, part_from_hand=planned.part_from_hand @ pose([0.0, 0.0, 0.005]))
    node = Node("over", table.at([0.3, 0.1, 0.3], [0.3, 0.2, 0.1]), None)
    reacher = table.reacher(node.world_from_part, grasps, ["left"])
    assert len(reacher.reach(node, "left", np.ones(N, dtype=bool)).grasp)
    others = [i for i, piece in enumerate(hand.pieces) if piece.joint not in {pad.joint for pad in hand.pads}]
    poses = grasps.part_from_hand[:, None] @ hand.hand_from_piece(grasps.opening)
    hits = sum(any(body.touches(hand.pieces[i], row[i]) for i in others) for row in poses)
    assert 0 < hits == reacher.dropped()["over", "left"]["closed hand against block"]


def test_ways_that_are_given_up_are_replaced_by_other_branches_until_there_are_none(table, grasps, nodes):
    node = nodes[2]
    reacher = table.reacher(nodes[0].world_from_part, grasps, ["left"])
    every, witness = np.ones(N, dtype=bool), Witness(table.scene)
    first = reacher.reach(node, "left", every)
    counts = []
    for grasp in np.unique(first.grasp)[:8]:
        others = first.take(first.grasp != grasp)
        given: list[np.ndarray] = []
        while len(ways := reacher.reach(node, "left", np.arange(N) == grasp).grasp):
            assert len(given) < 10
            left = reacher.reach(node, "left", np.arange(N) == grasp)
            assert (left.grasp == grasp).all()
            for q in left.at:
                assert all(np.abs(q - old).max() > 1e-3 for old in given)
                state = reacher.state_at(node).with_opening("left", grasps.approach_opening[grasp])
                configuration = table.robot.with_joints(state.q, "left", q[None])
                assert witness.crossing(witness.along(state, configuration), state.contacts) == set()
            given.append(left.at[0])
            reacher.give_up(node, "left", int(grasp), left.at[0])
            assert len(ways) >= 1
        counts.append(len(given))
        kept = reacher.reach(node, "left", np.isin(np.arange(N), others.grasp))
        np.testing.assert_array_equal(kept.grasp, others.grasp[np.isin(others.grasp, kept.grasp)])
    assert max(counts) > 1 or table.robot.name == "nextage"  # whose arms have few branches


def test_admitted_ways_are_all_there_are(table, grasps, nodes):
    node = nodes[2]
    reacher = table.reacher(nodes[0].world_from_part, grasps, ["left"])
    every = np.ones(N, dtype=bool)
    found = table.reacher(nodes[0].world_from_part, grasps, ["left"]).reach(node, "left", every)
    some = found.take(np.arange(len(found.grasp)) % 2 == 0)
    reacher.admit(node, "left", some)
    got = reacher.reach(node, "left", every)
    np.testing.assert_array_equal(got.grasp, some.grasp)
    np.testing.assert_array_equal(got.at, some.at)
    reacher.give_up(node, "left", int(some.grasp[0]), some.at[0])
    np.testing.assert_array_equal(reacher.reach(node, "left", every).at, some.at[1:])


def test_masks_and_choices_of_ways(asked):
    reach = max(asked[1].values(), key=lambda found: len(found.grasp))
    np.testing.assert_array_equal(np.flatnonzero(reach.mask(N)), np.unique(reach.grasp))
    odd, even = reach.take(reach.grasp % 2 == 1), reach.take(reach.grasp % 2 == 0)
    both = odd.joined(even)
    np.testing.assert_array_equal(both.grasp, reach.grasp)
    np.testing.assert_array_equal(both.above, reach.above)


def test_lines_are_followed_to_their_end_or_not_at_all(table):
    arm = table.robot.arms["left"]
    q = table.robot.home[arm.indices][None]
    start = arm.chain.forward(q)
    way = np.array([[0.0, 0.0, 0.03], [0.0, 0.0, 3.0]])
    end, followed = followed_line(arm, np.repeat(q, 2, axis=0), np.repeat(start, 2, axis=0), way)
    assert followed.tolist() == [True, False]
    np.testing.assert_allclose(arm.chain.forward(end[:1])[0, :3, 3], start[0, :3, 3] + way[0], atol=2e-6)


# Holders, contacts and what carries what


def test_holders_are_refused_where_hand_and_grasps_do_not_fit(grasps):
    robot = robot_with_hands("ur3_dual")
    with pytest.raises(UnknownNameError, match="middle"):
        Holder.of(robot, "middle", grasps)
    with pytest.raises(InputError, match="no hand"):
        Holder.of(load_robot("ur3_dual", {}), "left", grasps)
    with pytest.raises(InputError, match="suction_cup"):
        Holder.of(robot.with_hand("left", load_hand("suction_cup")), "left", grasps)


@pytest.mark.parametrize("i", [0, 7, 31])
def test_pads_touch_the_part_at_its_contacts_and_come_free_when_the_fingers_open(i):
    table = tabletop("ur3_dual", "bracket")
    holder = Holder.of(table.robot, "left", table.grasps.thin(N))
    grasps, hand = holder.grasps, holder.arm.hand
    pads = holder.pads("bracket", i)
    assert len(pads) == len(hand.pads) == 2
    poses = grasps.part_from_hand[i] @ hand.hand_from_piece(grasps.opening[i : i + 1])[0]
    places = {f"left/{piece.name}": (piece, at) for piece, at in zip(hand.pieces, poses, strict=True)}
    body = table.scene.bodies["bracket"]
    for k, contact in enumerate(pads):
        assert contact.first == "bracket"
        assert contact.normal @ grasps.normals[i, k] > 0.8  # outward at the contact of its own finger
        piece, at = places[contact.second]
        moved = at.copy()
        moved[:3, 3] += 0.5e-3 * contact.normal
        assert body.touches(piece, at, margin=1e-4)
        assert not body.touches(piece, moved)


def test_a_cup_touches_with_its_lip():
    robot = load_robot("ur3_dual", {"left": "suction_cup"})
    hand = robot.hands["left"]
    part = tabletop("ur3_dual", "block").part
    grasps = plan_grasps(part, hand)
    (contact,) = Holder.of(robot, "left", grasps).pads("block", 0)
    assert contact.second.startswith("left/")
    np.testing.assert_allclose(contact.normal, grasps.normals[0, 0], atol=1e-6)
