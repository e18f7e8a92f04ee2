"""The record of a job: every state that a plan tells is where the motions and the events lead."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from own_kinematics import Flanges

from kumitate.transforms import invert, pose_distance


@pytest.fixture(scope="module")
def flanges(wheel_plan):
    return Flanges("nextage", wheel_plan.joints)


def test_the_poses_of_carried_parts_are_those_of_forward_kinematics(wheel_plan, flanges):
    carried = 0
    for action in wheel_plan.actions:
        for state in (action.start, action.end):
            at = {**flanges.at(state.q), **{part: np.array(where) for part, where in state.poses.items()}}
            for part, entry in state.attached.items():
                told = at[entry.carrier] @ np.array(entry.carrier_from_part)
                distance, angle = pose_distance(told, at[part])
                assert distance < 1e-9
                assert angle < 1e-6
                carried += 1
    assert carried > len(wheel_plan.actions)


def test_parts_that_nobody_carries_stay_where_they_are(wheel_plan):
    for action in wheel_plan.actions:
        for part, where in action.start.poses.items():
            if part not in action.start.attached and part not in action.end.attached:
                assert action.end.poses[part] == where


def test_each_action_starts_where_the_one_before_ended(wheel_plan):
    for one, other in itertools.pairwise(wheel_plan.actions):
        assert other.start == one.end


def test_motions_join_their_states_from_rest_to_rest(wheel_plan):
    for action in wheel_plan.actions:
        motion = action.motion
        np.testing.assert_allclose(motion.positions[0], action.start.q, atol=1e-12)
        np.testing.assert_allclose(motion.positions[-1], action.end.q, atol=1e-12)
        assert not np.any([motion.velocities[0], motion.velocities[-1]])
        for arm, openings in motion.openings.items():
            assert openings[0] == pytest.approx(action.start.openings[arm])
            assert openings[-1] == pytest.approx(action.end.openings[arm])


def test_the_events_are_what_changes_who_carries_what(wheel_plan):
    for action in wheel_plan.actions:
        taken = {event.part: event.carrier for event in action.events if event.kind == "attach"}
        let_go = {event.part for event in action.events if event.kind == "detach"}
        before, after = action.start.attached, action.end.attached
        for part in action.start.poses:
            if part in taken:
                assert after[part].carrier == taken[part]
            elif part in let_go and before[part].carrier == next(e.carrier for e in action.events):
                assert part not in after
            else:
                assert after.get(part) == before.get(part)


def test_the_grasp_told_is_the_one_with_which_the_hand_takes_the_part(wheel_plan, wheel_cell):
    takings = 0
    for action in wheel_plan.actions:
        for event in action.events:
            if event.kind == "attach" and event.carrier in wheel_cell.robot.hands:
                flange_from_part = np.array(action.end.attached[event.part].carrier_from_part)
                arm = wheel_cell.robot.arms[event.carrier]
                opening = action.end.openings[event.carrier]
                told = invert(flange_from_part) @ arm.flange_from_hand(opening)[0]
                distance, angle = pose_distance(told, np.array(action.grasp.part_from_hand))
                assert distance < 1e-5
                assert angle < 1e-4
                assert action.grasp.opening == pytest.approx(opening)
                takings += 1
    assert takings == 2
