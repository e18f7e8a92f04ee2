"""Hand against part: the same answers as coal, whatever the opening; and no pair left out."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pytest
import trimesh

from kumitate.grasping.collision import HandCollision, looks_the_same_turned
from kumitate.grasping.part import Part
from kumitate.robots.library import load_hand
from kumitate.transforms import compose, invert, rotation_about

HANDS = ("robotiq_2f85", "hrp5p_three_finger", "suction_cup")


def bvh(mesh):
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.asarray(mesh.vertices, dtype=float))
    model.addTriangles(np.asarray(mesh.faces, dtype=np.int64))
    model.endModel()
    return model


def part_of(name):
    torus = trimesh.creation.torus(0.03, 0.01, 32, 16)
    return Part.from_mesh(torus if name == "torus" else trimesh.creation.box([0.05, 0.03, 0.07]), mass=0.1)


@pytest.mark.parametrize("name", HANDS)
@pytest.mark.parametrize("shape", ["torus", "box"])
def test_agrees_with_coal_on_random_poses(rng, name, shape):
    hand, part, n = load_hand(name), part_of(shape), 400
    axes = rng.normal(size=(n, 3))
    rotation = rotation_about(axes / np.linalg.norm(axes, axis=1, keepdims=True), rng.uniform(0, np.pi, n))
    openings = rng.uniform(*hand.stroke, n)
    part_from_base = compose(rotation, rng.uniform(-0.05, 0.05, (n, 3))) @ invert(hand.base_from_hand(openings))
    found = HandCollision(part, hand).hand_hits(part_from_base, openings)
    solid, pieces = bvh(part.mesh), [bvh(piece.mesh) for piece in hand.pieces]
    poses = part_from_base[:, None] @ hand.base_from_piece(openings)
    wanted = np.zeros(n, dtype=bool)
    for i in range(n):
        for piece, pose in zip(pieces, poses[i], strict=True):
            at = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
            answer = coal.CollisionResult()
            wanted[i] |= bool(coal.collide(piece, at, solid, coal.Transform3s(), coal.CollisionRequest(), answer))
    assert 0.1 < wanted.mean() < 0.95
    assert np.array_equal(found, wanted)


def test_each_piece_alone_can_hit(rng):
    """A small box put into every piece in turn is found."""
    hand, opening = load_hand("robotiq_2f85"), np.array([0.05])
    part = Part.from_mesh(trimesh.creation.box([0.003, 0.003, 0.003]), mass=0.001)
    check = HandCollision(part, hand)
    poses = hand.base_from_piece(opening)[0]
    for piece, pose in zip(hand.pieces, poses, strict=True):
        corner = trimesh.transform_points(piece.mesh.vertices[:1], pose)[0]
        base_at_corner = compose(np.eye(3), -corner)[None]
        assert check.hand_hits(base_at_corner, opening)[0], piece.name


def test_cylinders_are_solid_and_end_where_they_should():
    part = part_of("box")  # x from -25 to 25 mm
    check = HandCollision(part, load_hand("robotiq_2f85"))
    x = np.array([[1.0, 0.0, 0.0]])
    for start, length, wanted in ((0.026, 0.02, False), (0.024, 0.02, True), (-0.05, 0.02, False), (-0.05, 0.03, True)):
        assert check.cylinders_hit(x * start, x, np.array([length]), 0.011)[0] == wanted
    assert not check.cylinders_hit(x * 0.0, x, np.array([0.0]), 0.011)[0]
    beside = np.array([[0.0, 0.0255, 0.0]])  # 10.5 mm off the side at y = 15 mm
    assert check.cylinders_hit(beside, x, np.array([0.01]), 0.011)[0]
    assert not check.cylinders_hit(beside, x, np.array([0.01]), 0.0104)[0]


def test_only_the_symmetric_hand_looks_the_same_turned():
    gripper = load_hand("robotiq_2f85")
    assert looks_the_same_turned(gripper)
    assert not looks_the_same_turned(load_hand("hrp5p_three_finger"))
    lopsided = replace(gripper, pieces=gripper.pieces[:-1])
    assert not looks_the_same_turned(lopsided)
