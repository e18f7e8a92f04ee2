"""Suction grasps: seal, edge, torque and peel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.errors import InputError
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.grasping.suction import plan_suction
from kumitate.robots.library import load_hand

DEFAULTS = GraspParameters()
LEFT_OUT = "near another contact, of more than can be looked at"


@pytest.fixture(scope="module")
def cup():
    return load_hand("suction_cup")


def with_lip(cup, **changes):
    return replace(cup, lip=replace(cup.lip, **changes))


def rows(grasps):
    return {stage.name: stage for stage in grasps.record}


def leaks_by_rays(part, cup, grasps) -> np.ndarray:
    """Largest distance (n,) [m] between lip and surface, by 180 rays around each lip against the mesh."""
    angle = np.linspace(0.0, 2.0 * np.pi, 180, endpoint=False)
    ring = cup.lip.radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    worst = np.full(len(grasps), np.inf)
    for i, pose in enumerate(grasps.part_from_hand):
        down = pose[:3, 2]
        start = trimesh.transform_points(ring, pose) - 0.005 * down
        hits, ray, _ = part.mesh.ray.intersects_location(start, np.tile(down, (len(ring), 1)), multiple_hits=False)
        if len(np.unique(ray)) == len(ring):
            worst[i] = np.max((hits - start[ray]) @ down) - 0.005
    return worst


def test_the_lip_lies_on_the_surface_all_around(cup, paper_part):
    part = paper_part("sandpart")
    grasps = plan_grasps(part, cup)
    assert len(grasps) >= 20
    worst = leaks_by_rays(part, cup, grasps.thin(60))
    assert np.all(worst <= cup.lip.compliance + 1e-6)
    assert np.all(worst >= -1e-6)


def test_a_lip_larger_than_every_facet_cannot_seal_and_the_record_says_so(cup, paper_part):
    grasps = plan_grasps(paper_part("sandpart"), with_lip(cup, radius=0.03))
    assert len(grasps) == 0
    seal = rows(grasps)["seal"]
    assert seal.taken > 0
    assert seal.kept == 0


def test_a_curved_surface_leaks_when_the_cup_is_too_stiff(cup):
    """On a cylinder of radius R the lip's sides hang r^2 / 2R below its top: 0.8 mm for R = 40 mm, r = 8 mm."""
    part = Part.from_mesh(trimesh.creation.cylinder(radius=0.04, height=0.1, sections=96), mass=0.05)
    stiff, soft = (plan_grasps(part, with_lip(cup, compliance=c)) for c in (0.7e-3, 1.0e-3))
    assert not (np.abs(stiff.part_from_hand[:, 2, 2]) < 0.5).any()
    assert (np.abs(soft.part_from_hand[:, 2, 2]) < 0.5).sum() > 100
    assert rows(stiff)["seal"].dropped["the lip leaks"] > rows(soft)["seal"].dropped["the lip leaks"]


def test_contacts_nearer_the_edge_than_the_lip_go(cup, block):
    """On the 40 x 30 x 20 mm block the centre of a lip of 8 mm stays 8 mm from every edge."""
    grasps = plan_grasps(block, cup)
    assert len(grasps) > 0
    inside = np.array([0.02, 0.015, 0.01]) - np.abs(grasps.contacts[:, 0])
    across = np.sort(inside, axis=1)[:, 1:]  # the smallest is zero: the face itself
    assert across.min() >= cup.lip.radius - 1e-9
    assert np.allclose(grasps.part_from_hand[:, :3, 2], -grasps.normals[:, 0])


def test_a_hole_under_the_lip_is_an_edge(cup, plate_with_hole):
    grasps = plan_grasps(plate_with_hole, with_lip(cup, radius=0.004))
    flat = np.abs(grasps.normals[:, 0, 2]) > 0.9
    radius = np.linalg.norm(grasps.contacts[flat, 0, :2], axis=-1)
    assert flat.any()
    assert radius.min() > 0.0139
    assert radius.max() < 0.0261


def test_peel_and_torque_hold_for_every_grasp_and_fail_with_mass(cup):
    mesh = trimesh.creation.box([0.12, 0.03, 0.02])
    light, heavy = (plan_grasps(Part.from_mesh(mesh, mass=m), cup) for m in (0.05, 0.15))
    for grasps, mass in ((light, 0.05), (heavy, 0.15)):
        force = cup.lip.force - mass * 9.80665
        assert np.allclose(grasps.force, force)
        lever = np.linalg.norm(grasps.contacts[:, 0], axis=-1)
        assert np.all(mass * 9.80665 * lever <= force * cup.lip.radius + 1e-12)
    assert rows(heavy)["stability"].dropped["turns under gravity"] > 0
    assert 0 < len(heavy) < len(light)
    rough = plan_grasps(Part.from_mesh(mesh, mass=0.3), replace(cup, friction=5.0))
    assert rows(rough)["peel"].dropped["peels off"] > 0
    assert len(rough) == rows(rough)["peel"].kept > 0
    assert len(plan_grasps(Part.from_mesh(mesh, mass=1.3), cup)) == 0


def test_the_whole_cup_is_checked(cup):
    """In a well as wide as the lip the seal is good, but the cup's body has no room."""
    floor = trimesh.creation.box([0.06, 0.06, 0.004])
    wall = trimesh.creation.annulus(r_min=0.0095, r_max=0.02, height=0.03, sections=64).apply_translation(
        [0, 0, 0.0172]
    )
    part = Part.from_mesh(trimesh.util.concatenate([floor, wall]), mass=0.05)
    grasps = plan_grasps(part, cup)
    in_the_well = (np.linalg.norm(grasps.contacts[:, 0, :2], axis=-1) < 0.0095) & (grasps.normals[:, 0, 2] > 0.9)
    assert not (in_the_well & (grasps.contacts[:, 0, 2] < 0.01)).any()
    assert rows(grasps)["hand collision"].dropped["hand touches the part"] > 0


def test_more_rolls_give_more_grasps(cup, block):
    eight, sixteen = (plan_grasps(block, cup, replace(DEFAULTS, n_da=n)) for n in (8, 16))
    assert len(sixteen) == 2 * len(eight)


def test_of_a_large_part_no_more_is_looked_at_than_it_says(cup, monkeypatch):
    monkeypatch.setattr("kumitate.grasping.suction._MOST", 4000)
    part = Part.from_mesh(trimesh.creation.box([0.1, 0.1, 0.02]), mass=0.01)
    grasps = plan_grasps(part, cup)
    seal, collision = rows(grasps)["seal"], rows(grasps)["hand collision"]
    looked_at = seal.taken - seal.dropped[LEFT_OUT]
    assert seal.taken > 2000
    assert 250 < looked_at <= 500
    assert 0 < collision.taken <= 4000
    for side in (-0.01, 0.01):  # both large faces have their share, all over
        x = grasps.contacts[np.isclose(grasps.contacts[:, 0, 2], side), 0, 0]
        assert len(x) > 0.4 * len(grasps)
        assert np.diff(np.sort([-0.042, *x, 0.042])).max() < 0.01


def test_of_a_part_of_usual_size_everything_is_looked_at(cup, block):
    assert rows(plan_grasps(block, cup))["seal"].dropped[LEFT_OUT] == 0


def test_a_hand_without_a_lip_is_refused(block):
    with pytest.raises(InputError, match="no lip"):
        plan_suction(block, None, None, load_hand("robotiq_2f85"), DEFAULTS)
