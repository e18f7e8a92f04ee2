"""Grips: looked at on the way, not only at the end; hands at work keep no margins."""

from __future__ import annotations

import numpy as np
import pytest

from kumitate.errors import BlockedError, InputError
from kumitate.robots.grip import plan_grip
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Margins
from kumitate.transforms import pose


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage", {"left": "robotiq_2f85"})


def test_a_wire_between_two_openings_that_are_free_blocks_the_way(robot):
    # The left finger passes a wire beside the grasp centre: free before and behind it.
    hand = robot.hand_pose("left", robot.home, 0.04)
    scene = Scene.of(robot, [Body.box("wire", [0.001, 0.1, 0.001], fixed=True)])
    state = scene.state({"wire": hand @ pose([0.035, 0.0, 0.0])})
    open_, shut = (state.with_opening("left", opening) for opening in (0.085, 0.0))
    assert scene.touching(open_) == ()
    assert scene.touching(shut) == ()
    with pytest.raises(BlockedError, match="wire") as caught:
        plan_grip(scene, open_, "left", 0.0)
    assert 0.0 < caught.value.share < 1.0
    with pytest.raises(BlockedError, match="wire"):
        plan_grip(scene, shut, "left", 0.085)


def test_no_piece_of_a_hand_moves_far_between_two_openings():
    for name in ("robotiq_2f85", "hrp5p_three_finger"):
        robot = load_robot("nextage", {"left": name})
        scene, hand = Scene.of(robot, []), robot.hands["left"]
        openings = plan_grip(scene, scene.state({}), "left", hand.stroke[0])
        assert (openings[0], openings[-1]) == hand.stroke[::-1]
        poses = hand.base_from_piece(openings)
        for i, piece in enumerate(hand.pieces):
            corners = poses[:, i, :3, :3] @ piece.mesh.vertices.T + poses[:, i, :3, 3:]
            assert np.linalg.norm(np.diff(corners, axis=0), axis=1).max() < 1.2e-3


def test_a_grip_keeps_no_margins(robot):
    scene = Scene.of(robot, [Body.box("post", [0.02, 0.02, 0.02], fixed=True)], Margins(environment=0.02))
    ahead = robot.hand_pose("left", robot.home, 0.0) @ pose([0.0, 0.0, 0.014 + 0.01 + 0.008])
    state = scene.state({"post": ahead}, openings={"left": 0.0})
    assert scene.touching(state)
    assert plan_grip(scene, state, "left", 0.01)[-1] == 0.01


def test_what_is_no_opening_is_refused(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    for arm, opening, message in (
        ("left", 0.2, "stroke"),
        ("left", np.nan, "stroke"),
        ("left", [0.01, 0.02], "no number"),
        ("left", "wide", "no array of numbers"),
        ("right", 0.02, "no hand"),
        ("lef", 0.02, "no arm named 'lef'"),
    ):
        with pytest.raises(InputError, match=message):
            plan_grip(scene, state, arm, opening)
    with pytest.raises(InputError, match="15 numbers"):
        plan_grip(scene, state.with_q(np.zeros(3)), "left", 0.02)
