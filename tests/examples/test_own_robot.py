"""The robot of the example: its files are what the script makes, and its arms are those of a Panda."""

from __future__ import annotations

import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from kumitate.robots.library import load_hand
from kumitate.robots.robot import Robot
from kumitate.robots.scene import Scene
from kumitate.transforms import invert

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "own_robot"
FILES = ("two_arms.urdf", "two_arms.srdf", "joint_limits.yaml")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.load(*(FOLDER / name for name in FILES))


@pytest.fixture(scope="module")
def panda() -> pin.Model:
    shares = (Path(entry) / "cmeel.prefix/share/example-robot-data/robots" for entry in sys.path)
    folder = next(share for share in shares if share.is_dir())
    return pin.buildModelFromUrdf(str(folder / "panda_description/urdf/panda.urdf"))


def test_the_files_are_what_the_script_makes(tmp_path):
    spec = importlib.util.spec_from_file_location("make_robot", FOLDER / "make_robot.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.write(tmp_path)
    assert [(tmp_path / name).read_text() for name in FILES] == [(FOLDER / name).read_text() for name in FILES]


@pytest.mark.parametrize(("arm", "y"), [("left_arm", 0.3), ("right_arm", -0.3)])
def test_both_arms_move_as_a_panda_does(robot, panda, rng, arm, y):
    data = panda.createData()
    for q in robot.arms[arm].chain.random(rng, 20):
        pin.framesForwardKinematics(panda, data, np.append(q, [0.0, 0.0]))  # its own fingers come last
        expected = data.oMf[panda.getFrameId("panda_link8")].homogeneous
        expected[1, 3] += y
        np.testing.assert_allclose(robot.arms[arm].chain.forward(q[None])[0], expected, atol=1e-9)


def test_ranges_and_speeds_are_a_panda_s(robot, panda):
    for arm in robot.arms.values():
        np.testing.assert_allclose(robot.lower[arm.indices], panda.lowerPositionLimit[:7], atol=1e-9)
        np.testing.assert_allclose(robot.upper[arm.indices], panda.upperPositionLimit[:7], atol=1e-9)
        np.testing.assert_allclose(robot.velocity[arm.indices], panda.velocityLimit[:7], atol=1e-9)
        np.testing.assert_array_equal(robot.acceleration[arm.indices], [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])


def test_it_stands_free_at_home_with_hands_that_point_down(robot):
    hand = load_hand("robotiq_2f85")
    equipped = robot.with_hand("left_arm", hand).with_hand("right_arm", hand)
    scene = Scene.of(equipped, [])
    assert scene.touching(scene.state({})) == ()
    left, right = (equipped.flange(arm, equipped.home) for arm in ("left_arm", "right_arm"))
    np.testing.assert_allclose(left[:3, 2], [0.0, 0.0, -1.0], atol=1e-9)
    np.testing.assert_allclose((invert(left) @ right)[:3, :3], np.eye(3), atol=1e-9)


@pytest.mark.slow
def test_pairs_that_need_no_check_are_those_that_sampling_finds(robot, tmp_path):
    bare = re.sub("<disable_collisions[^>]*/>", "", (FOLDER / "two_arms.srdf").read_text())
    (tmp_path / "bare.srdf").write_text(bare)
    sampled = Robot.load(FOLDER / "two_arms.urdf", tmp_path / "bare.srdf")
    assert robot.disabled
    assert not robot.disabled - sampled.disabled
