"""States in between: arms at home, contacts given up, what carries what."""

from __future__ import annotations

import numpy as np
from tabletops import robot_with_hands, tabletop

from kumitate.regrasp.rest import apart, at_rest, rest_contacts, root_of
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact
from kumitate.transforms import pose


def test_resting_arms_are_at_home_and_the_part_is_let_go_of_all_contacts(rng):
    table = tabletop("ur3_dual", "bracket")
    robot = table.robot
    start = table.resting(table.at([0.3, 0.15, 0.025]))
    there = at_rest(table.scene, start.with_q(rng.uniform(robot.lower, robot.upper) / 2.0), "bracket")
    np.testing.assert_array_equal(there.q, robot.home)
    assert there.contacts == ()
    assert set(there.poses) == {"table", "bracket"}


def test_an_arm_that_carries_something_else_stays_where_it_is():
    robot = robot_with_hands("ur3_dual")
    boxes = {"peg": [0.02, 0.02, 0.1], "cap": [0.03] * 3, "nut": [0.02] * 3}
    scene = Scene.of(robot, [Body.box(name, size) for name, size in boxes.items()])
    hand = robot.hand_pose("left", robot.home, 0.085)
    poses = {"peg": hand @ pose([0, 0, 0.04]), "cap": hand @ pose([0, 0, 0.12]), "nut": pose([1.0, 0.0, 0.0])}
    state = scene.attach(scene.attach(scene.state(poses), "peg", "left"), "cap", "peg")
    moved = state.with_q(robot.home + 0.1)
    assert root_of(state, "cap") == "peg"
    assert root_of(state, "peg") == "peg"
    assert root_of(state, "nut") == "nut"
    kept = at_rest(scene, moved, "nut").q - robot.home
    np.testing.assert_allclose(kept[robot.arms["left"].indices], 0.1)
    np.testing.assert_allclose(kept[robot.arms["right"].indices], 0.0)
    np.testing.assert_array_equal(at_rest(scene, moved, "peg").q, robot.home)


def test_parting_keeps_contacts_within_the_part_and_among_others():
    robot = robot_with_hands("ur3_dual")
    scene = Scene.of(robot, [Body.box(name, [0.02] * 3) for name in ("a", "b", "c", "d")])
    state = scene.state({name: pose([1.0, 0.1 * i, 0.0]) for i, name in enumerate("abcd")})
    state = scene.attach(state, "b", "a")
    up = [0.0, 0.0, 1.0]
    contacts = {(i, j): Contact(i, j, up) for i, j in (("a", "b"), ("a", "c"), ("c", "b"), ("c", "d"), ("a", "left/x"))}
    state = state.with_contacts(contacts.values())
    assert set(apart(state, "a").contacts) == {contacts["a", "b"], contacts["c", "d"]}
    kept = apart(state, "a", kept={"left/x"}).contacts
    assert set(kept) == {contacts["a", "b"], contacts["c", "d"], contacts["a", "left/x"]}


def test_a_part_rests_on_the_upper_side_of_a_support_however_that_is_turned():
    robot = robot_with_hands("ur3_dual")
    scene = Scene.of(robot, [Body.box("shelf", [0.2, 0.2, 0.1], fixed=True), Body.box("part", [0.02] * 3)])
    shelf = pose([1.0, 0.0, 0.5], [np.pi / 2.0, 0.0, 0.3])
    state = scene.state({"shelf": shelf, "part": pose([1.0, 0.0, 0.61])})
    contact = rest_contacts(scene, state, "shelf", "part")[0]
    np.testing.assert_allclose(shelf[:3, :3] @ contact.normal, [0.0, 0.0, 1.0], atol=1e-12)
    assert scene.touching(state.with_contacts([contact])) == ()
