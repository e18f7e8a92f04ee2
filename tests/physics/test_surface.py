"""The surface as wedges: they tile it, lie inside, and are convex."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from kumitate.physics.surface import convex_polygons, simplified, wedges
from kumitate.robots.shapes import winding_number

SHAPES = {
    "box": lambda: trimesh.creation.box((0.04, 0.03, 0.02)),
    "ring": lambda: trimesh.creation.annulus(0.01, 0.02, 0.015),
    "ball": lambda: trimesh.creation.icosphere(2, 0.02),
    "sheet": lambda: trimesh.creation.box((0.05, 0.05, 0.0004)),
    "corner": lambda: trimesh.boolean.union([box((0.04, 0.01, 0.01), 0.02), box((0.01, 0.04, 0.01), 0.005)]),
}


def box(sides, x: float) -> trimesh.Trimesh:
    """A box with its middle at (x, half its width, 0)."""
    return trimesh.creation.box(sides, trimesh.transformations.translation_matrix([x, sides[1] / 2.0, 0.0]))


@pytest.fixture(params=SHAPES)
def mesh(request) -> trimesh.Trimesh:
    return SHAPES[request.param]()


def area(points: np.ndarray) -> float:
    spokes = points - points.mean(axis=0)
    return float(np.linalg.norm(np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0))) / 2.0


def test_polygons_tile_the_surface_and_are_nearly_convex(mesh):
    """Nowhere does the hull of one reach over its outline by more than 0.05 mm, into the hole of a ring at most."""
    rings = convex_polygons(mesh)
    assert sum(area(mesh.vertices[ring]) for ring, _ in rings) == pytest.approx(mesh.area, rel=1e-9)
    for ring, face in rings:
        points = mesh.vertices[ring]
        normal = mesh.face_normals[face]
        np.testing.assert_allclose((points - points[0]) @ normal, 0.0, atol=1e-9)
        frame = trimesh.geometry.plane_transform(points[0], normal)
        hull = ConvexHull(trimesh.transform_points(points, frame)[:, :2])
        assert hull.volume - area(points) <= 5e-5 * hull.area
        depth = -(hull.points @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)
        assert depth.max() <= 5e-5 + 1e-12


def test_flat_faces_of_a_box_are_one_polygon_each():
    assert len(convex_polygons(SHAPES["box"]())) == 6


def test_a_hollow_face_is_cut_but_not_filled():
    """The end of a ring: its hole stays open, and there are fewer polygons than triangles."""
    mesh = SHAPES["ring"]()
    rings = convex_polygons(mesh)
    assert len(rings) < len(mesh.faces)
    corners = wedges(mesh)
    outer = [points[: len(points) // 2] for points in corners]
    across = np.array(
        [0.5 * (points[i] + points[i - k]) for points in outer for k in (1, 2, 3) for i in range(len(points))]
    )
    inner_chord = 0.01 * np.cos(np.pi / 32)
    assert np.linalg.norm(across[:, :2], axis=1).min() > inner_chord - 1e-4  # nothing reaches over the hole


def test_wedges_lie_inside(mesh):
    for points in wedges(mesh):
        outer, inner = np.split(points, 2)
        assert ConvexHull(points).volume > 0.0
        inside = np.concatenate([inner, 0.5 * (inner + outer), points.mean(axis=0, keepdims=True)])
        assert (winding_number(mesh, inside) > 0.5).all()


def test_what_a_mesher_put_into_flat_faces_is_left_out():
    """Grids on the faces of a box and a ring of triangles on that of a ring cost no wedges; nothing is lost."""
    for name in ("box", "ring", "corner"):
        coarse = SHAPES[name]()
        fine = coarse.subdivide().subdivide()
        found = simplified(fine)
        assert len(found.faces) <= len(coarse.faces)
        assert found.area == pytest.approx(coarse.area, rel=1e-6)
        assert found.volume == pytest.approx(coarse.volume, rel=1e-6)
        assert len(wedges(fine)) <= len(convex_polygons(coarse))


def test_a_curved_surface_moves_by_a_hundredth_of_a_millimetre():
    """A ball with triangles of a fifth of a millimetre loses many, and sinks by 0.01 mm at most."""
    radius = 0.006
    fine = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    chord = radius - np.linalg.norm(fine.triangles_center, axis=1).min()
    found = simplified(fine)
    assert len(found.faces) < 0.9 * len(fine.faces)
    middles = found.vertices[found.edges_unique].mean(axis=1)
    depth = radius - np.linalg.norm(np.concatenate([found.triangles_center, middles]), axis=1)
    assert depth.min() >= 0.0
    assert depth.max() <= 1e-5 + chord


def test_a_mesh_that_leaks_stays_as_it_is():
    leaky = SHAPES["box"]()
    leaky.update_faces(np.arange(len(leaky.faces)) > 0)
    assert simplified(leaky) is leaky
