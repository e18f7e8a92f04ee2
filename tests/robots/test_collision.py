"""The checker against python-fcl on full meshes, and the laws of contacts and margins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.errors import UnknownNameError
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact, Margins
from kumitate.transforms import invert, pose

# How far the reference's tessellation of a cylinder lies inside the cylinder, and GJK's tolerance.
SLACK = 1e-4
FINGERS = ("left/left_inner_finger", "left/right_inner_finger")


@pytest.fixture(scope="module")
def ur3():
    return load_robot("ur3_dual", {"left": "robotiq_2f85", "right": "robotiq_2f85"})


def compare(scene, states, reference, rng, n_random, n_near):
    """Every missed or unfounded pair, and for random and near states the share of free ones that are refused."""
    judge = reference(scene)
    refused = {"random": [], "near": []}
    wrong = []
    for state in states:
        checker = scene.checker(state)
        assert not checker.static
        drawn = rng.uniform(scene.robot.lower, scene.robot.upper, (n_random, scene.robot.model.nq))
        for kind, configurations in (("random", drawn), ("near", judge.near_states(state, rng, n_near))):
            for q in configurations:
                expected, found = judge.touching(state, q), {frozenset(pair) for pair in checker.touching(q)}
                wrong += [("missed", sorted(pair), q) for pair in expected - found]
                hidden = {pair for pair in found - expected if _hidden(judge, state, q, *pair)}
                wrong += [("apart", sorted(pair), q) for pair in found - expected - hidden]
                assert checker.free(q) == (not found)
                if not expected and not hidden:
                    refused[kind].append(bool(found))
    return wrong, {kind: (len(answers), float(np.mean(answers))) for kind, answers in refused.items()}


def _hidden(judge, state, q, a, b):
    """Whether two bodies whose surfaces do not cross share room all the same, or nearly touch."""
    if judge.contains(state, q, a, b) or judge.contains(state, q, b, a):
        return True
    return judge.distance(state, q, a, b) < SLACK


@pytest.mark.parametrize("name", ["ur3_dual", "nextage"])
def test_no_collision_is_missed_and_names_agree_with_meshes(name, cell, reference, rng, record_property):
    wrong, refused = compare(*cell(name), reference, rng, n_random=150, n_near=50)
    record_property("refused", refused)
    assert not wrong
    assert refused["random"][0] > 60
    assert refused["near"][0] > 50
    assert refused["random"][1] <= 0.05
    assert refused["near"][1] <= 0.2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur3_dual", "nextage", "hrp5p"])
def test_thousands_of_states_agree_with_meshes(name, cell, reference, rng, record_property):
    wrong, refused = compare(*cell(name), reference, rng, n_random=850, n_near=850)
    record_property("refused", refused)
    assert not wrong
    assert refused["random"][1] <= 0.05
    assert refused["near"][1] <= 0.2


def test_near_states_are_near(cell, reference, rng):
    scene, (state, *_) = cell("ur3_dual")
    judge = reference(scene)
    free = [q for q in judge.near_states(state, rng, 30) if not judge.touching(state, q, first_only=True)]
    assert len(free) > 5
    for q in free:
        assert min(judge.distances(state, q, within=0.05).values()) < 0.05


def test_checkers_in_turn_answer_as_fresh_engines_do(cell, rng):
    scene, states = cell("ur3_dual")
    states = [*states, states[0].with_opening("left", 0.01), states[2].with_opening("right", 0.06)]
    checkers = [scene.checker(state) for state in states]
    robot = scene.robot
    for turn in range(8):
        fresh = Scene.of(robot, scene.bodies.values())
        i = rng.integers(len(states))
        alone = fresh.checker(states[i])
        for q in rng.uniform(robot.lower, robot.upper, (10, robot.model.nq)):
            other = checkers[rng.integers(len(states))]
            other.touching(q) if turn % 2 else other.free(q)
            assert set(checkers[i].touching(q)) == set(alone.touching(q))


# Deep collisions between convex shapes --------------------------------------------------------------------------------


def test_deep_collisions_of_single_boxes_are_found_in_every_attitude(ur3, rng):
    # A yes or no of GJK without any distance to keep misses one of some thousand such pairs.
    size = np.array([0.1, 0.2, 0.3])
    others = [Body.box(f"b{i}", rng.uniform(0.02, 0.4, 3), fixed=True) for i in range(50)]
    scene = Scene.of(ur3, [Body.box("a", size), *others])
    poses = {"a": ur3.flange("left", ur3.home), **{body.name: np.eye(4) for body in others}}
    held = scene.attach(scene.state(poses), "a", "left")
    for q in rng.uniform(ur3.lower, ur3.upper, (100, ur3.model.nq)):
        # The centre of every b lies inside a.
        inside = [pose(rng.uniform(-0.45, 0.45, 3) * size, rng.uniform(-np.pi, np.pi, 3)) for _ in others]
        at = {body.name: ur3.flange("left", q) @ a_from_b for body, a_from_b in zip(others, inside, strict=True)}
        found = {pair[1] for pair in scene.checker(replace(held, poses=at)).touching(q) if pair[0] == "a"}
        assert found == set(at)


# Contacts -------------------------------------------------------------------------------------------------------------


def resting(robot, sink, swapped, reverse, contacts=True):
    """A part sunk by ``sink`` into a plate; contact told from either side, bodies in either order; where it touches."""
    bodies = [Body.box("plate", (0.2, 0.2, 0.02), fixed=True), Body.box("part", (0.05, 0.04, 0.03))]
    scene = Scene.of(robot, bodies[::-1] if reverse else bodies)
    plate = pose((1.0, 0.5, 0.4), (0.5, -0.3, 0.8))
    part = plate @ pose((0.0, 0.0, 0.01 + 0.025 - sink), (0.0, np.pi / 2.0, 0.0))
    up = plate[:3, 2]
    contact = Contact("plate", "part", plate[:3, :3].T @ up)
    if swapped:
        contact = Contact("part", "plate", -part[:3, :3].T @ up)
    state = scene.state({"plate": plate, "part": part}).with_contacts([contact] if contacts else [])
    return scene.checker(state).static


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("reverse", [False, True])
def test_contact_excuses_its_tolerance_and_no_more(ur3, swapped, reverse):
    assert resting(ur3, 0.0, swapped, reverse) == ()
    assert resting(ur3, 0.0004, swapped, reverse) == ()
    assert len(resting(ur3, 0.0006, swapped, reverse)) == 1
    assert len(resting(ur3, 0.0002, swapped, reverse, contacts=False)) == 1
    assert resting(ur3, -0.0002, swapped, reverse, contacts=False) == ()


def in_corner(robot, make_mesh, sink_x, sink_y, normals):
    """A block in the inner corner of a bracket, sunk into both plates."""
    scene = Scene.of(
        robot, [Body.from_mesh("corner", make_mesh("bracket", 0.1, 0.01, 0.1)), Body.box("part", [0.04] * 3)]
    )
    corner = pose((1.0, 0.2, 0.5), (0.3, 0.2, 0.1))
    part = corner @ pose((0.03 - sink_x, 0.03 - sink_y, 0.0))
    contacts = [Contact("corner", "part", normal) for normal in normals]
    return scene.checker(scene.state({"corner": corner, "part": part}).with_contacts(contacts)).static


def test_contacts_in_a_corner_excuse_together(ur3, make_mesh):
    x, y, z = np.eye(3)
    assert in_corner(ur3, make_mesh, 0.0003, 0.0003, [x, y]) == ()
    assert in_corner(ur3, make_mesh, 0.0003, 0.0003, [x, y, x]) == ()
    assert len(in_corner(ur3, make_mesh, 0.0003, 0.0003, [x])) == 1
    assert len(in_corner(ur3, make_mesh, 0.0003, 0.0007, [x, y])) == 1
    assert len(in_corner(ur3, make_mesh, 0.0003, 0.0003, [x, z])) == 1
    assert len(in_corner(ur3, make_mesh, 0.0003, 0.0003, [-x, -y])) == 1


def test_a_contact_told_twice_excuses_no_more_than_once(ur3, make_mesh):
    x = np.eye(3)[0]
    assert in_corner(ur3, make_mesh, 0.0004, -0.001, [x, x]) == ()
    assert len(in_corner(ur3, make_mesh, 0.0007, -0.001, [x, x])) == 1


def test_a_contact_refuses_nothing_that_is_apart(ur3, make_mesh):
    # 0.3 mm of play on either side: moved out of the one face, the block would sink into the other.
    scene = Scene.of(
        ur3, [Body.from_mesh("slot", make_mesh("fork", 0.1, 0.02, 0.1)), Body.box("part", [0.0594, 0.06, 0.06])]
    )
    poses = {"slot": pose((1.0, 0.2, 0.5)), "part": pose((1.0, 0.22, 0.5))}
    contact = Contact("slot", "part", np.array([1.0, 0.0, 0.0]))
    assert scene.checker(scene.state(poses).with_contacts([contact])).static == ()


def test_contacts_name_known_bodies(ur3):
    scene = Scene.of(ur3, [Body.box("part", [0.1] * 3)])
    state = scene.state({"part": pose((1.0, 0.0, 0.5))}).with_contacts([Contact("part", "left/pad", np.eye(3)[0])])
    with pytest.raises(UnknownNameError, match="left/pad"):
        scene.checker(state)


# A boss beside a contact ----------------------------------------------------------------------------------------------


def gripped(robot, mesh, carried, contacts=True):
    """What touches a part of 40 mm between the fingers of the left hand that lie on its faces at -x and +x."""
    scene = Scene.of(robot, [Body.from_mesh("part", mesh)])
    at_hand = robot.hand_pose("left", robot.home, 0.04)
    # The single finger is at negative x.
    allowed = [Contact("part", FINGERS[i], np.array([sign, 0.0, 0.0])) for i, sign in enumerate((-1.0, 1.0))]
    state = scene.state({"part": at_hand}, openings={"left": 0.04}).with_contacts(allowed if contacts else [])
    state = scene.attach(state, "part", "left") if carried else state
    checker = scene.checker(state)
    assert bool(checker.static) == (carried and not checker.free(robot.home))
    return {frozenset(pair) for pair in checker.touching(robot.home)}


@pytest.mark.parametrize("carried", [False, True])
def test_pads_on_flat_faces_are_free_only_by_their_contacts(ur3, carried):
    block = trimesh.creation.box((0.04, 0.04, 0.03))
    assert gripped(ur3, block, carried) == set()
    assert gripped(ur3, block, carried, contacts=False) == {frozenset(("part", finger)) for finger in FINGERS}
    assert gripped(ur3, trimesh.creation.box((0.0408, 0.04, 0.03)), carried) == set()
    assert len(gripped(ur3, trimesh.creation.box((0.042, 0.04, 0.03)), carried)) == 2


@pytest.mark.parametrize("carried", [False, True])
@pytest.mark.parametrize(("at", "rise"), [(0.008, 0.003), (0.008, 0.02), (-0.001, 0.001)])
def test_a_boss_beside_the_contact_is_a_collision(ur3, make_mesh, carried, at, rise):
    # The pad is 22 mm wide: it lies on the flat face beside the boss, and 3 mm of it sink into the boss's side.
    boss = make_mesh("bossed", 0.04, at, rise, 0.03)
    assert gripped(ur3, boss, carried) == {frozenset(("part", FINGERS[1]))}
    # The same boss where the pad ends is not in the way.
    beside = make_mesh("bossed", 0.04, 0.0145, rise, 0.03)
    assert gripped(ur3, beside, carried) == set()


# A bracket across an insertion ----------------------------------------------------------------------------------------

RING = (0.011, 0.03, 0.015)


def axle(post):
    """A shaft of radius 10 mm, 80 mm long, on a disc; with a post beside it, 15 to 19 mm off the axis, 50 mm high."""
    profile = np.array([(0, 0), (0.05, 0), (0.05, 0.01), (0.01, 0.01), (0.01, 0.09), (0, 0.09)])
    turned = trimesh.creation.revolve(profile, sections=96)
    bar = trimesh.creation.box((0.004, 0.004, 0.05)).apply_translation((0.017, 0.0, 0.034))
    return trimesh.util.concatenate([turned, bar]) if post else turned


@pytest.mark.parametrize("carried", [False, True])
def test_a_bracket_across_an_insertion_is_a_collision_and_true_play_is_free(ur3, make_mesh, carried):
    part = Body.from_mesh("ring", make_mesh("ring", *RING))
    contacts = [Contact("axle", "ring", normal) for normal in np.eye(3)[[2, 0]]]
    for post in (False, True):
        scene = Scene.of(ur3, [part, Body.from_mesh("axle", axle(post))])
        hand = ur3.hand_pose("left", ur3.home, 0.085)
        # The ring hangs below the hand, its axis along the approach; the axle comes up from below.
        ring = hand @ pose((0.0, 0.0, 0.05), (np.pi, 0.0, 0.0))
        for height in np.linspace(0.0, 0.12, 25):
            for play in (0.0, 0.0008):
                rise = 0.01 + RING[2] / 2.0 + height
                foot = ring @ pose((play, 0.0, -rise), (0.0, 0.0, 0.3))
                state = scene.state({"ring": ring, "axle": foot}).with_contacts(contacts)
                state = scene.attach(state, "ring", "left") if carried else state
                touching = scene.checker(state).touching(ur3.home)
                blocked = post and height < 0.049
                clear = not post or height > 0.0495
                assert blocked or clear
                assert (touching == (("ring", "axle"),)) == blocked
        end = ring @ pose((0.0, 0.0, -0.01 - RING[2] / 2.0))
        bare = scene.state({"ring": ring, "axle": end})
        assert scene.checker(bare).touching(ur3.home) == (("ring", "axle"),)
        aside = scene.state({"ring": ring, "axle": end @ pose((0.0012, 0.0, -0.02))}).with_contacts(contacts[:1])
        assert scene.checker(aside).touching(ur3.home) == (("ring", "axle"),)


# Margins --------------------------------------------------------------------------------------------------------------


def asked(scene, margins, working, a, b):
    """The distance that a pair must keep, told from the names; what stands with the robot's base is no arm's."""
    sides = ["" if "base_link" in name else name.replace("/", "_").split("_")[0] for name in (a, b)]
    hands = ["/" in name for name in (a, b)]
    if any(h and side in working for h, side in zip(hands, sides, strict=True)):
        return 0.0
    bodies = [name in scene.bodies for name in (a, b)]
    if all(bodies):
        return 0.0
    if any(bodies):
        return margins.environment
    arms = {"left", "right"}
    return margins.arms if set(sides) == arms else 0.0


@pytest.mark.parametrize("working", [(), ("left",)])
def test_margins_are_kept_to_the_millimetre(ur3, make_mesh, reference, rng, working):
    margins = Margins(arms=0.03, environment=0.02)
    bodies = [
        Body.box("table", (0.6, 1.2, 0.06), fixed=True),
        Body.from_mesh("bracket", make_mesh("bracket", *[0.1] * 3)),
    ]
    scene, plain = Scene.of(ur3, bodies, margins), Scene.of(ur3, bodies)
    judge = reference(scene)
    # Flanges near each other, and the bracket near the left hand.
    q = rng.uniform(ur3.lower, ur3.upper, (5000, ur3.model.nq))
    left, right = (arm.chain.forward(q[:, arm.indices])[:, :3, 3] for arm in ur3.arms.values())
    kept, broken = 0, {"arms": 0, "environment": 0}
    for at in q[np.argsort(np.linalg.norm(left - right, axis=1))[100:200]]:
        beside = ur3.hand_pose("left", at) @ pose(rng.uniform(-0.12, 0.12, 3), rng.uniform(-3.0, 3.0, 3))
        state = scene.state({"table": pose((0.75, 0.0, 1.05)), "bracket": beside})
        doubtful, too_near = set(), set()
        for pair, distance in judge.distances(state, at, within=0.035).items():
            margin = asked(scene, margins, working, *pair)
            if margin > 0.0 and abs(distance - margin) < 3e-4:
                doubtful.add(frozenset(pair))
            elif 0.0 < distance < margin:
                too_near.add(frozenset(pair))
                broken["arms" if margin == margins.arms else "environment"] += 1
            else:
                kept += margin > 0.0
        expected = {frozenset(pair) for pair in plain.checker(state).touching(at)} | too_near
        found = {frozenset(pair) for pair in scene.checker(state, working).touching(at)}
        assert found - doubtful == expected - doubtful
    assert min(kept, *broken.values()) > 5


def test_margins_spare_contacts_and_what_an_arm_carries(ur3):
    margins = Margins(environment=0.02)
    scene = Scene.of(ur3, [Body.box("block", (0.04, 0.04, 0.03))], margins)
    at_hand = ur3.hand_pose("left", ur3.home, 0.044)
    state = scene.state({"block": at_hand}, openings={"left": 0.044})
    near = {pair[0] for pair in scene.checker(state).touching(ur3.home)}
    assert set(FINGERS) <= near
    assert scene.checker(state, ["left"]).free(ur3.home)
    assert scene.checker(state, ["right"]).touching(ur3.home) == scene.checker(state).touching(ur3.home)
    assert scene.checker(scene.attach(state, "block", "left")).free(ur3.home)
    contact = Contact("block", FINGERS[0], np.array([-1.0, 0.0, 0.0]))
    excused = {pair[0] for pair in scene.checker(state.with_contacts([contact])).touching(ur3.home)}
    assert excused == near - {FINGERS[0]}


def test_margins_hold_between_the_base_and_a_part_beside_it(ur3):
    front = next(link for link in ur3.links if link.name == "body").corners[:, 0].max()
    for gap, free in ((0.015, False), (0.025, True)):
        scene = Scene.of(ur3, [Body.box("part", (0.1, 2.0, 4.0))], Margins(environment=0.02))
        state = scene.state({"part": pose((front + 0.05 + gap, 0.0, 0.0))})
        assert (("body", "part") in scene.checker(state).static) != free


# Openings -------------------------------------------------------------------------------------------------------------


def test_fingers_close_on_a_part(ur3):
    scene = Scene.of(ur3, [Body.box("part", (0.03, 0.02, 0.02))])
    state = scene.state({"part": ur3.hand_pose("left", ur3.home, 0.03)})
    touching = {}
    for opening in (0.085, 0.05, 0.032, 0.028, 0.02):
        at_hand = ur3.flange("left", ur3.home) @ ur3.arms["left"].flange_from_hand(opening)[0]
        checker = scene.checker(state.with_opening("left", opening).with_pose("part", at_hand))
        touching[opening] = {pair[0] for pair in checker.touching(ur3.home)}
    assert [opening for opening, names in touching.items() if names] == [0.028, 0.02]
    assert touching[0.028] == set(FINGERS)


def test_the_pose_of_a_carried_part_is_the_reference_pose(cell, reference, rng):
    scene, states = cell("nextage")
    judge = reference(scene)
    for q in rng.uniform(scene.robot.lower, scene.robot.upper, (5, scene.robot.model.nq)):
        held = states[2].with_q(q)
        poses = dict(zip(judge.names, judge.poses(held, q), strict=True))
        for body in scene.bodies:
            assert np.allclose(invert(poses[body]) @ scene.world_from_body(held, body), np.eye(4), atol=1e-9)
