"""Soft-finger contact against direct integration of the paper's equations 2 and 3, and the laws of equation 4."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from kumitate.grasping.softfinger import GRAVITY, curvature_radius, eccentricity, stability_margin

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


def test_radius_is_that_of_the_sharpest_turn_beyond_noise():
    distance = np.array([0.0, 0.010, 0.010, 0.0, 0.001])
    angle = np.array([0.0, 0.1, 0.2, 0.0, np.radians(0.4)])
    assert curvature_radius(distance, angle, np.array([0, 3, 5])) == pytest.approx([0.05, np.inf])
