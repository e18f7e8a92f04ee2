"""Two-finger grasps: what h_max and n_da do, stated as sets; bosses; both ways round."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.grasping.facets import segment
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps

DEFAULTS = GraspParameters()


def rows(grasps):
    return {stage.name: stage for stage in grasps.record}


def grasp_names(grasps) -> set[tuple[float, ...]]:
    poses = grasps.part_from_hand[:, :3].reshape(len(grasps), -1)
    return set(map(tuple, np.round(poses, 7)))


@pytest.mark.parametrize(("name", "mass"), [("made", 1.0), ("ttube", 0.5)])
def test_grasps_at_a_smaller_h_max_are_among_those_at_a_larger(gripper, request, name, mass, made):
    if name == "made":
        part = Part.from_mesh(made("tube").mesh, mass=mass)
    else:
        part = Part.load(request.getfixturevalue("paper_objects") / f"{name}.stl", unit="m", mass=mass)
    sets = [plan_grasps(part, gripper, replace(DEFAULTS, h_max=h)) for h in (0.5e-3, 1.5e-3)]
    stability = rows(sets[1])["stability"]
    assert 0.2 <= sum(stability.dropped.values()) / stability.taken <= 0.8
    small, large = map(grasp_names, sets)
    assert small < large
    assert small
    assert sets[0].distance.max() <= sets[1].distance.max()
    assert sets[0].distance.mean() < sets[1].distance.mean()


def test_flatter_facets_hold_at_a_smaller_h_max(gripper, paper_objects):
    part = Part.load(paper_objects / "housing.stl", unit="m", mass=2.0)
    radius = segment(part, DEFAULTS.theta_pln, DEFAULTS.theta_fct).radius
    small, large = (plan_grasps(part, gripper, replace(DEFAULTS, h_max=h)) for h in (0.5e-3, 1.5e-3))
    curvature = [(1.0 / radius[g.facets]).max(axis=1).mean() for g in (small, large)]
    assert curvature[0] < 0.8 * curvature[1]


@pytest.mark.parametrize("name", ["tube", "bracket"])
def test_more_rotations_give_denser_grasps(gripper, name, made):
    part = made(name)
    eight, sixteen = (plan_grasps(part, gripper, replace(DEFAULTS, n_da=n)) for n in (8, 16))
    assert grasp_names(eight) < grasp_names(sixteen)


def test_a_vertical_approach_is_among_the_rotations(gripper, made):
    grasps = plan_grasps(made("block"), gripper)
    level = np.abs(grasps.part_from_hand[:, 2, 0]) < 1e-6
    assert level.any()
    down = grasps.part_from_hand[level][:, 2, 2]
    assert np.isclose(down.min(), -1.0)


def bossed(height: float) -> Part:
    """A block of 60 x 30 x 60 mm with a boss of 4 x 4 mm beside the middle of each of its two large sides."""
    block = trimesh.creation.box([0.06, 0.03, 0.06])
    bosses = [
        trimesh.creation.box([0.004, 2 * height, 0.004]).apply_translation([0.008, side * 0.015, 0.002])
        for side in (-1, 1)
    ]
    return Part.from_mesh(trimesh.util.concatenate([block, *bosses]), mass=0.1)


def test_a_boss_beside_the_contact_that_the_pad_would_sink_through_is_no_grasp(gripper):
    """No pair of bodies is switched off: a pad beside a boss stands on the boss, or not at all."""
    plain, low, high = (plan_grasps(part, gripper) for part in (bossed(1e-6), bossed(1e-3), bossed(4e-3)))

    def over_boss(grasps):
        """Grasps across the block whose pads' faces cover the bosses."""
        across = np.abs(grasps.part_from_hand[:, 1, 0]) > 0.999
        pads = grasps.part_from_hand[:, None] @ gripper.hand_from_pad(grasps.opening)
        boss = np.array([0.008, 0.0, 0.002]) - pads[..., :3, 3]
        inside = [
            np.abs(np.sum(boss * pads[..., :3, k], axis=-1)) < s / 2 - 0.003 for k, s in ((1, 0.022), (2, 0.0375))
        ]
        return across & inside[0].all(axis=1) & inside[1].all(axis=1)

    assert over_boss(plain).sum() > 20
    assert over_boss(low).sum() > 20
    assert np.allclose(low.opening[over_boss(low)], 0.032, atol=2e-5)
    assert not over_boss(high).any()
    assert (
        rows(high)["pad standing"].dropped["pad not on the surface"] + rows(high)["stroke collision"].dropped["stroke"]
        > 0
    )
