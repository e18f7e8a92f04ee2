"""Supports and spots: parts stand on the rectangle, at every turn, clear of what is there already."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kumitate.errors import InputError
from kumitate.grasping.part import Part
from kumitate.regrasp.placements import find_placements
from kumitate.regrasp.polygons import outline
from kumitate.regrasp.supports import Support, find_spots
from kumitate.robots.state import Body
from kumitate.transforms import invert, pose, transform_points

laws = settings(max_examples=30, deadline=None)


@pytest.fixture(scope="module")
def wedge() -> Part:
    """A part without symmetry."""
    corners = [[0, 0, 0], [0.06, 0, 0], [0, 0.04, 0], [0.01, 0.01, 0.03], [0.05, 0.03, 0.0], [0.03, 0.03, 0.02]]
    return Part.from_mesh(trimesh.convex.convex_hull(np.array(corners, dtype=float)), mass=0.1, name="wedge")


@laws
@given(
    at=st.tuples(*[st.floats(-0.5, 0.5)] * 3),
    yaw=st.floats(-np.pi, np.pi),
    size=st.tuples(*[st.floats(0.05, 0.5)] * 2),
    turns=st.integers(1, 8),
    spacing=st.floats(0.02, 0.2),
)
def test_parts_rest_on_the_rectangle_with_their_support_polygon_inside(wedge, at, yaw, size, turns, spacing):
    placements = find_placements(wedge)
    support = Support("shelf", pose(at, [0.0, 0.0, yaw]), size)
    spots = find_spots(placements, support, turns=turns, spacing=spacing)
    support_from_part = invert(support.world_from_support) @ spots.world_from_part
    points = transform_points(support_from_part, wedge.mesh.vertices)
    np.testing.assert_allclose(points[..., 2].min(axis=1), 0.0, atol=1e-9)
    centers = transform_points(support_from_part, wedge.center_of_mass[None])[:, 0]
    np.testing.assert_allclose(centers[:, 2], placements.height[spots.placement], atol=1e-9)
    for i in range(len(spots)):
        touching = points[i][points[i, :, 2] < 1e-6, :2]
        assert (np.abs(touching) <= np.array(size) / 2.0 - 0.005 + 1e-9).all()
    steps = centers[:, None, :2] - centers[:1, :2] if len(spots) else np.zeros((0, 1, 2))
    np.testing.assert_allclose(steps / spacing, np.round(steps / spacing), atol=1e-6)


def test_every_spot_that_fits_is_there(wedge):
    """Counted one by one: each placement, turn and point of the grid, with the support polygon's own corners."""
    placements = find_placements(wedge)
    support = Support("shelf", pose([0.3, -0.2, 0.1]), [0.21, 0.13])
    spots = find_spots(placements, support, turns=6, spacing=0.04, inset=0.01)
    grid = [(0.04 * x, 0.04 * y) for x in (-2.5, -1.5, -0.5, 0.5, 1.5, 2.5) for y in (-1.5, -0.5, 0.5, 1.5)]
    fits = 0
    for polygon in (placements.support[i] @ [1.0, 1j] for i in range(len(placements))):
        for turn in np.arange(6) * np.pi / 3.0:
            for x, y in grid:
                corners = polygon * np.exp(1j * turn) + x + 1j * y
                fits += (np.abs(corners.real) <= 0.095).all() and (np.abs(corners.imag) <= 0.055).all()
    assert len(spots) == fits > 100
    assert len(np.unique(np.round(spots.world_from_part, 9), axis=0)) == fits


def test_turns_are_turns_about_the_vertical_through_the_weight(wedge):
    placements = find_placements(wedge)
    spots = find_spots(placements, Support("table", np.eye(4), [0.3, 0.3]), turns=4, spacing=1.0)
    assert len(spots) == 4 * len(placements)
    np.testing.assert_array_equal(spots.placement, np.repeat(np.arange(len(placements)), 4))
    for which, turn, world_from_part in zip(spots.placement, spots.turn, spots.world_from_part, strict=True):
        expected = pose(rpy=[0.0, 0.0, turn]) @ placements.surface_from_part[which]
        np.testing.assert_allclose(world_from_part, expected, atol=1e-12)


def test_spots_keep_clear_of_what_stands_there(wedge):
    """A post that covers one quarter of the shelf: what is left out overlaps it, what is left does not."""
    placements = find_placements(wedge)
    support = Support("shelf", pose([0.4, 0.1, 0.2], [0.0, 0.0, 0.5]), [0.4, 0.4])
    post = Body.box("post", [0.2, 0.2, 0.3], fixed=True)
    world_from_post = support.world_from_support @ pose([0.1, 0.1, 0.15], [0.0, 0.0, 0.3])
    there = outline(transform_points(world_from_post, post.mesh.vertices))
    every, free = (find_spots(placements, support, occupied=o) for o in ((), [there]))
    assert 0 < len(free) < len(every)
    keys = {tuple(np.round(pose.ravel(), 9)) for pose in free.world_from_part}
    for world_from_part in every.world_from_part:
        seen = outline(transform_points(world_from_part, wedge.mesh.vertices))
        assert overlap(seen, there) == (tuple(np.round(world_from_part.ravel(), 9)) not in keys)


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether a point of a fine grid lies inside both polygons."""
    low, high = np.maximum(a.min(axis=0), b.min(axis=0)), np.minimum(a.max(axis=0), b.max(axis=0))
    if (low >= high).any():
        return False
    axes = np.linspace(low, high, 200).T
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = np.ones(len(points), dtype=bool)
    for polygon in (a, b):
        along = np.roll(polygon, -1, axis=0) - polygon
        offset = points[:, None] - polygon
        inside &= (along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0] > 0.0).all(axis=1)
    return bool(inside.any())


def test_surfaces_at_several_heights(wedge):
    placements = find_placements(wedge)
    table = Support.top_of(Body.box("table", [0.5, 0.3, 0.02], fixed=True), pose([0.4, 0.0, -0.06]))
    shelf = Support.top_of(Body.box("shelf", [0.2, 0.2, 0.1], fixed=True), pose([0.4, 0.5, 0.3]))
    for support, height in ((table, -0.05), (shelf, 0.35)):
        spots = find_spots(placements, support)
        lowest = transform_points(spots.world_from_part, wedge.mesh.vertices)[..., 2].min(axis=1)
        np.testing.assert_allclose(lowest, height, atol=1e-9)


@laws
@given(at=st.tuples(*[st.floats(-0.5, 0.5)] * 3), yaw=st.floats(-np.pi, np.pi), flip=st.booleans())
def test_the_top_of_a_box(at, yaw, flip):
    box = Body.box("table", [0.5, 0.3, 0.02], fixed=True)
    support = Support.top_of(box, pose(at, [np.pi * flip, 0.0, yaw]))
    np.testing.assert_allclose(support.world_from_support[:3, 3], np.add(at, [0.0, 0.0, 0.01]), atol=1e-9)
    np.testing.assert_allclose(np.sort(support.size), [0.3, 0.5], atol=1e-9)
    assert support.world_from_support[0, 0] > np.cos(np.pi / 4.0) - 1e-6
    corners = transform_points(pose(at, [np.pi * flip, 0.0, yaw]), box.mesh.vertices)
    inside = transform_points(invert(support.world_from_support), corners[corners[:, 2] > at[2]])
    np.testing.assert_allclose(np.abs(inside[:, :2]), np.tile(support.size / 2.0, (4, 1)), atol=1e-9)


def test_the_top_of_a_fixture_that_is_a_level_rectangle():
    base = trimesh.creation.box([0.2, 0.2, 0.02])
    step = trimesh.creation.box([0.1, 0.06, 0.05]).apply_translation([0.03, 0.02, 0.03])
    fixture = Body.from_mesh("fixture", trimesh.util.concatenate([base, step]), fixed=True)
    support = Support.top_of(fixture, np.eye(4))
    np.testing.assert_allclose(support.world_from_support, pose([0.03, 0.02, 0.055]), atol=1e-9)
    np.testing.assert_allclose(support.size, [0.1, 0.06], atol=1e-9)


@pytest.mark.parametrize(
    ("mesh", "tilt"),
    [
        (trimesh.creation.box([0.2, 0.1, 0.05]), 0.01),
        (trimesh.creation.box([0.2, 0.1, 0.05]), np.pi / 4),
        (trimesh.creation.cylinder(0.1, 0.05), 0.0),
        (trimesh.creation.annulus(0.05, 0.1, 0.05, sections=4), 0.0),  # the rim of a square box without a bottom
        (trimesh.creation.cone(0.1, 0.1), 0.0),
    ],
)
def test_tops_that_are_no_level_rectangle_are_refused(mesh, tilt):
    with pytest.raises(InputError, match="no level rectangle"):
        Support.top_of(Body.from_mesh("fixture", mesh, fixed=True), pose(rpy=[tilt, 0.0, 0.0]))


@pytest.mark.parametrize(
    ("where", "size", "words"),
    [
        (pose(rpy=[0.01, 0.0, 0.0]), [0.1, 0.1], "not level"),
        (pose(rpy=[np.pi, 0.0, 0.0]), [0.1, 0.1], "not level"),
        (np.eye(4)[None], [0.1, 0.1], "not level"),
        (np.full((4, 4), np.nan), [0.1, 0.1], "rigid"),
        (np.eye(4), [0.1, 0.0], "size"),
        (np.eye(4), [0.1, 0.1, 0.1], "size"),
        (np.eye(4), [0.1, np.inf], "size"),
    ],
)
def test_wrong_supports_are_refused(where, size, words):
    with pytest.raises(InputError, match=words):
        Support("shelf", where, size)


@pytest.mark.parametrize("wrong", [{"turns": 0}, {"spacing": 0.0}, {"spacing": np.nan}, {"inset": -0.01}])
def test_wrong_spots_are_refused(wedge, wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        find_spots(find_placements(wedge), Support("table", np.eye(4), [0.3, 0.3]), **wrong)


def test_a_part_without_placements_and_a_support_that_is_too_small_have_no_spots(wedge):
    ball = find_placements(Part.from_mesh(trimesh.creation.icosphere(3, 0.03), mass=0.1))
    assert len(find_spots(ball, Support("table", np.eye(4), [0.3, 0.3]))) == 0
    none = find_spots(find_placements(wedge), Support("table", np.eye(4), [0.005, 0.005]))
    assert len(none) == 0
    assert none.world_from_part.shape == (0, 4, 4)
