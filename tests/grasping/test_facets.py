"""The laws of superimposed segmentation, on random meshes and on the paper's objects."""

from itertools import combinations

import networkx as nx
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kumitate.errors import InputError
from kumitate.grasping.facets import segment
from kumitate.grasping.part import Part

DEG = np.pi / 180
seeds = st.integers(0, 2**32 - 1)
angles = st.sampled_from([0.0, 5 * DEG, 10 * DEG, 20 * DEG, 45 * DEG])
NAMED = ["housing", "planewheel", "ttube", "bunnysim", "planelowerbody"]


def edge_graph(faces: np.ndarray) -> nx.Graph:
    """Triangles joined where they share an edge, however many share it."""
    graph = nx.Graph()
    graph.add_nodes_from(range(len(faces)))
    by_edge: dict[frozenset, list[int]] = {}
    for i, face in enumerate(faces.tolist()):
        for a, b in combinations(face, 2):
            by_edge.setdefault(frozenset((a, b)), []).append(i)
    for sharing in by_edge.values():
        graph.add_edges_from(combinations(sharing, 2))
    return graph


def corners(part: Part, facet: np.ndarray) -> frozenset:
    """A facet as a set of triangles of coordinates, whatever their order."""
    return frozenset(frozenset(map(tuple, triangle)) for triangle in part.mesh.triangles[facet].tolist())


@settings(max_examples=40, deadline=None)
@given(seed=seeds, theta_pln=angles, theta_fct=angles)
def test_laws(random_part, seed, theta_pln, theta_fct):
    part = random_part(seed)
    facets = segment(part, theta_pln, theta_fct)
    normals, graph = part.mesh.face_normals, edge_graph(part.mesh.faces)
    sets = [set(facets[i].tolist()) for i in range(len(facets))]
    assert set().union(*sets) == set(range(len(part.mesh.faces)))
    assert len({frozenset(members) for members in sets}) == len(sets)
    for i, members in enumerate(sets):
        angle = np.degrees(np.arccos(np.clip(normals @ normals[facets.seed[i]], -1, 1)))
        assert angle[list(members)].max() <= np.degrees(theta_pln) + 0.1 + 1e-6
        near = graph.subgraph(np.flatnonzero(angle <= np.degrees(theta_pln) + 0.1).tolist())
        assert members == nx.node_connected_component(near, int(facets.seed[i]))


@settings(max_examples=30, deadline=None)
@given(seed=seeds, theta_pln=angles, theta_fct=angles)
def test_a_triangle_is_served_or_was_tried(random_part, seed, theta_pln, theta_fct):
    """A triangle far from the seeds of all its facets would have grown a facet that exists already."""
    part = random_part(seed)
    facets = segment(part, theta_pln, theta_fct)
    normals, graph = part.mesh.face_normals, edge_graph(part.mesh.faces)
    cosine = np.einsum("ni,ni->n", normals[facets.faces], normals[facets.seed[facets.owner]])
    nearest = np.full(len(normals), -1.0)
    np.maximum.at(nearest, facets.faces, cosine)
    existing = {frozenset(facets[i].tolist()) for i in range(len(facets))}
    for triangle in np.flatnonzero(nearest < np.cos(theta_fct + 0.1 * DEG)).tolist():
        near = np.flatnonzero(normals @ normals[triangle] >= np.cos(theta_pln + 0.1 * DEG)).tolist()
        assert frozenset(nx.node_connected_component(graph.subgraph(near), triangle)) in existing


@settings(max_examples=20, deadline=None)
@given(seed=seeds)
def test_shuffling_changes_nothing(random_part, seed):
    part = random_part(seed)
    rng = np.random.default_rng(seed)
    faces = np.asarray(part.mesh.faces)[rng.permutation(len(part.mesh.faces))]
    turns = (np.arange(3) + rng.integers(3, size=(len(faces), 1))) % 3
    order = rng.permutation(len(part.mesh.vertices))
    vertices, renamed = part.mesh.vertices[order], np.argsort(order)
    mesh = trimesh.Trimesh(vertices, renamed[np.take_along_axis(faces, turns, axis=1)], process=False)
    shuffled = Part.from_mesh(mesh, mass=0.1)
    a, b = segment(part, 20 * DEG, 10 * DEG), segment(shuffled, 20 * DEG, 10 * DEG)
    assert {corners(part, a[i]) for i in range(len(a))} == {corners(shuffled, b[i]) for i in range(len(b))}
    assert part.digest == shuffled.digest


@pytest.mark.parametrize("refinements", [0, 2])
def test_zero_planarity_gives_the_coplanar_patches(refinements):
    box = trimesh.creation.box([0.04, 0.03, 0.02])
    for _ in range(refinements):
        box = box.subdivide()
    part = Part.from_mesh(box, mass=0.1)
    facets = segment(part, 0.0, 20 * DEG)
    assert len(facets) == 6
    for i in range(6):
        assert len(facets[i]) == 2 * 4**refinements
        assert np.ptp(part.mesh.triangles[facets[i]].reshape(-1, 3) @ facets.normal[i]) < 1e-9


def test_patches_that_do_not_touch_are_two_facets():
    rise = trimesh.creation.box([0.02, 0.02, 0.02])
    apart = trimesh.util.concatenate([rise, rise.copy().apply_translation([0.03, 0.0, 0.0])])
    facets = segment(Part.from_mesh(apart, mass=0.1), 20 * DEG, 20 * DEG)
    assert len(facets) == 12
    assert sum(np.allclose(normal, [0, 0, 1]) for normal in facets.normal) == 2


def test_an_edge_of_more_than_two_triangles_joins_them_all():
    """Two blocks that touch along one edge: their coplanar tops are one facet across it."""
    block = trimesh.creation.box([0.02, 0.02, 0.02])
    diagonal = trimesh.util.concatenate([block, block.copy().apply_translation([0.02, 0.0, 0.02])])
    part = Part.from_mesh(diagonal, mass=0.1)
    facets = segment(part, 100 * DEG, 20 * DEG)
    both = [i for i in range(len(facets)) if np.ptp(part.mesh.triangles[facets[i]][..., 0]) > 0.021]
    assert both
    assert set().union(*(facets[i].tolist() for i in range(len(facets)))) == set(range(24))


def test_whole_surface_is_one_facet_without_a_limit(block):
    facets = segment(block, np.pi, np.pi)
    assert len(facets) == 1
    assert len(facets[0]) == 12


@pytest.mark.parametrize("sections", [24, 36, 60])
@pytest.mark.parametrize("radius", [0.008, 0.02])
def test_a_cylinder_has_its_radius(sections, radius):
    part = Part.from_mesh(trimesh.creation.cylinder(radius=radius, height=0.05, sections=sections), mass=0.1)
    facets = segment(part, 20 * DEG, 20 * DEG)
    side = np.abs(facets.normal[:, 2]) < 0.5
    assert side.sum() >= 6
    assert facets.radius[side] == pytest.approx(radius, rel=0.1)
    assert np.isinf(facets.radius[~side]).all()


def test_normals_are_the_area_weighted_mean(random_part):
    part = random_part(1)
    facets = segment(part, 45 * DEG, 20 * DEG)
    for i in range(len(facets)):
        mean = part.mesh.area_faces[facets[i]] @ part.mesh.face_normals[facets[i]]
        assert facets.normal[i] == pytest.approx(mean / np.linalg.norm(mean), abs=1e-12)


@pytest.mark.parametrize("name", NAMED)
def test_smaller_theta_pln_gives_smaller_facets(paper_part, name):
    part = paper_part(name)
    sizes = []
    for theta in (40, 20, 10, 5):
        facets = segment(part, theta * DEG, 20 * DEG)
        sizes.append(part.mesh.area_faces[facets.faces].sum() / len(facets))
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] > sizes[-1]


@pytest.mark.parametrize("name", NAMED)
def test_smaller_theta_fct_gives_more_overlap(paper_part, name):
    part = paper_part(name)
    overlap = [len(segment(part, 20 * DEG, theta * DEG).faces) / len(part.mesh.faces) for theta in (20, 10, 5)]
    assert 1.0 < overlap[0] < overlap[1] < overlap[2]


def test_overlap_without_bound_is_refused(monkeypatch):
    monkeypatch.setattr("kumitate.grasping.facets._MOST_ENTRIES", 200_000)
    part = Part.from_mesh(trimesh.creation.icosphere(subdivisions=3, radius=0.03), mass=0.1)
    with pytest.raises(InputError, match=r"theta_fct.*larger theta_fct"):
        segment(part, 120 * DEG, 0.0)
