"""One trial: what must be held is held, what cannot be is not, and the part goes where geometry says."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.physics.trial import GRAVITY, Outcome, try_grasp
from kumitate.physics.trials import on_the_table
from kumitate.physics.world import build_world
from kumitate.regrasp.placements import find_placements
from kumitate.robots.hand import Hand
from kumitate.robots.library import load_hand

SIDES = (0.03, 0.04, 0.06)  # m


@pytest.fixture(scope="module")
def gripper() -> Hand:
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="module")
def cup() -> Hand:
    return load_hand("suction_cup")


def block(mass: float) -> Part:
    return Part.from_mesh(trimesh.creation.box(SIDES), mass=mass, name="block")


def outcome(part: Part, hand: Hand, grasps: GraspSet, aside: np.ndarray | None = None) -> Outcome:
    """Of the best grasp that can be tried."""
    placements = find_placements(part)
    tried, placement, _ = on_the_table(hand, grasps, placements)
    pose = placements.surface_from_part[placement[0]]
    return try_grasp(build_world(part, hand), hand, grasps, int(tried[0]), pose, aside)


def test_a_block_is_lifted_held_and_stays_where_it_is(gripper):
    part = block(0.1)
    found = outcome(part, gripper, plan_grasps(part, gripper))
    assert found.lifted
    assert found.held
    assert np.linalg.norm(found.shift) < 1e-4
    assert found.turn < np.radians(0.1)
    assert found.slip < 1e-4


def test_fingers_push_a_part_that_lies_aside_to_their_middle(gripper):
    """Along the closing direction it is pushed back by as much as it lay off; across, it stays."""
    part = block(0.1)
    grasps, placements = plan_grasps(part, gripper), find_placements(part)
    tried, placement, _ = on_the_table(gripper, grasps, placements)
    i = int(tried[0])
    closing = placements.surface_from_part[placement[0], :3, :3] @ grasps.part_from_hand[i, :3, 0]
    assert abs(closing[2]) < 1e-9
    across = np.cross([0.0, 0.0, 1.0], closing)
    found = outcome(part, gripper, grasps, 2e-3 * closing + 1e-3 * across)
    assert found.held
    assert found.shift @ closing == pytest.approx(-2e-3, abs=1e-4)
    assert found.shift @ across == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize(("share", "holds"), [(0.6, True), (1.3, False)])
def test_two_fingers_carry_no_more_than_their_friction(gripper, share, holds):
    """2 mu f is the most that they lift; the grasps are those of a light block, so that planning has no say."""
    most = 2.0 * gripper.friction * gripper.grip_force / GRAVITY
    found = outcome(block(share * most), gripper, plan_grasps(block(0.1), gripper))
    assert found.lifted == holds


@pytest.mark.parametrize(("share", "holds"), [(0.5, True), (1.5, False)])
def test_a_cup_carries_no_more_than_its_vacuum(cup, share, holds):
    most = cup.lip.force / GRAVITY
    found = outcome(block(share * most), cup, plan_grasps(block(0.1), cup))
    assert found.lifted == holds


def test_a_cup_over_a_hole_has_no_vacuum(cup):
    """Grasps of a full disk tried on a ring: a lip that lies over the hole is not sealed."""
    disk = Part.from_mesh(trimesh.creation.cylinder(0.03, 0.01), mass=0.02, name="disk")
    ring = Part.from_mesh(trimesh.creation.annulus(0.012, 0.03, 0.01), mass=0.02, name="ring")
    grasps = plan_grasps(disk, cup)
    middle = np.argmin(np.linalg.norm(grasps.contacts[:, 0, :2], axis=1))
    assert outcome(disk, cup, grasps[[middle]]).held
    assert not outcome(ring, cup, grasps[[middle]]).lifted


def test_a_trial_repeats_exactly(gripper):
    part = block(0.1)
    grasps = plan_grasps(part, gripper)
    one, other = (outcome(part, gripper, grasps, np.array([1e-3, 0.0, 0.0])) for _ in range(2))
    np.testing.assert_array_equal(one.shift, other.shift)
    assert one[1:] == other[1:]


def test_a_cup_seals_within_the_convex_hull(cup):
    """Beside a wall the hull lies millimetres above the floor: it is no surface that a lip could meet."""
    wall = trimesh.creation.box((0.12, 0.004, 0.03), trimesh.transformations.translation_matrix([0.0, -0.048, 0.017]))
    part = Part.from_mesh(
        trimesh.boolean.union([trimesh.creation.box((0.12, 0.1, 0.01)), wall]), mass=0.1, name="corner"
    )
    grasps = plan_grasps(part, cup)
    at = grasps.contacts[:, 0] - [0.0, 0.035, 0.005]
    assert outcome(part, cup, grasps[[np.argmin(np.linalg.norm(at, axis=1))]]).held


def test_a_surface_of_many_pieces_holds_as_one_of_few(gripper):
    """Pads on a plate with a field of holes meet it in thousands of points."""
    plate, turn = (
        trimesh.creation.box((0.06, 0.02, 0.06)),
        trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]),
    )
    places = [[x, 0.0, z] for x in np.arange(-0.008, 0.009, 0.004) for z in np.arange(-0.008, 0.025, 0.004)]
    holes = [
        trimesh.creation.cylinder(0.0008, 0.1, 16, transform=trimesh.transformations.translation_matrix(at) @ turn)
        for at in places
    ]
    few = Part.from_mesh(plate, mass=0.1, name="plate")
    pierced = trimesh.boolean.difference([plate, trimesh.boolean.union(holes)])
    many = Part.from_mesh(pierced, mass=0.1, name="pierced")
    grasps = plan_grasps(few, gripper)
    there = on_the_table(gripper, grasps, find_placements(few)).grasp
    across = there[np.abs(grasps.part_from_hand[there, 1, 0]) > 0.99]
    middle = across[np.argmin(np.abs(grasps.part_from_hand[across, 0, 3]))]
    one, other = (outcome(part, gripper, grasps[[middle]]) for part in (few, many))
    assert one.held
    assert other.held
    np.testing.assert_allclose(other.shift, one.shift, atol=5e-5)
    assert other.slip < 1e-4
