"""Laws of the pose helpers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kumitate.errors import InputError
from kumitate.transforms import (
    checked_poses,
    compose,
    invert,
    pose,
    pose_distance,
    rotation_about,
    rotation_from_rpy,
    rpy_from_rotation,
    transform_points,
)

ANGLES = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
POINTS = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


@given(ANGLES)
def test_rpy_is_fixed_axis_roll_pitch_yaw(rpy):
    np.testing.assert_allclose(rotation_from_rpy(rpy), pin.rpy.rpyToMatrix(np.array(rpy)), atol=1e-12)


@given(ANGLES | st.tuples(st.floats(-3.0, 3.0), st.sampled_from([-np.pi / 2, np.pi / 2]), st.floats(-3.0, 3.0)))
def test_a_rotation_gives_its_roll_pitch_and_yaw_back(rpy):
    rotation = rotation_from_rpy(rpy)
    np.testing.assert_allclose(rotation_from_rpy(rpy_from_rotation(rotation)), rotation, atol=3e-6)


@given(ANGLES, st.floats(-6.0, 6.0))
def test_rotation_about_an_axis_is_the_exponential_map(axis, angle):
    length = np.linalg.norm(axis)
    if length < 1e-3:
        return
    unit = np.array(axis) / length
    np.testing.assert_allclose(rotation_about(unit, angle), pin.exp3(unit * angle), atol=1e-12)


@given(POINTS, ANGLES, POINTS)
def test_inverse_undoes_a_pose(xyz, rpy, point):
    a_from_b = pose(xyz, rpy)
    np.testing.assert_allclose(invert(a_from_b) @ a_from_b, np.eye(4), atol=1e-12)
    there = transform_points(a_from_b, np.array([point]))
    np.testing.assert_allclose(transform_points(invert(a_from_b), there), [point], atol=1e-12)


@given(POINTS, ANGLES, POINTS, ANGLES)
def test_pose_distance_is_that_of_the_relative_pose(xyz_a, rpy_a, xyz_b, rpy_b):
    a, b = pose(xyz_a, rpy_a), pose(xyz_b, rpy_b)
    distance, angle = pose_distance(a, b)
    assert distance == pytest.approx(np.linalg.norm(np.subtract(xyz_a, xyz_b)), abs=1e-12)
    assert angle == pytest.approx(np.linalg.norm(pin.log3(a[:3, :3].T @ b[:3, :3])), abs=1e-6)


def test_many_poses_at_once_equal_one_at_a_time(rng):
    xyz, angles = rng.normal(size=(7, 3)), rng.normal(size=7)
    many = compose(rotation_about([0.0, 0.0, 1.0], angles), xyz)
    for i in range(7):
        np.testing.assert_allclose(many[i], compose(rotation_about([0.0, 0.0, 1.0], angles[i]), xyz[i]), atol=1e-15)
        np.testing.assert_allclose(invert(many)[i], np.linalg.inv(many[i]), atol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [np.eye(3), np.full((4, 4), np.nan), np.diag([1.0, 1.0, -1.0, 1.0]), 2.0 * np.eye(4), np.zeros((2, 4, 4))],
)
def test_what_is_no_pose_is_refused(wrong):
    with pytest.raises(InputError, match="here"):
        checked_poses(wrong, "here")
