"""One finger against two: what t_dct does, stated as sets; both assignments; faces that turn while closing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand

DEFAULTS = GraspParameters()


@pytest.fixture(scope="module")
def gripper():
    return load_hand("hrp5p_three_finger")


@pytest.fixture(scope="module")
def bar() -> Part:
    """A bar of 110 mm along y, 40 mm wide: it fills a pair of fingers 60 mm apart."""
    return Part.from_mesh(trimesh.creation.box([0.04, 0.11, 0.05]), mass=0.1)


def rows(grasps):
    return {stage.name: stage for stage in grasps.record}


def names(grasps) -> set[tuple[float, ...]]:
    return set(map(tuple, np.round(grasps.part_from_hand[:, :3].reshape(len(grasps), -1), 7)))


def lateral(grasps, along) -> np.ndarray:
    """Grasps whose pair of fingers does not lie along the part's axis."""
    return np.abs(grasps.part_from_hand[:, :3, 1] @ along) < np.cos(np.radians(10.0))


def gaps_by_rays(part, hand, grasps, pad) -> np.ndarray:
    """How far a pad's face hangs above the part (n,) [m] along the closing axis, by rays from a grid on it."""
    y, z = np.meshgrid(*[np.linspace(-0.4999, 0.4999, 60) * side for side in hand.pads[pad].size])
    grid = np.stack([np.zeros_like(y), y, z], axis=-1).reshape(-1, 3)
    poses = grasps.part_from_hand @ hand.hand_from_pad(grasps.opening)[:, pad]
    inward = (1.0 if pad == 0 else -1.0) * grasps.part_from_hand[:, :3, 0]
    gaps = np.full(len(grasps), np.inf)
    for i, pose in enumerate(poses):
        start = trimesh.transform_points(grid, pose) - 0.01 * inward[i]
        rays = np.tile(inward[i], (len(start), 1))
        hits, ray, _ = part.mesh.ray.intersects_location(start, rays, multiple_hits=False)
        gaps[i] = np.min((hits - start[ray]) @ inward[i], initial=np.inf) - 0.01
    return gaps


@pytest.mark.parametrize("name", ["bar", "ttube"])
def test_every_pad_stands_on_the_surface_or_within_t_dct(gripper, request, name):
    part = request.getfixturevalue("bar") if name == "bar" else request.getfixturevalue("paper_part")(name)
    grasps = plan_grasps(part, gripper).thin(40)
    assert len(grasps) > 10
    single = gaps_by_rays(part, gripper, grasps, 0)
    pair = np.sort([gaps_by_rays(part, gripper, grasps, pad) for pad in (1, 2)], axis=0)
    grid = 1e-3  # a grid may miss the very first touch on a curved surface
    turned = -2e-4  # what the faces turn between the last two openings tried
    assert np.all((single > turned) & (single < grid))
    assert np.all((pair[0] > turned) & (pair[0] < grid))
    assert np.all(pair[1] < DEFAULTS.t_dct + grid)


def test_grasps_at_t_dct_0_are_axial_and_among_those_at_3_mm(gripper, paper_part):
    """The paper's tube connector (V.A, parameter 7)."""
    tube = paper_part("ttube")
    none, three = (plan_grasps(tube, gripper, replace(DEFAULTS, t_dct=t)) for t in (0.0, 3e-3))
    assert names(none) < names(three)
    assert len(none) > 5
    assert len(three) > 50
    assert not lateral(none, [0.0, 1.0, 0.0]).any()
    assert lateral(three, [0.0, 1.0, 0.0]).any()


def test_a_wedge_takes_a_finger_off_the_surface_by_what_t_dct_allows(gripper):
    """A bar whose one side falls away by 2 mm towards one end: the far finger of the pair hangs above it."""
    mesh = trimesh.creation.box([0.04, 0.11, 0.05])
    mesh.vertices[(mesh.vertices[:, 0] > 0) & (mesh.vertices[:, 1] > 0), 0] -= 0.002
    part = Part.from_mesh(mesh, mass=0.1)
    none, three = (plan_grasps(part, gripper, replace(DEFAULTS, t_dct=t)) for t in (0.0, 3e-3))
    assert rows(none)["pad standing"].dropped["finger of the pair off the surface"] > 0
    assert names(none) < names(three)


def test_both_assignments_are_planned(gripper, bar):
    closing = plan_grasps(bar, gripper).part_from_hand[:, 0, 0]
    assert np.isclose(closing, 1.0).any()
    assert np.isclose(closing, -1.0).any()


def test_the_record_follows_the_candidates(gripper, bar):
    stages = rows(plan_grasps(bar, gripper))
    assert stages["stroke collision"].taken == 2 * DEFAULTS.n_da * stages["contact pairs"].kept
    assert stages["pad standing"].taken == stages["stroke collision"].kept
    assert stages["hand collision"].taken == stages["pad standing"].kept


@pytest.mark.parametrize("width", [0.020, 0.030, 0.040, 0.060])
def test_the_face_at_the_opening_counts(gripper, width):
    """A face that leans stands off a flat side by its sine times half the pad's length: 1.5 mm is too much."""
    part = Part.from_mesh(trimesh.creation.box([width, 0.11, 0.05]), mass=0.1)
    grasps = plan_grasps(part, gripper)
    pads = grasps.part_from_hand[:, None] @ gripper.hand_from_pad(grasps.opening)
    half = gripper.pads[0].size[1] / 2 * pads[:, :, :3, 2]
    ends = [np.abs(pads[:, :, 1:3, 3] + sign * half[:, :, 1:3]) for sign in (-1, 1)]
    on_side = np.all(ends < np.array([0.055, 0.025]), axis=(0, 2, 3))
    across = (np.abs(grasps.part_from_hand[:, 0, 0]) > 0.999) & on_side
    if width == 0.060:  # there the faces lean by 12 deg, in the other cases by 4 at most
        assert not across.any()
        assert rows(grasps)["pad standing"].dropped["pad not on the surface"] > 0
    else:
        assert across.sum() > 10
        stand_off = 2 * np.abs(half[across][:, 0, 0])
        assert np.allclose(grasps.opening[across], width + stand_off, atol=2e-4)
