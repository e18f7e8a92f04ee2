"""Laws of attaching and detaching, and what a scene refuses."""

from __future__ import annotations

import numpy as np
import pytest

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact
from kumitate.transforms import invert, pose


@pytest.fixture(scope="module")
def scene():
    robot = load_robot("ur3_dual", {"left": "robotiq_2f85"})
    bodies = [
        Body.box("table", (0.6, 1.2, 0.06), fixed=True),
        Body.box("peg", (0.02, 0.02, 0.1)),
        Body.box("cap", (0.03, 0.03, 0.03)),
    ]
    return Scene.of(robot, bodies)


@pytest.fixture
def held(scene):
    """The peg in the left hand, the cap below it, carried by the peg."""
    robot = scene.robot
    hand = robot.hand_pose("left", robot.home, 0.085)
    peg = hand @ pose((0.0, 0.0, 0.035))
    poses = {"table": pose((0.75, 0.0, 0.5)), "peg": peg, "cap": peg @ pose((0.0, 0.0, 0.072), (0.0, 0.3, 0.0))}
    return scene.attach(scene.attach(scene.state(poses), "peg", "left"), "cap", "peg")


def test_what_a_hand_carries_moves_as_one_and_stays_where_it_is_left(scene, held, rng):
    robot = scene.robot
    before = {name: scene.world_from_body(held, name) for name in ("peg", "cap")}
    for q in rng.uniform(robot.lower, robot.upper, (5, robot.model.nq)):
        moved = held.with_q(q)
        step = robot.flange("left", q) @ invert(robot.flange("left", robot.home))
        after = {name: scene.world_from_body(moved, name) for name in before}
        for name, start in before.items():
            assert np.allclose(after[name], step @ start, atol=1e-9)
        left = scene.detach(moved, "peg").with_q(robot.home)
        for name in before:
            assert left.carrier(name)[0] == ""
            assert np.allclose(scene.world_from_body(left, name), after[name], atol=1e-9)
        without_cap = scene.detach(moved, "cap").with_q(robot.home)
        assert np.allclose(scene.world_from_body(without_cap, "cap"), after["cap"], atol=1e-9)
        assert np.allclose(scene.world_from_body(without_cap, "peg"), before["peg"], atol=1e-9)


def test_what_a_hand_carries_collides_where_it_is_carried(scene, held):
    robot = scene.robot
    assert scene.touching(held) == ()
    raised = held.with_pose("table", scene.world_from_body(held, "cap") @ pose((0.0, 0.0, 0.04)))
    assert ("table", "cap") in scene.touching(raised)
    assert scene.checker(raised).static == ()
    pan = robot.joint_names.index("left_shoulder_pan_joint")
    aside = held.with_q(robot.home + 0.4 * np.eye(robot.model.nq)[pan])
    target = scene.world_from_body(aside, "cap")
    wall = held.with_pose("table", target @ pose((0.0, 0.0, 0.03)))
    assert ("table", "cap") not in scene.checker(wall).touching(robot.home)
    assert ("table", "cap") in scene.checker(wall).touching(aside.q)
    left = scene.detach(wall, "cap")
    assert ("table", "cap") not in scene.checker(left).touching(aside.q)


def test_what_moves_as_one_is_decided_once(scene, held):
    sunk = held.with_pose("cap", scene.world_from_body(held, "peg") @ pose((0.0, 0.0, 0.06)))
    sunk = scene.attach(sunk, "cap", "peg")
    checker = scene.checker(sunk)
    assert checker.static == (("peg", "cap"),)
    assert not checker.free(scene.robot.home)
    assert checker.first_touching(scene.robot.home) == ("peg", "cap")
    pushed = scene.attach(
        held.with_pose("peg", scene.robot.hand_pose("left", held.q, 0.085) @ pose((0.045, 0.0, 0.0))), "peg", "left"
    )
    assert ("left/right_inner_finger", "peg") in scene.checker(pushed).static


def test_cycles_obstacles_and_strangers_are_refused(scene, held):
    with pytest.raises(InputError, match="carried by it"):
        scene.attach(held, "peg", "cap")
    with pytest.raises(InputError, match="carried by it"):
        scene.attach(held, "peg", "peg")
    with pytest.raises(InputError, match="obstacle"):
        scene.attach(held, "table", "left")
    with pytest.raises(UnknownNameError, match="nut"):
        scene.attach(held, "nut", "left")
    with pytest.raises(UnknownNameError, match="middle"):
        scene.attach(held, "peg", "middle")
    with pytest.raises(UnknownNameError, match="table"):
        scene.detach(held, "table")
    with pytest.raises(UnknownNameError, match="nut"):
        scene.world_from_body(held, "nut")


def test_attaching_and_detaching_leave_the_old_state_alone(scene, held):
    before = (dict(held.poses), dict(held.attached))
    scene.detach(held, "peg")
    scene.attach(held, "cap", "left")
    assert (dict(held.poses), dict(held.attached)) == before


def test_handing_over_changes_the_carrier(scene, held):
    handed = scene.attach(held, "peg", "right")
    assert handed.carrier("peg")[0] == handed.carrier("cap")[0] == "right"
    for name in ("peg", "cap"):
        assert np.allclose(scene.world_from_body(handed, name), scene.world_from_body(held, name), atol=1e-9)


def test_states_are_checked(scene):
    poses = {name: pose((1.0, 0.1 * i, 0.5)) for i, name in enumerate(scene.bodies)}
    assert np.array_equal(scene.state(poses).q, scene.robot.home)
    assert scene.state(poses).openings == {"left": 0.085}
    for wrong, match in (
        ({"poses": {**poses, "nut": np.eye(4)}}, "nut"),
        ({"poses": {"peg": np.eye(4)}}, "table"),
        ({"poses": {**poses, "peg": 2.0 * np.eye(4)}}, "pose of peg"),
        ({"poses": poses, "openings": {"left": 0.2}}, "stroke"),
        ({"poses": poses, "openings": {"right": 0.02}}, "no hand"),
        ({"poses": poses, "openings": {"middle": 0.02}}, "middle"),
        ({"poses": poses, "q": np.zeros(3)}, "shape"),
        ({"poses": poses, "q": np.full(12, 9.0)}, "limits"),
        ({"poses": poses, "q": np.full(12, np.nan)}, "limits"),
    ):
        with pytest.raises(InputError, match=match):
            scene.state(**wrong)


def test_openings_outside_the_stroke_are_refused_when_checked(scene, held):
    with pytest.raises(InputError, match="stroke"):
        scene.checker(held.with_opening("left", 0.1))


@pytest.mark.parametrize("name", ["left_forearm_link", "left", "left/base", "twin"])
def test_every_body_has_a_name_of_its_own(scene, name):
    bodies = [Body.box("twin", [0.1] * 3), Body.box(name, [0.1] * 3)]
    with pytest.raises(InputError, match="is taken"):
        Scene.of(scene.robot, bodies)


@pytest.mark.parametrize("tolerance", [-1e-4, np.nan, 0.5])
def test_contact_tolerances_are_small_distances(scene, tolerance):
    with pytest.raises(InputError, match="contact_tolerance"):
        Scene.of(scene.robot, [], contact_tolerance=tolerance)


def test_the_contact_tolerance_asked_for_counts(scene):
    bodies = [Body.box("a", [0.1] * 3), Body.box("b", [0.1] * 3)]
    for tolerance, touching in ((0.5e-3, True), (2e-3, False)):
        pair = Scene.of(scene.robot, bodies, contact_tolerance=tolerance)
        state = pair.state({"a": pose((2.0, 0.0, 0.0)), "b": pose((2.0, 0.0, 0.099))})
        state = state.with_contacts([Contact("a", "b", np.array([0.0, 0.0, 1.0]))])
        assert (("a", "b") in pair.touching(state)) is touching


def test_states_changed_since_are_checked_again(scene, held):
    for q in (np.zeros(3), np.full(12, np.nan), np.full(12, 9.0)):
        with pytest.raises(InputError, match=r"12 numbers|outside its limits"):
            scene.touching(held.with_q(q))
    with pytest.raises(UnknownNameError, match="lef"):
        scene.checker(held, {"lef"})
    with pytest.raises(InputError, match="no number"):
        scene.state({name: np.eye(4) for name in scene.bodies}, openings={"left": [0.01, 0.02]})
    with pytest.raises(InputError, match="pose of peg"):
        scene.state({**{name: np.eye(4) for name in scene.bodies}, "peg": np.tile(np.eye(4), (2, 1, 1))})
