"""Laws of collision shapes: covers cover, windings tell inside from outside, and every kind of mesh gets a shape."""

from __future__ import annotations

import coal
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from kumitate.robots import shapes
from kumitate.robots.library import HANDS, ROBOTS, load_hand, load_robot
from kumitate.robots.state import Body
from kumitate.transforms import invert, pose, transform_points

REACH = 1e-6  # m


def covered(cover, points):
    """Which of ``points`` lie in some convex piece of the cover."""
    inside = np.zeros(len(points), dtype=bool)
    for piece in cover:
        inside |= held(piece.geometry, transform_points(invert(piece.placement), points))
    return inside


def held(geometry, points):
    """Which of ``points`` lie in a convex shape."""
    match geometry:
        case coal.Box():
            return (np.abs(points) <= np.ravel(geometry.halfSide) + REACH).all(axis=1)
        case coal.Cylinder():
            radial = np.linalg.norm(points[:, :2], axis=1) <= geometry.radius + REACH
            return radial & (np.abs(points[:, 2]) <= geometry.halfLength + REACH)
        case coal.Sphere():
            return np.linalg.norm(points, axis=1) <= geometry.radius + REACH
    hull = trimesh.convex.convex_hull(np.array(geometry.points()))
    normals, offsets = hull.face_normals, np.einsum("ij,ij->i", hull.face_normals, hull.triangles[:, 0])
    beyond = (points @ normals.T - offsets).max(axis=1)
    # Above a face the distance is the height; beside one it is more, and only the nearest point tells.
    rounding = geometry.getSweptSphereRadius()
    inside = beyond <= REACH
    doubtful = np.flatnonzero(~inside & (beyond <= rounding + REACH))
    if len(doubtful):
        distances = trimesh.proximity.closest_point_naive(hull, points[doubtful])[1]
        inside[doubtful] = distances <= rounding + REACH
    return inside


def surface(shape, rng, n):
    """Points on the exact surface of a shape: on the curved one of a primitive, not on its triangles."""
    match shape.geometry:
        case coal.Cylinder(radius=radius, halfLength=half):
            angle, z = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(-half, half, n)
            return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])
        case coal.Sphere(radius=radius):
            directions = rng.normal(size=(n, 3))
            return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        case coal.Capsule(radius=radius, halfLength=half):
            directions = rng.normal(size=(n, 3))
            directions *= radius / np.linalg.norm(directions, axis=1, keepdims=True)
            return directions + np.outer(np.where(directions[:, 2] > 0.0, half, -half), [0.0, 0.0, 1.0])
    points, _ = trimesh.sample.sample_surface(shape.mesh, n, seed=int(rng.integers(1 << 30)))
    return np.concatenate([points, shape.mesh.vertices[np.unique(shape.mesh.faces)]])


def random_soup(seed):
    """A non-convex mesh: boxes, rings and sheets in a heap, closed or torn open."""
    rng = np.random.default_rng(seed)
    pieces = []
    for _ in range(rng.integers(1, 6)):
        kind = rng.integers(4)
        size = rng.uniform(0.005, 0.3, 3)
        if kind == 0:
            piece = trimesh.creation.box(size)
        elif kind == 1:
            piece = trimesh.creation.annulus(size[0] / 2.0, size[0], size[1], sections=12)
        elif kind == 2:
            piece = trimesh.Trimesh(rng.normal(size=(12, 3)) * size, rng.integers(0, 12, (10, 3)), process=False)
            piece.update_faces(piece.nondegenerate_faces())
        else:  # a sheet with a step, whose middle lies where a cut may fall
            profile = np.array([[0, 0], [1, 0], [1, 1], [2, 1]]) * size[0]
            y = np.array([[0.0], [size[1]]])
            rows = [np.insert(profile, 1, at, axis=1) for at in y[:, 0]]
            faces = [f for i in range(3) for f in ((i, i + 1, i + 5), (i, i + 5, i + 4))]
            piece = trimesh.Trimesh(np.vstack(rows), faces, process=False)
        upright = rng.random() < 0.5
        turn = pose(rng.uniform(-0.2, 0.2, 3), np.zeros(3) if upright else rng.uniform(-3.0, 3.0, 3))
        pieces.append(piece.apply_transform(turn))
    return trimesh.util.concatenate(pieces)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_covers_of_random_meshes_cover_them(seed):
    mesh = random_soup(seed)
    body = Body.from_mesh("body", mesh)
    points = surface(body.shapes[0], np.random.default_rng(seed), 300)
    assert covered(body.cover, points).all()
    assert len(body.cover) <= 6


@pytest.mark.parametrize("name", [*ROBOTS, *HANDS])
def test_covers_of_shipped_models_cover_them(name, rng):
    rigids = load_robot(name).links if name in ROBOTS else load_hand(name).pieces
    for rigid in rigids:
        for shape, placement in zip(rigid.shapes, rigid.placements, strict=True):
            points = transform_points(placement, surface(shape, rng, 500))
            assert covered(rigid.cover, points).all(), rigid.name


def test_covers_are_tight_enough_to_leave_a_fork_open(make_mesh):
    fork = Body.from_mesh("fork", make_mesh("fork", 0.3, 0.05, 0.2))
    assert not covered(fork.cover, np.array([[0.0, 0.05, 0.0]])).any()
    volume = sum(piece.volume for piece in fork.cover)
    assert volume < 0.8 * fork.mesh.convex_hull.volume


def test_grown_meshes_hold_the_curved_shapes(rng):
    capsule = shapes.from_coal(coal.Capsule(0.02, 0.3))
    for shape in (shapes.cylinder(0.05, 0.2), shapes.sphere(0.07), capsule):
        hull = ConvexHull(shape.mesh.vertices * shape.growth)
        points = surface(shape, rng, 3000)
        assert (points @ hull.equations[:, :3].T + hull.equations[:, 3] <= 1e-12).all()
        assert (points >= shape.bounds[0] - 1e-12).all()
        assert (points <= shape.bounds[1] + 1e-12).all()
        assert (shape.bounds[1] - shape.bounds[0] < 1.03 * np.ptp(points, axis=0) + 1e-3).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_exact_shapes_of_pieces_are_the_body(seed):
    body = Body.from_mesh("body", random_soup(seed))
    points = surface(body.shapes[0], np.random.default_rng(seed), 20)[:40]
    needle, request = coal.Sphere(1e-5), coal.CollisionRequest()
    touched = np.zeros(len(points), dtype=bool)
    for piece in body.cover:
        for geometry, placement in piece.exact or [(piece.geometry, piece.placement)]:
            assert (placement == np.eye(4)).all()
            for i in np.flatnonzero(covered([piece], points)):
                at = coal.Transform3s(np.eye(3), points[i])
                touched[i] |= (
                    coal.collide(geometry, coal.Transform3s(), needle, at, request, coal.CollisionResult()) > 0
                )
    assert touched.all()


@pytest.mark.parametrize("turned", [False, True])
def test_covers_hold_what_closed_surfaces_enclose(rng, turned):
    # A thick cross of three bars: cuts fall across its middle.
    bars = [trimesh.creation.box(np.where(np.arange(3) == axis, 0.6, 0.16)) for axis in range(3)]
    mesh = trimesh.util.concatenate(bars)
    mesh.apply_scale((1.0, 0.9, 0.8))
    if turned:
        mesh.apply_transform(pose((0.1, 0.2, 0.3), (0.3, 0.2, 0.1)))
    body = Body.from_mesh("cross", mesh)
    assert len(body.cover) > 2
    points = rng.uniform(*mesh.bounds, (5000, 3))
    inside = shapes.winding_number(mesh, points) > 0.5
    assert inside.sum() > 200
    assert covered(body.cover, points[inside]).all()


def test_rounded_hulls_hold_their_points_and_little_more(rng):
    points = rng.normal(size=(4000, 3))
    points *= 0.1 / np.linalg.norm(points, axis=1, keepdims=True)
    hull = shapes.rounded_hull(points)
    assert hull.num_points < 0.5 * len(points)
    assert held(hull, points[:300]).all()
    assert not held(hull, 1.01 * points[:300]).any()


# Windings -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "sizes"), [("fork", (0.1, 0.02, 0.05)), ("bracket", (0.1, 0.02, 0.05))])
def test_windings_tell_inside_from_outside(make_mesh, rng, kind, sizes):
    mesh = make_mesh(kind, *sizes)
    points = rng.uniform(mesh.bounds[0] - 0.01, mesh.bounds[1] + 0.01, (500, 3))
    x, y, z = points.T
    if kind == "fork":
        inside = (np.abs(x) < 0.05) & (np.abs(y) < 0.05) & ((np.abs(x) > 0.03) | (y < -0.03)) & (np.abs(z) < 0.025)
    else:
        inside = (np.minimum(x, y) > 0.0) & (np.maximum(x, y) < 0.1) & (np.minimum(x, y) < 0.02) & (np.abs(z) < 0.025)
    winding = shapes.winding_number(mesh, points)
    assert np.allclose(winding, inside, atol=1e-6)
    assert 50 < inside.sum() < 450
    flipped = mesh.copy()
    flipped.invert()
    assert np.allclose(shapes.winding_number(flipped, points), -winding, atol=1e-6)


def test_windings_of_nested_and_open_surfaces():
    outer, cavity = trimesh.creation.icosphere(2, 1.0), trimesh.creation.icosphere(2, 0.5)
    cavity.invert()
    points = np.array([[0.0, 0.0, 0.0], [0.0, 0.7, 0.0], [0.0, 2.0, 0.0]])
    shell = trimesh.util.concatenate([outer, cavity])
    assert np.allclose(shapes.winding_number(shell, points), [0.0, 1.0, 0.0], atol=1e-6)
    half = outer.submesh([np.flatnonzero(outer.triangles_center[:, 2] > 0.0)], append=True)
    assert 0.3 < shapes.winding_number(half, points[:1])[0] < 0.7


# Hulls ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 30])
def test_hulls_of_flat_points_are_filled_shapes(rng, rank, count):
    axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:rank]
    points = rng.uniform(-0.1, 0.1, (count, rank)) @ axes + (0.3, -0.2, 0.5)
    hull = shapes.convex_hull(points)
    assert held(hull, points).all()
    needle = coal.Sphere(1e-4)
    for point in points:
        at = coal.Transform3s(np.eye(3), point)
        assert coal.collide(hull, coal.Transform3s(), needle, at, coal.CollisionRequest(), coal.CollisionResult())


def test_flat_parts_collide(rng):
    sheet = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], [[0, 1, 2], [0, 2, 3]])
    plate, ball = Body.from_mesh("plate", sheet), Body.of("ball", shapes.sphere(0.01))
    assert covered(plate.cover, sheet.vertices).all()
    assert plate.touches(ball, pose((0.05, 0.05, 0.009)))
    assert not plate.touches(ball, pose((0.05, 0.05, 0.011)))


# Kinds ----------------------------------------------------------------------------------------------------------------


def test_convex_meshes_are_filled_and_others_are_surfaces(make_mesh):
    assert shapes.from_mesh(trimesh.creation.icosphere(2, 0.1)).solid
    assert shapes.from_mesh(trimesh.creation.box((0.1, 0.2, 0.3))).solid
    assert not shapes.from_mesh(make_mesh("fork", 0.1, 0.02, 0.05)).solid
    dented = trimesh.creation.icosphere(2, 0.1)
    dented.vertices[0] *= 0.9
    assert not shapes.from_mesh(dented).solid
    torn = trimesh.creation.box((0.1, 0.2, 0.3))
    torn.update_faces(np.arange(12) > 0)
    assert not shapes.from_mesh(torn).solid


@pytest.mark.parametrize(
    ("geometry", "extents"),
    [
        (coal.Box(0.1, 0.2, 0.3), (0.1, 0.2, 0.3)),
        (coal.Cylinder(0.1, 0.3), (0.2, 0.2, 0.3)),
        (coal.Sphere(0.1), (0.2, 0.2, 0.2)),
        (coal.Capsule(0.05, 0.3), (0.1, 0.1, 0.4)),
    ],
)
def test_primitives_keep_their_size(geometry, extents):
    shape = shapes.from_coal(geometry)
    assert shape.solid
    assert np.allclose(shape.mesh.extents, extents, rtol=0.01)
    assert np.allclose(shape.mesh.bounds.sum(axis=0), 0.0, atol=1e-3)


def test_meshes_come_back_from_their_hierarchy(make_mesh):
    mesh = make_mesh("wheel", 0.01, 0.05, 0.02)
    back = shapes.from_coal(shapes.triangles(mesh)).mesh
    assert np.isclose(back.volume, mesh.volume)
    assert back.is_watertight
    with pytest.raises(TypeError, match="Cone"):
        shapes.from_coal(coal.Cone(0.1, 0.2))
