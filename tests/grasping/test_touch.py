"""First touch of a face: against a linear programme for each triangle, and on parts whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

from kumitate.grasping.touch import first_touch
from kumitate.transforms import compose, rotation_about

SIZE = (0.022, 0.0375)


def touch(mesh, poses, outward, floor=-0.05, reach=0.05):
    n = len(poses)
    return first_touch(mesh, np.arange(n), outward, poses, SIZE, floor=floor, reach=np.full(n, reach))


def face_towards(point, inward, turn=0.0, lean=0.0):
    """A face at ``point`` that looks along ``inward``, turned about it, and leaning by ``lean``."""
    z = np.cross(inward, np.eye(3)[np.argmin(np.abs(inward))])
    z /= np.linalg.norm(z)
    rotation = rotation_about(inward, turn) @ np.stack([inward, np.cross(z, inward), z], axis=-1)
    return compose(rotation @ rotation_about([0.0, 1.0, 0.0], lean), point)


def by_linear_programme(mesh, pose, outward, floor, reach):
    """Greatest t with a point of a triangle = a point of the face + t outward, triangle by triangle."""
    best = -np.inf
    for corners in mesh.triangles:
        # Unknowns: weights of the three corners (they sum to one), y and z on the face, t.
        equal = np.zeros((4, 6))
        equal[:3, :3], equal[3, :3] = corners.T, 1.0
        equal[:3, 3:5], equal[:3, 5] = -pose[:3, 1:3], -outward
        sides = [(0, 1)] * 3 + [(-SIZE[0] / 2, SIZE[0] / 2), (-SIZE[1] / 2, SIZE[1] / 2), (None, None)]
        ends = [linprog(sign * np.eye(6)[5], A_eq=equal, b_eq=[*pose[:3, 3], 1.0], bounds=sides) for sign in (1, -1)]
        if ends[0].success and ends[1].success:
            low, high = ends[0].fun, -ends[1].fun
            if low <= reach and high >= floor:
                best = max(best, high)
    return best


@pytest.mark.parametrize("lean", [0.0, 0.35])
def test_agrees_with_a_linear_programme_over_each_triangle(lean):
    rng = np.random.default_rng(5)
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.03)
    mesh.vertices += rng.normal(scale=0.003, size=mesh.vertices.shape)
    poses, outwards = [], []
    for _ in range(5):
        inward = rng.normal(size=3)
        inward /= np.linalg.norm(inward)
        poses.append(face_towards(-inward * rng.uniform(0.0, 0.04), inward, rng.uniform(0, 6), lean))
        outwards.append(-inward)
    poses, outwards = np.array(poses), np.array(outwards)
    found = touch(mesh, poses, outwards)
    wanted = [by_linear_programme(mesh, p, o, -0.05, 0.05) for p, o in zip(poses, outwards, strict=True)]
    assert np.isfinite(wanted).sum() >= 3
    assert np.allclose(found, wanted, atol=1e-7)


def test_a_face_that_leans_touches_with_its_edge():
    block = trimesh.creation.box([0.1, 0.1, 0.1])
    lean = np.radians(20.0)
    pose = face_towards(np.array([0.05, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), lean=lean)[None]
    found = touch(block, pose, np.array([[1.0, 0.0, 0.0]]))
    assert np.allclose(found, SIZE[1] / 2.0 * np.sin(lean), atol=1e-9)


def test_what_the_face_does_not_cover_is_not_touched():
    block = trimesh.creation.box([0.02, 0.02, 0.02])
    pose = face_towards(np.array([0.03, 0.04, 0.0]), np.array([-1.0, 0.0, 0.0]))[None]
    assert touch(block, pose, np.array([[1.0, 0.0, 0.0]]))[0] == -np.inf


def test_what_lies_behind_the_opened_finger_is_not_met():
    wall = trimesh.creation.box([0.01, 0.1, 0.1]).apply_translation([0.065, 0.0, 0.0])  # from 60 mm outward
    pose = face_towards(np.zeros(3), np.array([-1.0, 0.0, 0.0]))[None]
    outward = np.array([[1.0, 0.0, 0.0]])
    assert touch(wall, pose, outward, reach=0.05)[0] == -np.inf
    assert np.isclose(touch(wall, pose, outward, reach=0.08)[0], 0.07)


def test_faces_of_one_place_get_the_answers_they_get_alone():
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.04)
    mesh.vertices += np.random.default_rng(3).normal(scale=0.003, size=mesh.vertices.shape)
    inward = np.array([-1.0, 0.0, 0.0])
    poses = np.array([face_towards(np.array([0.02, 0.03, 0.01]), inward, turn) for turn in np.arange(0, 6.2, 0.4)])
    outward = np.tile(-inward, (len(poses), 1))
    together = first_touch(
        mesh, np.zeros(len(poses), dtype=int), outward, poses, SIZE, floor=-0.05, reach=np.full(len(poses), 0.05)
    )
    assert np.array_equal(together, touch(mesh, poses, outward))
    assert len(np.unique(np.round(together, 6))) > 3
