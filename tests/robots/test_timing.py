"""Timing: the curve is checked, not only its path; lines stay lines; what is no path of the arms is refused."""

from __future__ import annotations

import numpy as np
import pytest

from kumitate.errors import BlockedError, InputError, OffLineError
from kumitate.robots.library import load_robot
from kumitate.robots.paths import FREE_STEP, PathCheck
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Margins
from kumitate.robots.straight import LineTolerance, plan_linear
from kumitate.robots.timing import time_motion
from kumitate.robots.trajectory import time_path
from kumitate.transforms import pose


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage", {"left": "robotiq_2f85"})


def corner(robot, *, turn=0.25):
    """A path (3, nq) that turns the left arm's first joint, then its second: a corner at its middle waypoint."""
    first, second = robot.arms["left"].indices[:2]
    path = np.tile(robot.home, (3, 1))
    path[1:, first] += turn
    path[2, second] -= turn
    return path


def test_a_path_through_something_is_blocked(robot):
    path = corner(robot)
    scene = Scene.of(robot, [Body.box("ball", [0.02, 0.02, 0.02], fixed=True)])
    state = scene.state({"ball": robot.hand_pose("left", path[1], 0.0)}, openings={"left": 0.0})
    with pytest.raises(BlockedError, match="ball"):
        time_motion(scene, state, path, ["left"])


def test_corners_are_cut_by_less_where_something_stands_in_them(robot):
    path = corner(robot, turn=0.6)
    scene = Scene.of(robot, [Body.box("pin", [0.002, 0.002, 0.002], fixed=True)])

    def blocked(state, curve):
        return PathCheck(scene, state, ["left"], FREE_STEP).blocked(curve) is not None

    def wide_cut():
        return time_path(path, robot.joint_names, robot.velocity, robot.acceleration, max_deviation=0.1)

    # Inside the corner: where only a curve that cuts it takes the fingertips.
    tips = np.array([robot.hand_pose("left", q, 0.0)[:3, 3] for q in path])
    inwards = tips[0] + tips[2] - 2.0 * tips[1]
    places = [tips[1] + reach * inwards / np.linalg.norm(inwards) for reach in np.arange(0.01, 0.08, 0.002)]
    home = scene.state({"pin": pose()}, openings={"left": 0.0})
    curve = wide_cut().sample(np.linspace(0.0, wide_cut().duration, 400))
    inside = [state for state in (home.with_pose("pin", pose(p)) for p in places) if not blocked(state, path)]
    inside = [state for state in inside if blocked(state, curve)]
    assert inside
    motion = time_motion(scene, inside[0], path, ["left"])
    assert not blocked(inside[0], motion.sample(np.linspace(0.0, motion.duration, 1000)))
    assert motion.duration > wide_cut().duration


def test_motions_keep_margins_but_for_hands_at_work(robot):
    scene = Scene.of(robot, [Body.box("post", [0.02, 0.02, 0.1], fixed=True)], Margins(environment=0.02))
    ahead = robot.hand_pose("left", robot.home, 0.0) @ pose([0.0, 0.0, 0.014 + 0.05 + 0.008])
    state = scene.state({"post": ahead}, openings={"left": 0.0})
    path = corner(robot, turn=0.01)[:2]
    with pytest.raises(BlockedError, match="post"):
        time_motion(scene, state, path, ["left"])
    assert time_motion(scene, state, path, ["left"], working={"left"}).duration > 0.0


def test_a_path_that_leaves_its_line_is_refused_as_a_line(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    end = robot.hand_pose("left", robot.home, 0.085) @ pose([0.0, 0.0, -0.05])
    path = plan_linear(scene, state, "left", end)
    assert time_motion(scene, state, path, ["left"], line=LineTolerance()).duration > 0.0
    # Far off the line by the shoulder; on it, but turned, by the wrist.
    for joint, turn in ((0, 0.02), (5, np.deg2rad(3.0))):
        bowed = path.copy()
        bowed[len(path) // 2, robot.arms["left"].indices[joint]] += turn
        with pytest.raises(OffLineError, match="left does not keep to the line"):
            time_motion(scene, state, bowed, ["left"], line=LineTolerance())


def test_what_is_no_path_of_the_arms_is_refused():
    robot = load_robot("nextage", {"left": "robotiq_2f85", "right": "robotiq_2f85"})
    scene = Scene.of(robot, [])
    state, path = scene.state({}), corner(robot)
    for wrong, options, message in (
        (path, {"arms": ["right"]}, "no moving arm"),
        (path, {"arms": "left"}, "arms"),
        (path, {"arms": []}, "arms"),
        (path + 3.0, {}, "outside its limits"),
        (path * np.nan, {}, "outside its limits"),
        (path[:, :4], {}, "15 numbers"),
        (path[0], {}, "15 numbers"),
        (path[:0], {}, "no waypoint"),
        (path, {"speed": 0.0}, "speed"),
        (path, {"working": {"lef"}}, "lef"),
        (path, {"arms": ["left", "right"], "line": LineTolerance()}, "2 arms"),
    ):
        with pytest.raises(InputError, match=message):
            time_motion(scene, state, wrong, **{"arms": ["left"], **options})
