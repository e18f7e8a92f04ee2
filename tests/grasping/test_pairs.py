"""Contact pairs: opposing points on the mesh, all of them, each once; theta_parl as an inclusion of sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kumitate.grasping.contacts import sample_contacts
from kumitate.grasping.facets import segment
from kumitate.grasping.pairs import find_pairs
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part

DEFAULTS = GraspParameters()


def pairs_of(part: Part, parameters: GraspParameters = DEFAULTS):
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    contacts, _ = sample_contacts(part, facets, parameters)
    return facets, contacts, find_pairs(part, facets, contacts, parameters)[0]


def names(pairs) -> set[bytes]:
    return {row.tobytes() for row in pairs.points}


def angle(a, b):
    return np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0))


def point_on_mesh(mesh, point) -> bool:
    """Whether a triangle holds the point, by heights over planes and areas."""
    a, b, c = np.swapaxes(mesh.triangles.view(np.ndarray), 0, 1)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=-1)
    sides = [np.sum(np.cross(v - u, point - u) * normal, axis=-1) for u, v in ((a, b), (b, c), (c, a))]
    on_plane = np.abs(np.sum((point - a) * normal, axis=-1)) < 1e-7 * area
    return bool(np.any(on_plane & (np.min(sides, axis=0) > -1e-9 * area)))


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_laws_on_random_parts(random_part, seed):
    part = random_part(seed)
    facets, contacts, pairs = pairs_of(part)
    assert len(pairs) <= 4 * len(contacts)
    if not len(pairs):
        return
    least = DEFAULTS.theta_parl - np.radians(0.11)
    assert angle(facets.normal[pairs.facets[:, 0]], facets.normal[pairs.facets[:, 1]]).min() >= least
    assert angle(pairs.normals[:, 0], pairs.normals[:, 1]).min() >= least
    assert angle(pairs.normals[:, 0], pairs.axis).min() >= least
    assert angle(pairs.normals[:, 1], -pairs.axis).min() >= least
    inside = [point_on_mesh(part.mesh, point) for point in pairs.points.reshape(-1, 3)]
    assert all(inside)
    first = {row.tobytes() for row in contacts.points}
    assert all(row.tobytes() in first for row in pairs.points[:, 0])
    # No two pairs lie within t_rnn of each other at both ends, either way round.
    for turn in (slice(None), slice(None, None, -1)):
        gaps = np.linalg.norm(pairs.points[:, None] - pairs.points[None, :, turn], axis=-1).max(axis=-1)
        np.fill_diagonal(gaps, np.inf)
        assert gaps.min() > DEFAULTS.t_rnn


def test_every_crossing_counts_in_a_hollow_part():
    """A square tube of 40 mm with walls of 3 mm: each wall, and both together, which the first crossing would miss."""
    mesh = trimesh.creation.annulus(r_min=0.017 * 2**0.5, r_max=0.020 * 2**0.5, height=0.08, sections=4)
    part = Part.from_mesh(mesh, mass=0.1)
    width = pairs_of(part)[2].width
    assert np.isclose(width, 0.003, atol=1e-6).sum() > 50
    assert np.isclose(width, 0.040, atol=1e-6).sum() > 50
    assert np.isclose(width, 0.034, atol=1e-6).sum() == 0  # the inner walls face each other across nothing


def test_pairs_match_a_brute_force_over_all_triangles(plate_with_hole):
    """Before merging, on few contacts: each crossing by solving for it in every triangle."""
    parameters = replace(DEFAULTS, t_rnn=8e-3)
    facets, contacts, pairs = pairs_of(plate_with_hole, parameters)
    triangles, normals = plate_with_hole.mesh.triangles, plate_with_hole.mesh.face_normals
    found = []
    for i in range(len(contacts)):
        down = -contacts.smooth_normals[i]
        for t, (a, b, c) in enumerate(triangles):
            system = np.column_stack([b - a, c - a, -down])
            if abs(np.linalg.det(system)) < 1e-15:
                continue
            u, v, along = np.linalg.solve(system, contacts.points[i] - a)
            if min(u, v, 1 - u - v) < -1e-9 or along < 1e-5:
                continue
            worst = min(
                angle(contacts.normals[i], normals[t]), angle(contacts.normals[i], down), angle(normals[t], -down)
            )
            owners = facets.owner[facets.faces == t]
            facet = max(angle(facets.normal[contacts.facet[i]], facets.normal[owner]) for owner in owners)
            if min(worst, facet) >= parameters.theta_parl:
                found.append(np.stack([contacts.points[i], contacts.points[i] + along * down]))
    found = np.array(found)
    ends = np.stack([found, found[:, ::-1]])  # either way round
    for pair in pairs.points:
        assert np.linalg.norm(ends - pair, axis=-1).max(axis=-1).min() < 1e-8
    for pair in found:
        both = np.stack([pairs.points, pairs.points[:, ::-1]])
        assert np.linalg.norm(both - pair, axis=-1).max(axis=-1).min() <= parameters.t_rnn


@pytest.mark.parametrize("name", ["bunnysim", "ttube", "made"])
def test_pairs_at_160_degrees_are_among_those_at_140(request, name):
    if name == "made":
        part = Part.from_mesh(
            trimesh.creation.icosphere(subdivisions=3, radius=0.03).apply_scale([1.0, 0.8, 0.6]), mass=0.1
        )
    else:
        part = request.getfixturevalue("paper_part")(name)
    facets = segment(part, DEFAULTS.theta_pln, DEFAULTS.theta_fct)
    contacts, _ = sample_contacts(part, facets, DEFAULTS)
    strict, loose = (
        find_pairs(part, facets, contacts, replace(DEFAULTS, theta_parl=np.radians(theta)))[0] for theta in (160, 140)
    )
    assert names(strict) < names(loose)
    assert len(strict) > 20


def test_smaller_t_rnn_gives_more_pairs(block):
    wide, dense = (len(pairs_of(block, replace(DEFAULTS, t_rnn=t))[2]) for t in (5e-3, 2.5e-3))
    assert dense > 2 * wide
