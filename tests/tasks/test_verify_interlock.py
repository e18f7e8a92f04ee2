"""Interlocked hands: what is between what, whichever of the two is named first."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import trimesh
from edits import with_goal
from goal_faults import goal_faults
from plans import interlocked_plan, sample_plan, short_plan

from kumitate.tasks.verify_cell import Cell, read_cell
from kumitate.tasks.verify_faults import Findings
from kumitate.tasks.verify_interlock import Fingers, interlocked
from kumitate.tasks.verify_motion import Curve
from kumitate.transforms import Array, invert, pose, transform_points

FACING = pose(rpy=[0.0, np.pi, 0.0])  # giver_from_taker, half a turn about the line through the pair


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(interlocked_plan(), Findings())


def fingers(cell: Cell, world_from_hand: Array, opening: float = 0.03) -> Fingers:
    """The hand somewhere, without an arm."""
    gripper, at = cell.machine.grippers["left"], np.array([opening])
    return Fingers(
        world_from_hand, transform_points(world_from_hand @ invert(gripper.hand(at)[0]), gripper.faces(at)[0])
    )


@pytest.mark.parametrize(
    ("giver_from_taker", "found"),
    [
        (FACING, True),
        (FACING @ pose([0.0, 0.007, 0.0]), True),  # 8 mm of room beside each finger
        (FACING @ pose([0.0, -0.007, 0.0]), True),
        (FACING @ pose([0.0, 0.02, 0.0]), False),
        (FACING @ pose([0.0, -0.02, 0.0]), False),
        (FACING @ pose([0.0, 0.06, 0.0]), False),
        (FACING @ pose([0.0, 0.0, 0.015]), True),
        (FACING @ pose([0.0, 0.0, -0.015]), True),
        (FACING @ pose([0.0, 0.0, -0.03]), False),  # the tips do not meet
        (FACING @ pose(rpy=[0.0, 0.0, np.pi]), False),  # single finger against single finger
        (FACING @ pose(rpy=[np.pi / 2, 0.0, 0.0]), False),
        (FACING @ pose(rpy=[-np.pi / 2, 0.0, 0.0]), False),
        (FACING @ pose(rpy=[0.0, np.pi / 2, 0.0]), False),
        (FACING @ pose(rpy=[0.0, 0.0, np.pi / 2]), False),
        (FACING @ pose(rpy=[0.1, 0.05, 0.05]), True),
        (FACING @ pose(rpy=[0.0, np.pi, 0.0]), False),  # one hand in the other
        (pose(rpy=[0.0, 0.0, np.pi]), False),  # from the same side
    ],
)
def test_fingers_are_interlocked_only_where_they_stand_between_each_other(cell, rng, giver_from_taker, found):
    anywhere = trimesh.transformations.random_rotation_matrix(rng.random(3))
    both = [fingers(cell, anywhere), fingers(cell, anywhere @ giver_from_taker)]
    for one, other in itertools.permutations(both):
        assert interlocked(one, other) is found


@pytest.mark.parametrize("opening", [0.002, 0.01, 0.08])
def test_it_does_not_depend_on_the_width_of_the_part(cell, opening):
    assert interlocked(fingers(cell, pose(), opening), fingers(cell, FACING, opening))


@pytest.mark.parametrize("hand", [(), ("suction_cup", (0.04, 0.04, 0.03), 0.015)])
def test_two_fingers_or_cups_do_not_interlock(hand):
    cell = read_cell(short_plan(*hand), Findings())
    assert not interlocked(fingers(cell, pose()), fingers(cell, FACING))


def test_the_fingers_of_a_plan_stand_where_its_grasps_say(cell):
    plan = interlocked_plan()
    for action in plan.actions:
        for event in action.events:
            if event.kind == "attach":
                values = Curve.of(action, cell).at(np.array([event.time]))
                found = Fingers.of(cell, event.carrier, values)
                world_from_hand = np.array(action.end.poses["bar"]) @ np.array(action.grasp.part_from_hand)
                other = fingers(cell, world_from_hand)
                np.testing.assert_allclose(found.world_from_hand, other.world_from_hand, atol=1e-4)
                np.testing.assert_allclose(found.faces, other.faces, atol=1e-4)


def test_a_part_goes_from_hand_to_hand():
    assert goal_faults(interlocked_plan()) == ()
    (fault,) = goal_faults(with_goal(sample_plan(), 0, "hand_over", interlocked=True))
    assert fault.name == "interlock"
    assert "from the left hand" in fault.words


def test_a_part_that_was_on_the_table_came_from_no_hand():
    """The giver holds it where the goal says, before it hands it over."""
    assert goal_faults(with_goal(interlocked_plan(), 0, "hand_over", to="right", interlocked=False)) == ()
    (fault,) = goal_faults(with_goal(interlocked_plan(), 0, "hand_over", to="right"))
    assert fault.name == "interlock"
    assert "from no other hand" in fault.words
