"""Questions of fcl: distances, where surfaces cross, what lies inside."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from kumitate.tasks.verify_solids import Solids, inside
from kumitate.transforms import pose


def test_surfaces_cross_around_the_contact():
    """A small box stands in a large one by a millimetre: the crossings are its outline."""
    solids = Solids([trimesh.creation.box([0.02, 0.03, 0.04]), trimesh.creation.box([0.2, 0.2, 0.02])])
    points = solids.crossings(0, pose([0.01, 0.02, 0.019], [0.0, 0.0, 0.3]), 1, pose([0.0, 0.0, -0.01]))
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-12)
    assert ConvexHull(points[:, :2]).volume == pytest.approx(0.02 * 0.03)
    assert not len(solids.crossings(0, pose([0.0, 0.0, 0.021]), 1, pose([0.0, 0.0, -0.01])))


def test_distances_are_of_surfaces(rng):
    ball = trimesh.creation.icosphere(3, 0.02)
    solids = Solids([ball, ball])
    for _ in range(10):
        at = rng.normal(size=3)
        distance = solids.distance(0, pose(), 1, pose(at))
        assert distance == pytest.approx(max(np.linalg.norm(at) - 0.04, 0.0), abs=5e-4)
        assert solids.touch(0, pose(), 1, pose(at)) is (distance == 0.0)
    assert solids.count == 10
    assert solids.distance(0, pose(), 1, pose([0.01, 0.0, 0.0])) == 0.0
    triangle = np.array([[[0.0, 0.0, 0.05], [0.01, 0.0, 0.05], [0.0, 0.01, 0.05]]])
    assert solids.distance_to_triangles(triangle, 0, pose()) == pytest.approx(0.03, abs=5e-4)


def test_what_lies_inside_is_told(rng):
    ring = trimesh.creation.annulus(0.02, 0.04, 0.03, sections=64)
    points = rng.uniform(-0.05, 0.05, (200, 3)) * [1.0, 1.0, 0.4]
    radius = np.linalg.norm(points[:, :2], axis=1)
    truly = (radius > 0.0201) & (radius < 0.0399) & (np.abs(points[:, 2]) < 0.015)
    clear = truly | (radius < 0.0199) | (radius > 0.0401) | (np.abs(points[:, 2]) > 0.015)
    told = np.array([inside(point, ring) for point in points])
    np.testing.assert_array_equal(told[clear], truly[clear])


def test_boxes_are_solid(rng):
    """A ball meets a box from outside and from inside, and has it inside."""
    solids = Solids([trimesh.creation.icosphere(3, 0.02)])
    sides = np.array([0.1, 0.2, 0.3])
    for _ in range(20):
        turned = trimesh.transformations.random_rotation_matrix(rng.random(3))
        for x, found in ((0.0, True), (0.069, True), (0.071, False)):
            assert solids.touches_box(0, turned @ pose([x, 0.0, 0.0]), sides, turned) is found
        assert solids.touches_box(0, turned, 0.01 * sides, turned @ pose([0.01, 0.0, 0.0]))
        assert not solids.touches_box(0, turned, 0.01 * sides, turned @ pose([0.03, 0.0, 0.0]))
