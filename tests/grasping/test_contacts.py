"""Sampling and the two refinements, checked by brute force."""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from kumitate.errors import InputError
from kumitate.grasping.contacts import at_most, boundary_distance, sample_contacts, sample_surface, thin
from kumitate.grasping.facets import segment
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part

seeds = st.integers(0, 2**32 - 1)
NAMED = ["housing", "planewheel", "ttube", "bunnysim", "sandpart"]


def planned(part, **knobs):
    parameters = GraspParameters(**knobs)
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    return facets, *sample_contacts(part, facets, parameters)


def lone_edges(faces: np.ndarray) -> list[tuple[int, int]]:
    """Edges that one triangle alone has."""
    count = Counter(tuple(sorted(edge)) for face in faces.tolist() for edge in combinations(face, 2))
    return [edge for edge, n in count.items() if n == 1]


def to_segments(points: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Distance of each point to the nearest of some segments, by brute force."""
    along = ends - starts
    share = np.einsum("nmi,mi->nm", points[:, None] - starts, along) / (along**2).sum(axis=1)
    foot = starts + np.clip(share, 0, 1)[..., None] * along
    return np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1)


def test_equal_meshes_have_equal_samples(random_part):
    (a, faces_a), (b, faces_b) = sample_surface(random_part(7), 3e-3), sample_surface(random_part(7), 3e-3)
    assert np.array_equal(a, b)
    assert np.array_equal(faces_a, faces_b)


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_samples_lie_on_their_triangles(random_part, seed):
    part = random_part(seed)
    points, faces = sample_surface(part, 3e-3)
    weights = trimesh.triangles.points_to_barycentric(part.mesh.triangles[faces], points)
    assert weights.min() > -1e-9
    off = np.einsum("ni,ni->n", points - part.mesh.triangles[faces][:, 0], part.mesh.face_normals[faces])
    assert np.abs(off).max() < 1e-12


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_samples_are_even(random_part, seed):
    """No spot of the surface is farther than t_rnn from a sample, and each triangle has its share to within one."""
    t_rnn = 3e-3
    part = random_part(seed)
    points, faces = sample_surface(part, t_rnn)
    probes, _ = trimesh.sample.sample_surface(part.mesh, 2000, seed=seed % 2**31)
    gap = cKDTree(points).query(probes)[0]
    assert gap.max() < t_rnn
    assert gap.mean() < 0.35 * t_rnn
    due = part.mesh.area_faces / part.mesh.area * len(points)
    assert np.abs(np.bincount(faces, minlength=len(due)) - due).max() <= 1.0 + 1e-6


def test_samples_are_more_even_than_random_ones(random_part):
    part = Part.from_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.03), mass=0.1)
    points, _ = sample_surface(part, 3e-3)
    chance, _ = trimesh.sample.sample_surface(part.mesh, len(points), seed=3)
    probes, _ = trimesh.sample.sample_surface(part.mesh, 5000, seed=4)
    assert cKDTree(points).query(probes)[0].max() < 0.8 * cKDTree(chance).query(probes)[0].max()


@settings(max_examples=25, deadline=None)
@given(seed=seeds, t_bdry=st.sampled_from([0.0, 5e-4, 2e-3, 4e-3]), t_rnn=st.sampled_from([2e-3, 3e-3, 6e-3]))
def test_refinements(random_part, seed, t_bdry, t_rnn):
    part = random_part(seed)
    facets, contacts, stages = planned(part, t_bdry=t_bdry, t_rnn=t_rnn)
    points, faces = sample_surface(part, t_rnn)
    distributed = inner = 0
    for i in range(len(facets)):
        mine = np.flatnonzero(np.isin(faces, facets[i]))
        distributed += len(mine)
        edges = np.array(lone_edges(part.mesh.faces[facets[i]]), dtype=int).reshape(-1, 2)
        if len(edges):
            starts, ends = part.mesh.vertices[edges[:, 0]], part.mesh.vertices[edges[:, 1]]
            mine = mine[to_segments(points[mine], starts, ends) >= t_bdry]
        inner += len(mine)
        kept = contacts.sample[contacts.facet == i]
        assert set(kept) <= set(mine)
        if len(mine):
            apart = np.linalg.norm(points[mine][:, None] - points[kept], axis=2)
            assert (apart <= t_rnn).any(axis=1).all()
            assert ((apart <= t_rnn).sum(axis=1) == 1)[np.isin(mine, kept)].all()
    assert [(stage.name, stage.taken, stage.kept) for stage in stages] == [
        ("sampling", len(points), distributed),
        ("refinement 1", distributed, inner),
        ("refinement 2", inner, len(contacts)),
    ]


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_contacts_know_where_they_are(random_part, seed):
    part = random_part(seed)
    facets, contacts, _ = planned(part, t_bdry=1e-3)
    points, faces = sample_surface(part, 3e-3)
    assert np.array_equal(contacts.points, points[contacts.sample])
    assert np.array_equal(contacts.face, faces[contacts.sample])
    assert np.array_equal(contacts.normals, part.mesh.face_normals[contacts.face])
    assert (np.diff(contacts.facet) >= 0).all()
    assert all(face in facets[facet] for face, facet in zip(contacts.face, contacts.facet, strict=True))
    assert np.linalg.norm(contacts.smooth_normals, axis=1) == pytest.approx(np.ones(len(contacts)))
    turn = np.einsum("ni,ni->n", contacts.smooth_normals, part.mesh.face_normals[facets.seed[contacts.facet]])
    assert (turn >= np.cos(np.radians(20.2))).all()


def test_smooth_normals_smooth_a_tessellation():
    """On a coarse sphere the normals of the contact regions are nearer to the true ones than those of the triangles."""
    part = Part.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.02), mass=0.1)
    _, contacts, _ = planned(part)
    true = contacts.points / np.linalg.norm(contacts.points, axis=1, keepdims=True)

    def error(normals):
        return np.degrees(np.arccos(np.clip(np.einsum("ni,ni->n", true, normals), -1, 1))).mean()

    assert error(contacts.smooth_normals) < 0.7 * error(contacts.normals)


def test_contacts_keep_off_rim_and_hole(plate_with_hole):
    _, contacts, _ = planned(plate_with_hole)
    flat = contacts.take(np.abs(contacts.normals[:, 2]) > 0.99)
    radius = np.linalg.norm(flat.points[:, :2], axis=1)
    assert len(flat) > 50
    assert radius.min() >= 0.012 - 1e-6
    assert radius.max() <= 0.028 + 1e-6


def test_boundary_distance_has_a_reach(block):
    facets = segment(block, 0.0, 0.0)
    top = int(np.argmax(facets.normal[:, 2]))
    points = np.array([[0.0, 0.0, 0.01], [0.015, 0.0, 0.01], [0.019, 0.014, 0.01]])
    found = boundary_distance(block, facets, points, np.full(3, top), 0.01)
    assert found == pytest.approx([np.inf, 0.005, 0.001])


def test_a_closed_facet_has_no_boundary():
    part = Part.from_mesh(trimesh.creation.icosphere(subdivisions=2, radius=0.02), mass=0.1)
    facets = segment(part, np.pi, np.pi)
    assert np.isinf(boundary_distance(part, facets, part.mesh.triangles_center, np.zeros(320, int), 0.05)).all()


@settings(max_examples=50, deadline=None)
@given(seed=seeds, n=st.integers(0, 200), groups=st.integers(1, 4), radius=st.floats(0.01, 0.5))
def test_thinning_is_the_greedy_one(seed, n, groups, radius):
    rng = np.random.default_rng(seed)
    points, group, priority = rng.random((n, 3)), rng.integers(groups, size=n), rng.random(n)
    greedy: list[int] = []
    for i in np.argsort(-priority).tolist():
        if all(group[i] != group[j] or np.linalg.norm(points[i] - points[j]) > radius for j in greedy):
            greedy.append(i)
    assert thin(points, group, priority, radius).tolist() == sorted(greedy)


@pytest.mark.parametrize("most", [1, 7, 50, 200, 500])
def test_at_most_so_many_contacts_are_left_and_spread(block, most):
    facets, contacts, _ = planned(block)
    left = at_most(contacts, most, 3e-3)
    assert min(most, len(contacts)) / 2 < len(left) <= most
    assert np.array_equal(left.points, contacts.points) == (len(contacts) <= most)
    if most < 50:
        return
    near = 2.0 * 3e-3 * max(np.sqrt(len(contacts) / most), 1.0)
    for i in range(len(facets)):
        there, here = contacts.points[contacts.facet == i], left.points[left.facet == i]
        assert cKDTree(here).query(there)[0].max() <= near


@pytest.mark.parametrize("name", NAMED)
@pytest.mark.parametrize(("knob", "values"), [("t_rnn", (6e-3, 3e-3, 2e-3)), ("t_bdry", (3e-3, 2e-3, 1e-3, 0.0))])
def test_smaller_distances_give_more_contacts(paper_part, name, knob, values):
    counts = [len(planned(paper_part(name), **{knob: value})[1]) for value in values]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]


def test_too_many_samples_are_refused_with_the_cure(block):
    facets = segment(block, 0.0, 0.0)
    large = Part.from_mesh(trimesh.creation.box([1.9, 1.9, 1.9]), mass=1.0)
    with pytest.raises(InputError, match=r"t_rnn: 3 mm asks for .*give 13\.\d mm or more"):
        sample_contacts(large, segment(large, 0.1, 0.1), GraspParameters())
    assert len(sample_contacts(block, facets, GraspParameters())[0]) > 0


def test_a_part_too_small_for_any_contact_has_none():
    part = Part.from_mesh(trimesh.creation.box([3.0, 3.0, 3.0]), unit="mm", mass=0.01)
    _, contacts, stages = planned(part)
    assert len(contacts) == 0
    assert stages[1].dropped == {"near the facet's boundary": stages[1].taken}
