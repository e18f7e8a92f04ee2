"""Laws of rigid bodies: boxes and balls hold them, and touching is decided on the exact shapes."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
import trimesh

from kumitate.robots import shapes
from kumitate.robots.library import load_hand, load_robot
from kumitate.robots.rigid import Rigid
from kumitate.robots.state import Body
from kumitate.transforms import invert, pose, transform_points


def random_poses(rng, n, spread):
    return [pose(rng.uniform(-spread, spread, 3), rng.uniform(-np.pi, np.pi, 3)) for _ in range(n)]


def bvh(mesh):
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return model


def test_boxes_and_balls_hold_the_shapes():
    robot = load_robot("ur3_dual")
    rigids = [*robot.links, *load_robot("hrp5p").links, *load_hand("suction_cup").pieces]
    for rigid in rigids:
        points = rigid.mesh.vertices
        low, high = rigid.corners.min(axis=0), rigid.corners.max(axis=0)
        assert (points >= low - 1e-9).all()
        assert (points <= high + 1e-9).all()
        centre, radius = rigid.ball[:3], rigid.ball[3]
        assert np.linalg.norm(points - centre, axis=1).max() <= radius + 1e-9
        for shape, placement, ball in zip(rigid.shapes, rigid.placements, rigid.balls, strict=True):
            placed = transform_points(placement, shape.mesh.vertices)
            assert np.linalg.norm(placed - ball[:3], axis=1).max() <= ball[3] + 1e-9


@pytest.mark.parametrize("kind", ["bracket", "fork", "wheel", "ring"])
def test_touching_and_margins_agree_with_mesh_distances(make_mesh, rng, kind):
    sizes = (0.02, 0.05, 0.03) if kind in ("wheel", "ring") else (0.1, 0.015, 0.04)
    a, b = Body.from_mesh("a", make_mesh(kind, *sizes)), Body.from_mesh("b", make_mesh("bracket", 0.08, 0.01, 0.05))
    models = [bvh(a.mesh), bvh(b.mesh)]
    touched, apart = 0, 0
    for a_from_b in random_poses(rng, 200, 0.08):
        objects = [fcl.CollisionObject(models[0]), fcl.CollisionObject(models[1], fcl.Transform(*_split(a_from_b)))]
        crossing = fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
        distance = fcl.distance(*objects)
        assert a.touches(b, a_from_b) == crossing
        assert b.touches(a, invert(a_from_b)) == crossing
        for margin in (0.002, 0.02):
            if not crossing and abs(distance - margin) > 1e-5:
                assert a.touches(b, a_from_b, margin) == (distance < margin)
        touched, apart = touched + crossing, apart + (not crossing)
    assert min(touched, apart) > 20


def _split(a_from_b):
    return a_from_b[:3, :3], a_from_b[:3, 3]


@pytest.mark.parametrize("inside_out", [False, True])
@pytest.mark.parametrize("small", ["box", "mesh", "sphere"])
def test_what_lies_in_the_material_touches_and_what_lies_in_a_hollow_does_not(make_mesh, inside_out, small):
    fork, ring = make_mesh("fork", 0.1, 0.02, 0.05), make_mesh("ring", 0.02, 0.05, 0.05)
    if inside_out:
        fork.invert()
        ring.invert()
    pebble = {
        "box": shapes.box([0.008] * 3),
        "mesh": shapes.from_mesh(make_mesh("bracket", 0.008, 0.002, 0.008)),
        "sphere": shapes.sphere(0.004),
    }[small]
    part = Body.of("pebble", pebble)
    for mesh, material, hollow in (
        (fork, (0.0, -0.04, 0.0), (0.0, 0.01, 0.0)),
        (ring, (0.035, 0.0, 0.0), (0.0, 0.0, 0.0)),
    ):
        around = Body.from_mesh("around", mesh)
        assert not around.shapes[0].solid
        for place, expected in ((material, True), (hollow, False)):
            at = pose(place, (0.3, 0.1, 0.2)) @ pose(-pebble.mesh.vertices.mean(axis=0))
            assert around.touches(part, at) == expected
            assert part.touches(around, invert(at)) == expected


def test_one_component_inside_is_enough(make_mesh):
    far = trimesh.creation.icosphere(2, 0.003)
    pair = trimesh.util.concatenate([far, far.copy().apply_translation((1.0, 0.0, 0.0))])
    ring, pebbles = Body.from_mesh("ring", make_mesh("ring", 0.02, 0.05, 0.05)), Body.from_mesh("pebbles", pair)
    for shift, expected in ((0.0, False), (0.035, True), (-0.965, True), (-0.9, False)):
        assert ring.touches(pebbles, pose((shift, 0.0, 0.0))) == expected


def test_touching_a_body_of_many_shapes_needs_one_of_them():
    placements = np.array([pose((x, 0.0, 0.0)) for x in (-0.1, 0.0, 0.1)])
    row = Rigid("row", tuple(shapes.sphere(0.03) for _ in range(3)), placements, np.ones(4))
    dot = Body.of("dot", shapes.sphere(0.01))
    for x, y, expected in ((0.05, 0.0, False), (0.05, 0.0, False), (-0.1, 0.039, True), (0.1, 0.041, False)):
        assert row.touches(dot, pose((x, y, 0.0))) == expected
        assert dot.touches(row, pose((-x, -y, 0.0))) == expected
    assert row.touches(dot, pose((0.1, 0.041, 0.0)), margin=0.0011)
    assert not row.touches(dot, pose((0.1, 0.041, 0.0)), margin=0.0009)
