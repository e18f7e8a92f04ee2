"""Soft-finger contact against direct integration of the paper's equations 2 and 3, and the laws of equation 4."""

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from kumitate.grasping.facets import Facets, segment
from kumitate.grasping.part import Part
from kumitate.grasping.softfinger import GRAVITY, curvature_radius, eccentricity, stability_margin

LIMIT = np.radians(20.0)
lengths = st.floats(1e-4, 0.05)


def integrated(radius: float, depth: float, reach: float) -> float:
    """e_n of eq. 2 with the penetration of eq. 3, integrated over the disc of radius ``reach``."""

    def penetration(r):
        return np.sqrt(radius**2 - r**2) - (radius - depth)

    torque = quad(lambda r: r * penetration(r) * r, 0.0, reach)[0]
    force = quad(lambda r: penetration(r) * r, 0.0, reach)[0]
    return torque / force


@given(radius=st.floats(1e-3, 0.2), share=st.floats(0.01, 0.2), covered=st.floats(0.05, 1.0))
def test_agrees_with_integration(radius, share, covered):
    depth = share * radius
    contact = np.sqrt(2 * radius * depth - depth**2)
    reach = covered * contact
    assert float(eccentricity(radius, depth, reach)) == pytest.approx(integrated(radius, depth, reach), rel=0.02)


def test_the_papers_form_where_the_pad_covers_the_contact():
    radius, depth = 0.02, 0.0015
    contact = np.sqrt(2 * radius * depth - depth**2)
    assert float(eccentricity(radius, depth, 0.1)) == pytest.approx(8 / 15 * contact, rel=1e-12)


def test_two_thirds_of_the_pad_where_flat():
    assert float(eccentricity(np.inf, 0.0015, 0.011)) == pytest.approx(2 / 3 * 0.011, rel=1e-12)


@given(radius=lengths, depth=st.floats(1e-5, 5e-3), pad=lengths, more=st.floats(1.01, 3.0))
def test_increases_in_depth_radius_and_pad(radius, depth, pad, more):
    base = float(eccentricity(radius, depth, pad))
    for grown in ((radius * more, depth, pad), (radius, depth * more, pad), (radius, depth, pad * more)):
        assert float(eccentricity(*grown)) >= base * (1 - 1e-12)
    assert float(eccentricity(radius * more, depth * more, pad * more)) > base
    assert float(eccentricity(np.inf, depth, pad)) >= base


def test_works_on_sets_and_without_penetration():
    values = eccentricity(np.array([0.01, np.inf]), 0.001, 0.01)
    assert values.shape == (2,)
    assert values[0] < values[1]
    assert np.array_equal(eccentricity(np.array([0.01, np.inf]), 0.0, 0.01), [0.0, 0.0])


@given(
    lever=st.floats(0.0, 0.3),
    e_n=st.floats(1e-4, 0.02),
    mass=st.floats(0.01, 3),
    mu=st.floats(0.1, 1),
    force=st.floats(1, 200),
)
def test_margin_is_the_papers_inequality(lever, e_n, mass, mu, force):
    weight = mass * GRAVITY
    left, right = (weight * lever) ** 2, e_n**2 * ((mu * force) ** 2 - weight**2)
    assume(abs(left - right) > 1e-9 * max(left, abs(right)))
    margin = stability_margin(np.array([lever]), np.array([e_n]), mass, mu, force)
    assert (margin >= 0).tolist() == [left <= right]


def test_margin_falls_from_one_with_the_lever():
    margin = stability_margin(np.array([0.0, 0.01, 0.02]), 0.005, 0.1, 0.5, 40.0)
    assert margin[0] == 1.0
    assert margin[0] > margin[1] > margin[2]


def test_no_margin_where_friction_cannot_carry_the_weight():
    assert stability_margin(np.zeros(1), 0.005, 10.0, 0.5, 40.0)[0] == -np.inf
    assert stability_margin(np.zeros(1), 0.0, 0.1, 0.5, 40.0)[0] == -np.inf


def radii(mesh: trimesh.Trimesh) -> tuple[Facets, np.ndarray]:
    facets = segment(Part.from_mesh(mesh, mass=0.1), LIMIT, LIMIT)
    return facets, facets.radius[np.isfinite(facets.radius)]


@pytest.mark.parametrize("longest", [1.0, 0.02, 0.006])
@pytest.mark.parametrize("sections", [20, 33, 64, 150])
def test_a_cylinder_has_its_radius_however_it_is_cut(sections, longest):
    mesh = trimesh.creation.cylinder(radius=0.02, height=0.05, sections=sections).subdivide_to_size(longest)
    facets, curved = radii(mesh)
    assert len(curved) == len(facets) - 2
    assert curved == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(
    "mesh",
    [
        *(trimesh.creation.icosphere(subdivisions=n, radius=0.025) for n in (2, 3, 4)),
        trimesh.creation.uv_sphere(radius=0.025, count=[32, 48]),
    ],
)
def test_a_sphere_has_its_radius(mesh):
    facets, curved = radii(mesh)
    assert len(curved) == len(facets)
    assert curved == pytest.approx(0.025, rel=0.05)


def test_a_torus_has_that_of_its_tube_or_twice_that_on_a_ring():
    _, curved = radii(trimesh.creation.torus(0.03, 0.01, 64, 32))
    assert np.all((curved > 0.0095) & (curved < 0.02))
    assert np.median(curved) == pytest.approx(0.01, rel=0.06)


def test_bumps_and_hollows_do_not_cancel():
    """A plate with waves of 8 mm radius, whose slopes stay below 20 deg."""
    mesh = trimesh.creation.box([0.064, 0.01, 0.02]).subdivide_to_size(0.0015)
    top = mesh.vertices[:, 2] > 0.0099
    k = 2.0 * np.pi / 0.016
    mesh.vertices[top, 2] += np.cos(k * mesh.vertices[top, 0]) / (0.008 * k**2)
    facets, _ = radii(mesh)
    wavy = np.argmax(np.where(facets.normal[:, 2] > 0.9, np.diff(facets.offsets), 0))
    assert 0.008 < facets.radius[wavy] < 0.016


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_radius_does_not_depend_on_how_the_surface_is_cut(random_part, seed):
    mesh = random_part(seed).mesh
    facets = segment(random_part(seed), LIMIT, LIMIT)
    vertices, faces, children = trimesh.remesh.subdivide(mesh.vertices, mesh.faces, return_index=True)
    finer = trimesh.Trimesh(vertices, faces, process=False)
    cut = np.array([children[face] for face in range(len(mesh.faces))])
    again = curvature_radius(finer, cut[facets.faces].ravel(), 4 * facets.offsets, cut[facets.seed, 0], LIMIT)
    # As curvatures: of a radius of metres, which is flat to any pad, rounding leaves fewer digits.
    assert 1.0 / again == pytest.approx(1.0 / facets.radius, rel=1e-6, abs=1e-5)
