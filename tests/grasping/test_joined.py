"""Assemblies: mass and centre of mass by hand, and eq. 4 of the whole from the eccentricity of its contacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.grasping.facets import segment
from kumitate.grasping.joined import hold_whole, join_parts
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.grasping.softfinger import GRAVITY, eccentricity
from kumitate.robots.library import load_hand
from kumitate.transforms import pose, transform_points

BESIDE = pose([0.05, 0.0, 0.02], [0.3, 0.0, 0.0])


@pytest.fixture(scope="module")
def hand():
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="module")
def block():
    return Part.from_mesh(trimesh.creation.box([0.03, 0.04, 0.10]), mass=0.4, name="block")


@pytest.fixture(scope="module")
def rod():
    return Part.from_mesh(trimesh.creation.cylinder(0.012, 0.12, sections=48), mass=0.3, name="rod")


@pytest.fixture(scope="module")
def weight():
    return Part.from_mesh(trimesh.creation.box([0.02] * 3), mass=0.3, name="weight")


@pytest.fixture(scope="module", params=["block", "rod"])
def held(request, hand):
    """A flat or a curved part, with its grasps."""
    part = request.getfixturevalue(request.param)
    return part, plan_grasps(part, hand)


def margins(grasps, part, whole, hand):
    """Eq. 4 from the start: e_n of the weaker contact, and the lever from the whole's centre of mass."""
    parameters = GraspParameters()
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    e_n = eccentricity(facets.radius[grasps.facets], parameters.h_max, hand.pads[0].radius).min(axis=1)
    weight = whole.mass * GRAVITY
    lever = np.linalg.norm(grasps.contacts.mean(axis=1) - whole.center_of_mass, axis=1)
    return 1.0 - weight * lever / (e_n * np.sqrt((hand.friction * hand.grip_force) ** 2 - weight**2))


def test_mass_and_centre_of_mass_of_a_whole(block, rod):
    whole = join_parts([block, rod], [np.eye(4), BESIDE])
    assert whole.name == "block"
    assert whole.mass == pytest.approx(0.7)
    rod_center = transform_points(BESIDE, rod.center_of_mass[None])[0]
    np.testing.assert_allclose(whole.center_of_mass, (0.4 * block.center_of_mass + 0.3 * rod_center) / 0.7)
    assert whole.mesh.area == pytest.approx(block.mesh.area + rod.mesh.area)
    np.testing.assert_allclose(
        whole.mesh.bounds[1], np.maximum(block.mesh.bounds[1], transform_points(BESIDE, rod.mesh.vertices).max(axis=0))
    )


def test_a_whole_of_three_weighs_as_a_whole_of_two_and_the_third(block, rod):
    other = np.linalg.inv(BESIDE)
    at_once = join_parts([block, rod, rod], [np.eye(4), BESIDE, other])
    one_by_one = join_parts([join_parts([block, rod], [np.eye(4), BESIDE]), rod], [np.eye(4), other])
    assert at_once.mass == pytest.approx(one_by_one.mass)
    np.testing.assert_allclose(at_once.center_of_mass, one_by_one.center_of_mass, atol=1e-15)


def test_a_part_alone_is_itself(held, hand):
    part, grasps = held
    assert join_parts([part], [np.eye(4)]) is part
    assert hold_whole(grasps, part, part, hand) is grasps


@pytest.mark.parametrize("mass", [0.0001, 0.1, 0.3])
def test_the_grasps_that_hold_a_whole_are_those_of_eq_4(held, weight, hand, mass):
    part, grasps = held
    whole = join_parts([part, replace(weight, mass=mass)], [np.eye(4), BESIDE])
    kept = hold_whole(grasps, part, whole, hand)
    wanted = margins(grasps, part, whole, hand)
    assert 0 < len(kept) <= len(grasps)
    np.testing.assert_allclose(kept.margin, wanted[wanted >= 0.0], atol=1e-9)
    np.testing.assert_allclose(kept.part_from_hand, grasps.part_from_hand[wanted >= 0.0])


def test_a_part_that_brings_the_centre_of_mass_nearer_helps(block, weight, hand):
    grasps = plan_grasps(block, hand)
    low = grasps[grasps.contacts[:, :, 2].mean(axis=1) < -0.03]
    whole = join_parts([block, weight], [np.eye(4), pose([0.0, 0.0, -0.08])])
    kept = hold_whole(low, block, whole, hand)
    assert len(kept) == len(low) > 0
    assert (kept.margin > low.margin).any()


def test_nothing_holds_what_friction_cannot_carry(held, weight, hand):
    part, grasps = held
    too_heavy = hand.friction * hand.grip_force / GRAVITY
    whole = join_parts([part, replace(weight, mass=too_heavy)], [np.eye(4), BESIDE])
    assert len(hold_whole(grasps, part, whole, hand)) == 0


def test_the_quality_falls_with_the_margin(held, weight, hand):
    part, grasps = held
    whole = join_parts([part, weight], [np.eye(4), BESIDE])
    kept = hold_whole(grasps, part, whole, hand)
    before = grasps.quality[margins(grasps, part, whole, hand) >= 0.0]
    assert (kept.quality <= before + 1e-12).all()
    assert (kept.quality >= 0.0).all()


def test_a_cup_holds_a_whole_with_what_the_vacuum_leaves_of_its_force(weight):
    cup = load_hand("suction_cup")
    plate = Part.from_mesh(trimesh.creation.box([0.08, 0.08, 0.01]), mass=0.02, name="plate")
    grasps = plan_grasps(plate, cup)
    whole = join_parts([plate, replace(weight, mass=0.1)], [np.eye(4), pose([0.0, 0.0, -0.02])])
    kept = hold_whole(grasps, plate, whole, cup)
    force = cup.lip.force - whole.mass * GRAVITY
    lever = np.linalg.norm(kept.contacts[:, 0] - whole.center_of_mass, axis=1)
    e_n = eccentricity(np.inf, GraspParameters().h_max, cup.lip.radius)
    assert force > 0.0 or len(kept) == 0
    torque = e_n * np.sqrt(max((cup.friction * force) ** 2 - (whole.mass * GRAVITY) ** 2, 0.0))
    assert (whole.mass * GRAVITY * lever <= torque).all()
    assert (whole.mass * GRAVITY * lever <= force * cup.lip.radius).all()  # nor does it peel off
