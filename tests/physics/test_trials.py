"""Trials of a set: which grasps are tried, once for every two that are mirrored, and what is kept of them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.physics.trials import STEEPEST, on_the_table, run_trials
from kumitate.regrasp.placements import find_placements
from kumitate.robots.library import load_hand
from kumitate.transforms import invert, transform_points


@pytest.fixture(scope="module")
def hand():
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="module")
def part() -> Part:
    return Part.from_mesh(trimesh.creation.box((0.03, 0.04, 0.06)), mass=0.1, name="block")


@pytest.fixture(scope="module")
def grasps(part, hand):
    return plan_grasps(part, hand)


@pytest.fixture(scope="module")
def placements(part):
    return find_placements(part)


@pytest.fixture(scope="module")
def trials(part, hand, grasps, placements):
    return run_trials(part, hand, grasps, placements, count=12, off=1e-3)


def lowest(hand, grasps, i: int, surface_from_part: np.ndarray) -> float:
    """Height above the table of the lowest point of the hand on its way from the approach opening to the grasp [m]."""
    base = surface_from_part @ grasps.part_from_hand[i] @ invert(hand.base_from_hand([grasps.opening[i]]))[0]
    return min(
        transform_points(base @ at, piece.mesh.vertices)[:, 2].min()
        for opening in np.linspace(grasps.opening[i], grasps.approach_opening[i], 9)
        for piece, at in zip(hand.pieces, hand.base_from_piece([opening])[0], strict=True)
    )


def test_only_hands_from_above_that_clear_the_table_are_tried(hand, grasps, placements):
    tried, placement, upright = on_the_table(hand, grasps, placements)
    assert 0 < len(tried) < upright.sum() < len(grasps)
    for i, k in zip(tried[:40], placement[:40], strict=True):
        surface_from_part = placements.surface_from_part[k]
        assert upright[i]
        assert (surface_from_part @ grasps.part_from_hand[i])[2, 2] <= -np.cos(STEEPEST)
        assert lowest(hand, grasps, i, surface_from_part) > 0.0


def test_each_grasp_is_tried_where_its_approach_is_steepest(hand, grasps, placements):
    """Where one that is left out is steeper, or is steep enough at all, the hand meets the table."""
    tried, placement, upright = on_the_table(hand, grasps, placements)
    chosen = dict(zip(tried.tolist(), placement.tolist(), strict=True))
    down = -np.einsum("kj,nj->nk", placements.surface_from_part[:, 2, :3], grasps.part_from_hand[:, :3, 2])
    looked_at = 0
    for i in [*tried[::9], *np.flatnonzero(upright)[::9]]:
        least = down[i, chosen[i]] if i in chosen else np.cos(STEEPEST)
        for k in np.flatnonzero(down[i] > least + 1e-9):
            assert lowest(hand, grasps, i, placements.surface_from_part[k]) < 1e-3
            looked_at += 1
    assert looked_at > 0


def test_of_two_mirrored_grasps_one_is_simulated(part, hand, grasps, placements):
    first = on_the_table(hand, grasps, placements).grasp[0]
    turned = grasps.part_from_hand[first] @ np.diag([-1.0, -1.0, 1.0, 1.0])
    twin = np.argmin(np.abs(grasps.part_from_hand - turned).max(axis=(1, 2)))
    trials = run_trials(part, hand, grasps[[first, twin]], placements)
    assert (trials.seconds > 0.0).sum() == 1
    np.testing.assert_array_equal(trials.shift[0], trials.shift[1])
    assert trials.held.all()


def test_some_of_the_trials_are_of_good_and_of_bad_grasps(trials, hand, grasps, placements):
    possible = on_the_table(hand, grasps, placements).grasp
    assert np.isin(trials.grasp, possible).all()
    assert trials.grasp[0] == possible[0]
    assert trials.grasp[-1] == possible[-1]
    assert np.diff(np.searchsorted(possible, trials.grasp)).max() <= len(possible) / (len(trials) - 1) + 1


def test_what_was_measured_goes_to_its_grasps(trials, grasps):
    measured = trials.measured(len(grasps))
    assert measured.tried.sum() == len(trials) == 12
    np.testing.assert_array_equal(np.flatnonzero(measured.tried), trials.grasp)
    np.testing.assert_array_equal(measured.shift[trials.grasp], trials.displacement)
    np.testing.assert_array_equal(measured.held[trials.grasp], trials.held)


def test_a_hand_that_stands_off_by_a_millimetre_moves_the_part_by_about_as_much(trials):
    assert trials.held.all()
    assert 5e-4 < trials.displacement.max() < 1.5e-3  # a part that is turned moves a little more
