"""Placements: they rest, on what they say, as firmly as they say; and rolling surfaces are left out."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from kumitate.errors import InputError
from kumitate.grasping.part import Part
from kumitate.regrasp.placements import SMALLEST_MARGIN, find_placements
from kumitate.transforms import rotation_about, transform_points

seeds = st.integers(0, 10**6)
laws = settings(max_examples=40, deadline=None)


def random_hull(seed: int) -> trimesh.Trimesh:
    """A convex hull of 5 to 20 random points, 20 to 60 mm large, longer one way than the other."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(rng.integers(5, 20), 3)) * rng.uniform(0.3, 1.0, 3)
    return trimesh.convex.convex_hull(points * rng.uniform(0.02, 0.06) / np.ptp(points, axis=0).max())


def sharp_hull(seed: int) -> trimesh.Trimesh:
    """The first such hull from a seed on that has no two faces nearly in one plane."""
    while True:
        hull = random_hull(seed)
        if (hull.face_adjacency_angles > np.radians(3.0)).all():
            return hull
        seed += 1


def random_body(seed: int) -> trimesh.Trimesh:
    """A hull, or two boxes that overlap (not convex), or a hull with many small facets, in a random orientation."""
    rng = np.random.default_rng(seed)
    kind = seed % 3
    if kind == 0:
        return random_hull(seed)
    if kind == 1:
        blocks = [trimesh.creation.box(rng.uniform(0.01, 0.05, 3)) for _ in range(2)]
        blocks[1].apply_translation(rng.uniform(-0.01, 0.01, 3))
        mesh = trimesh.util.concatenate(blocks)
    else:
        mesh = trimesh.creation.icosphere(3, 0.02)
        mesh.vertices *= rng.uniform(0.5, 1.5, 3)
        mesh = trimesh.convex.convex_hull(mesh.vertices[mesh.vertices[:, 2] > -rng.uniform(0.0, 0.008)])
    return mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.uniform(size=3)))


def part_of(mesh: trimesh.Trimesh) -> Part:
    return Part.from_mesh(mesh, mass=0.1)


def normals(part: Part, placements) -> np.ndarray:
    """Downward direction (n, 3) of each placement in the part's frame."""
    return -placements.surface_from_part[:, 2, :3]


@laws
@given(seeds)
def test_the_part_rests_on_the_plane_and_its_weight_falls_inside_the_support_polygon(seed):
    part = part_of(random_body(seed))
    placements = find_placements(part)
    for i, pose in enumerate(placements.surface_from_part):
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
        points = transform_points(pose, part.mesh.vertices)
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        center = transform_points(pose, part.center_of_mass[None])[0]
        np.testing.assert_allclose(center, [0.0, 0.0, placements.height[i]], atol=1e-12)
        touching = points[points[:, 2] < np.tan(np.radians(1.0)) * np.ptp(points, axis=0).max(), :2]
        polygon = placements.support[i]
        for corner in polygon:
            assert np.linalg.norm(touching - corner, axis=1).min() < 1e-9
        after = np.roll(polygon, -1, axis=0)
        assert (
            polygon[:, 0] * after[:, 1] - polygon[:, 1] * after[:, 0] > 0.0
        ).all()  # the origin is left of all edges
        assert placements.margin[i] >= SMALLEST_MARGIN


@laws
@given(seeds)
def test_sharp_hulls_rest_on_three_points_or_more_that_touch_the_plane(seed):
    part = part_of(random_hull(seed))
    placements = find_placements(part)
    for i, pose in enumerate(placements.surface_from_part):
        low = np.flatnonzero(transform_points(pose, part.mesh.vertices)[:, 2] < 1e-9)
        assert len(low) >= 3
        assert (
            ConvexHull(transform_points(pose, part.mesh.vertices)[low, :2]).volume <= placements.support.area[i] + 1e-12
        )


@laws
@given(seeds)
def test_tilting_by_the_margin_brings_the_weight_above_the_weakest_edge(seed):
    part = part_of(sharp_hull(seed))
    placements = find_placements(part)
    for i, pose in enumerate(placements.surface_from_part):
        polygon = placements.support[i]
        start, along = polygon, np.roll(polygon, -1, axis=0) - polygon
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
        flat = np.zeros((len(polygon), 1))
        axes = np.hstack([along / np.linalg.norm(along, axis=1)[:, None], flat])
        center = np.array([0.0, 0.0, placements.height[i]])
        arm = center - np.hstack([start, flat])

        def beyond(tilt, axes=axes, arm=arm, outward=outward):
            """How far (k,) the weight is beyond each edge when the part is tilted about that edge."""
            moved = (rotation_about(axes, tilt) @ arm[..., None])[..., 0]
            return (moved[:, :2] * outward).sum(axis=1)

        assert (beyond(placements.margin[i] - 1e-4) < 0.0).all()
        assert (beyond(placements.margin[i] + 1e-4) > 0.0).any()
        assert transform_points(pose, part.center_of_mass[None])[0] == pytest.approx(center, abs=1e-12)


@laws
@given(seeds)
def test_no_stable_face_of_a_sharp_hull_is_missed(seed):
    """Judged on the hull's own triangles: the foot of the weight in the triangle, its distance from the sides."""
    part = part_of(random_hull(seed))
    found = normals(part, find_placements(part))
    corners, out = part.mesh.triangles, part.mesh.face_normals
    neighbours = out @ out.T - 2.0 * np.eye(len(out))
    sharp = neighbours.max(axis=1) < np.cos(np.radians(2.0))  # no other face nearly in its plane
    height = np.einsum("ni,ni->n", corners[:, 0] - part.center_of_mass, out)
    foot = part.center_of_mass + height[:, None] * out
    sides = np.roll(corners, -1, axis=1) - corners
    inward = np.cross(out[:, None], sides) / np.linalg.norm(sides, axis=2, keepdims=True)
    distance = np.einsum("nki,nki->nk", foot[:, None] - corners, inward).min(axis=1)
    stable = distance > 0.0
    alone = (neighbours[:, stable] < np.cos(np.radians(46.0))).all(axis=1)  # nothing near that it could roll onto
    margin = np.arctan2(distance, height)
    for i in np.flatnonzero(stable & sharp & alone & (margin > SMALLEST_MARGIN + 1e-6)):
        assert (found @ out[i]).max() > 1.0 - 1e-9
    for normal in found:
        face = (out @ normal).argmax()
        assert not sharp[face] or stable[face]


def test_a_box_has_six_placements():
    half = np.array([0.02, 0.015, 0.01])
    placements = find_placements(part_of(trimesh.creation.box(2.0 * half)))
    assert len(placements) == 6
    expected, shares = [], []
    for axis in range(3):
        a, b = np.delete(half, axis)
        expected += 2 * [np.arctan(min(a, b) / half[axis])]
        shares += 2 * [4.0 * np.arctan2(a * b, half[axis] * np.linalg.norm(half)) / (4.0 * np.pi)]
    order = np.argsort(-np.array(expected), kind="stable")
    np.testing.assert_allclose(placements.margin, np.array(expected)[order], atol=1e-9)
    np.testing.assert_allclose(placements.share, np.array(shares)[order], atol=1e-9)
    assert placements.share.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(np.sort(placements.height), np.repeat(np.sort(half), 2), atol=1e-12)
    np.testing.assert_allclose(placements.support.area * placements.height * 2.0, 8.0 * half.prod(), rtol=1e-9)


@laws
@given(seeds)
def test_margins_do_not_depend_on_the_frame_of_the_mesh(seed):
    mesh = random_body(seed - seed % 3 + seed % 2)  # not the egg: which of its equal triangles merge is chance
    turn = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed + 1).uniform(size=3))
    here, there = (find_placements(part_of(m)) for m in (mesh, mesh.copy().apply_transform(turn)))
    np.testing.assert_allclose(np.sort(here.margin), np.sort(there.margin), atol=1e-6)
    np.testing.assert_allclose(np.sort(here.height), np.sort(there.height), atol=1e-8)


@laws
@given(seeds)
def test_the_order_of_faces_changes_nothing(seed):
    mesh, rng = random_body(seed), np.random.default_rng(seed)
    shuffle = rng.permutation(len(mesh.vertices))
    faces = np.argsort(shuffle)[mesh.faces][rng.permutation(len(mesh.faces))]
    shuffled = trimesh.Trimesh(mesh.vertices[shuffle], faces, process=False)
    here, there = find_placements(part_of(mesh)), find_placements(part_of(shuffled))
    np.testing.assert_allclose(here.surface_from_part, there.surface_from_part, atol=1e-9)
    np.testing.assert_allclose(here.share, there.share, atol=1e-9)


@pytest.mark.parametrize("sections", [*range(8, 41), 50, 64, 100, 128, 200, 360, 400])
def test_a_cylinder_of_any_number_of_sections_has_two(sections):
    part = part_of(trimesh.creation.cylinder(0.02, 0.05, sections=sections))
    placements = find_placements(part)
    np.testing.assert_allclose(np.abs(normals(part, placements)[:, 2]), [1.0, 1.0], atol=1e-9)


@pytest.mark.parametrize("sections", [3, 4, 5, 6, 7])
def test_prisms_of_few_sides_may_rest_on_each(sections):
    part = part_of(trimesh.creation.cylinder(0.02, 0.05, sections=sections))
    assert len(find_placements(part)) == sections + 2


def test_a_ball_has_none_and_half_a_ball_its_flat_side():
    ball = trimesh.creation.icosphere(3, 0.03)
    nothing = find_placements(part_of(ball))
    assert len(nothing) == 0
    assert nothing.surface_from_part.shape == (0, 4, 4)
    half = trimesh.convex.convex_hull(ball.vertices[ball.vertices[:, 2] > -1e-9])
    flat = find_placements(part_of(half))
    np.testing.assert_allclose(normals(part_of(half), flat), [[0.0, 0.0, -1.0]], atol=1e-9)
    np.testing.assert_allclose(flat.margin, np.arctan(8.0 / 3.0), atol=0.03)  # its weight is 3/8 of the radius up


@pytest.mark.parametrize(("slope", "tall", "ledge_margin"), [(15.0, 0.050, (1.0, 5.0)), (19.0, 0.053, (5.0, 7.0))])
def test_a_base_is_kept_and_a_shallow_ledge_beside_it_that_lies_higher_is_not(slope, tall, ledge_margin):
    """The part rocks over to the ledge when tilted far enough, but rolls by itself only from there to the base."""
    rise = np.tan(np.radians(slope)) * 0.03
    profile = np.array([[-0.03, 0.0], [0.01, 0.0], [0.04, rise], [0.04, tall], [-0.03, tall]])
    vertices = np.vstack([np.column_stack([np.full(5, y), profile]) for y in (-0.05, 0.05)])
    part = part_of(trimesh.convex.convex_hull(vertices))
    base_margin = np.degrees(np.arctan2(0.01 - part.center_of_mass[1], part.center_of_mass[2]))
    assert ledge_margin[0] < slope - base_margin < ledge_margin[1]  # both hold the weight
    down = normals(part, find_placements(part))
    assert (down @ [0.0, 0.0, -1.0] > 0.999).any()
    assert not (down @ [0.0, np.sin(np.radians(slope)), -np.cos(np.radians(slope))] > 0.999).any()


def test_a_nearly_flat_bottom_of_many_faces_is_one_face(rng):
    """Dents of a few hundredths of a millimetre must not topple a box of 60 mm."""
    box = trimesh.creation.box([0.06, 0.05, 0.04]).subdivide().subdivide()
    rough = box.vertices + rng.normal(size=box.vertices.shape) * 2e-5
    part = part_of(trimesh.Trimesh(rough, box.faces, process=False))
    smooth = find_placements(part_of(box))
    placements = find_placements(part)
    assert len(placements) == 6
    np.testing.assert_allclose(placements.margin, smooth.margin, atol=np.radians(1.0))


@pytest.mark.parametrize("chosen", [[4, 0, 4], [5], []])
def test_taking_placements_takes_all_that_is_told_of_them(chosen):
    whole = find_placements(part_of(trimesh.creation.box([0.05, 0.04, 0.02])))
    taken = whole.take(np.array(chosen, dtype=np.int64))
    assert len(taken) == len(taken.support) == len(taken.outline) == len(chosen)
    for name in ("surface_from_part", "margin", "height", "share"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(whole, name)[chosen])
    for k, i in enumerate(chosen):
        np.testing.assert_array_equal(taken.support[k], whole.support[i])
        np.testing.assert_array_equal(taken.outline[k], whole.outline[i])


def test_a_weight_outside_the_hull_is_refused():
    box = part_of(trimesh.creation.box([0.04, 0.03, 0.02]))
    wrong = Part("box", box.mesh, 0.1, np.array([0.03, 0.0, 0.0]), watertight=True)
    with pytest.raises(InputError, match="outside the convex hull"):
        find_placements(wrong)


@pytest.mark.parametrize(
    ("name", "margins"),
    [
        ("housing", [64.7, 45.3]),
        ("planewheel", [65.9, 61.0]),
        ("planefrontstay", [47.3, 47.3, 23.3, 7.1]),
        ("tool_motordriver", [37.4, 37.4, 31.7, 26.3, 24.1]),
        ("ttube", [55.1, 55.1, 33.4, 21.4, 10.1, 10.1]),
        ("sandpart", [57.1, 22.1, 21.2]),
    ],
)
def test_the_papers_parts(paper_objects, name, margins):
    part = Part.load(paper_objects / f"{name}.stl", unit="m", mass=0.1)
    placements = find_placements(part)
    np.testing.assert_allclose(np.degrees(placements.margin), margins, atol=0.06)


def test_the_wheel_stands_on_either_end_of_its_axis(paper_objects):
    part = Part.load(paper_objects / "planewheel.stl", unit="m", mass=0.1)
    placements = find_placements(part)
    np.testing.assert_allclose(np.sort(normals(part, placements)[:, 1]), [-1.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(np.sort(placements.share), [0.26, 0.30], atol=0.006)


def test_the_support_stands_upright_on_its_base(paper_objects):
    placements = find_placements(Part.load(paper_objects / "planefrontstay.stl", unit="m", mass=0.1))
    np.testing.assert_allclose(np.sort(np.ptp(placements.support[2], axis=0)), [0.030, 0.060], atol=1e-4)
    np.testing.assert_allclose(placements.share, [0.445, 0.445, 0.106, 0.004], atol=0.001)
