"""Poses that goals allow, and ways that are straight or not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kumitate.tasks.task import At, Insert
from kumitate.tasks.verify_ways import OFF_LINE, OFF_TURN, allowed, crooked, off, unit
from kumitate.transforms import Array, compose, pose, pose_distance, rotation_about

WAY = Insert((0.0, 0.0, -2.0), 0.05)


def turn(axis: Array, angle: float) -> Array:
    return compose(rotation_about(axis, angle), np.zeros(3))


def test_without_a_free_turn_one_pose_is_allowed(rng):
    at = At((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    np.testing.assert_allclose(allowed(at, None, pose(rng.normal(size=3), rng.normal(size=3))), pose(at.xyz, at.rpy))


def test_the_nearest_turn_is_allowed(rng):
    """No other turn about the axis comes nearer, and what remains is the tilt of the axis."""
    for _ in range(20):
        axis, reached = rng.normal(size=3), trimesh.transformations.random_rotation_matrix(rng.random(3))
        at = At((0.1, 0.2, 0.3), tuple(rng.normal(size=3)))
        found, axis = allowed(at, tuple(axis), reached), unit(axis)
        wanted = pose(at.xyz, at.rpy)
        np.testing.assert_allclose(found[:3, 3], wanted[:3, 3])
        np.testing.assert_allclose(found[:3, :3] @ axis, wanted[:3, :3] @ axis, atol=1e-12)
        left = pose_distance(reached, found)[1]
        others = [pose_distance(reached, wanted @ turn(axis, angle))[1] for angle in np.linspace(0.0, 2.0 * np.pi, 73)]
        assert left <= min(others) + 1e-9
        assert left == pytest.approx(np.arccos((reached[:3, :3] @ axis) @ (wanted[:3, :3] @ axis)), abs=1e-6)


@pytest.mark.parametrize(
    ("shift", "tilt", "missed"), [(0.9e-4, 0.0, False), (1.1e-4, 0.0, True), (0.0, 0.09, False), (0.0, 0.11, True)]
)
def test_poses_are_reached_to_a_tenth_of_a_millimetre_and_of_a_degree(shift, tilt, missed):
    assert bool(off("it", pose([shift, 0.0, 0.0], [0.0, np.deg2rad(tilt), 0.0]), pose())) is missed


def down(heights: Array) -> Array:
    return compose(np.eye(3), np.column_stack([np.zeros((len(heights), 2)), heights]))


def test_a_straight_way_may_be_longer_but_not_shorter():
    assert crooked("it", down(np.linspace(0.05, 0.0, 30)), pose(), WAY) == ""
    assert crooked("it", down(np.linspace(0.2, 0.0, 30)), pose(), WAY) == ""
    assert "4.00 mm too short" in crooked("it", down(np.linspace(0.046, 0.0, 30)), pose(), WAY)
    assert "too short" in crooked("it", down(np.linspace(-0.05, 0.0, 30)), pose(), WAY)


@pytest.mark.parametrize("share", [0.9, 1.1])
@pytest.mark.parametrize("way", ["aside", "turned"])
@pytest.mark.parametrize("height", [0.02, 0.1])
def test_only_the_way_that_is_asked_for_must_be_straight(share, way, height):
    poses = down(np.linspace(0.2, 0.0, 201))
    there = int(np.argmin(np.abs(poses[:, 2, 3] - height)))
    poses[there] = poses[there] @ (
        pose([share * OFF_LINE, 0.0, 0.0]) if way == "aside" else turn(np.array([0.0, 0.0, 1.0]), share * OFF_TURN)
    )
    assert bool(crooked("it", poses, pose(), WAY)) is (share > 1.0 and height < WAY.distance)
