"""Straight lines of a hand: what lies on one, how closely it is followed, whose margins count."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from kumitate.errors import BlockedError, InputError, UnreachableLineError
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Margins
from kumitate.robots.straight import INSERTION, LineTolerance, on_line, plan_linear, poses_on_line
from kumitate.transforms import pose


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage", {"left": "robotiq_2f85", "right": "robotiq_2f85"})


def test_poses_on_a_line_are_on_it_and_others_are_not():
    ends = np.stack([pose(), pose([0.1, 0.2, 0.0], [0.0, 0.0, 1.0])])
    hands = poses_on_line(ends, np.linspace(0.0, 1.0, 7))
    allowed = LineTolerance()
    assert on_line(hands, ends, allowed, 1.0)
    across = np.array([0.2, -0.1, 0.0]) / np.hypot(0.2, 0.1)
    for shift, turn, inside in ((0.9e-3, 0.0, True), (1.1e-3, 0.0, False), (0.0, 0.9, True), (0.0, 1.1, False)):
        off = hands @ pose(rpy=[np.deg2rad(turn), 0.0, 0.0])
        off[:, :3, 3] += shift * across
        assert on_line(off, ends, allowed, 1.0) is inside
        assert not on_line(off, ends, allowed, 0.5)


@pytest.mark.parametrize("tolerance", [LineTolerance(), INSERTION])
def test_long_lines_are_kept_between_waypoints_too(robot, tolerance):
    scene = Scene.of(robot, [])
    state = scene.state({})
    start = robot.hand_pose("left", state.q, 0.085)
    end = pose([0.0, 0.12, 0.06]) @ start @ pose(rpy=[0.3, 0.2, 0.9])
    path = plan_linear(scene, state, "left", end, tolerance=tolerance)
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    fine = np.concatenate([a + shares * (b - a) for a, b in itertools.pairwise(path)])
    hands = np.array([robot.hand_pose("left", q, 0.085) for q in fine])
    assert on_line(hands, np.stack([start, end]), tolerance, 0.6)


def test_narrower_lines_have_more_waypoints(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    end = pose([0.0, 0.12, 0.06]) @ robot.hand_pose("left", state.q, 0.085) @ pose(rpy=[0.3, 0.2, 0.9])
    wide, narrow = (plan_linear(scene, state, "left", end, tolerance=LineTolerance(d, d)) for d in (1e-2, 1e-5))
    assert len(narrow) > len(wide)


def test_the_hand_on_the_line_keeps_no_margins_and_others_only_while_they_work(robot):
    scene = Scene.of(robot, [Body.box("post", [0.02, 0.02, 0.02], fixed=True)], Margins(environment=0.02))
    below = pose([0.0, 0.0, 0.014 + 0.01 + 0.008])
    closed = {"left": 0.0, "right": 0.0}
    back = robot.hand_pose("left", robot.home, 0.0) @ pose([0.0, 0.0, -0.005])
    own, others = (
        scene.state({"post": robot.hand_pose(side, robot.home, 0.0) @ below}, openings=closed)
        for side in ("left", "right")
    )
    assert scene.touching(own)
    assert len(plan_linear(scene, own, "left", back)) > 1
    with pytest.raises(BlockedError, match="post"):
        plan_linear(scene, others, "left", back)
    assert len(plan_linear(scene, others, "left", back, working={"right"})) > 1


def test_lines_that_only_turn_tell_how_far_they_come(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    end = robot.hand_pose("left", state.q, 0.085) @ pose(rpy=[2.6, 0.0, 0.0])
    with pytest.raises(UnreachableLineError, match=r"line of 0 mm and 149 degrees for \d+% of its way") as caught:
        plan_linear(scene, state, "left", end)
    assert caught.value.angle == pytest.approx(2.6, abs=1e-6)


def test_wrong_input_is_refused(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    here = robot.hand_pose("left", state.q, 0.085)
    for changed, end, arm, options, message in (
        (state, here[None], "left", {}, "not one pose"),
        (state, here * np.nan, "left", {}, "no rigid pose"),
        (state, here, "lef", {}, "no arm named 'lef'"),
        (state, here, "left", {"working": {"rihgt"}}, "no arm named 'rihgt'"),
        (state.with_q(np.zeros(3)), here, "left", {}, "15 numbers"),
        (state.with_q(np.full(15, 9.0)), here, "left", {}, "outside its limits"),
    ):
        with pytest.raises(InputError, match=message):
            plan_linear(scene, changed, arm, end, **options)
    for wrong in ((-1.0, 1.0), (1.0, np.nan), (np.inf, 1.0), (0.0, 1.0)):
        with pytest.raises(InputError, match="line tolerance"):
            LineTolerance(*wrong)
