"""Tools that are used: brought straight to where they work, and straight back, in one hand."""

from __future__ import annotations

import numpy as np
import pytest
from edits import kinds, with_action, with_goal
from goal_faults import goal_faults
from msgspec.structs import replace
from plans import use_plan

from kumitate.tasks.document import Event, Plan

AT = use_plan().task["goals"][0]["use"]["at"]
PLATE = use_plan().task["cell"][1]["at"]["xyz"]
PRESS, WITHDRAW = (kinds(use_plan(), kind)[0] for kind in ("press", "withdraw"))


def used(**changes: object) -> Plan:
    return with_goal(use_plan(), 0, "use", **changes)


def names(plan: Plan) -> list[str]:
    return [fault.name for fault in goal_faults(plan)]


@pytest.mark.parametrize("aside", [0.09e-3, 0.11e-3])
def test_the_frame_comes_to_its_pose(aside):
    found = goal_faults(used(at={**AT, "xyz": [AT["xyz"][0] + aside, *AT["xyz"][1:]]}))
    assert [(fault.name, fault.action) for fault in found] == ([("goal", PRESS)] if aside > 0.1e-3 else [])
    assert all("tip of block is 0.110 mm" in fault.words for fault in found)


@pytest.mark.parametrize(
    ("axis", "rpy", "found"),
    [
        ([0.0, 0.0, 1.0], [np.pi, 0.0, 0.0], []),
        ([0.0, 0.0, 1.0], [np.pi, 0.0, 2.0], []),
        (None, [np.pi, 0.0, 2.0], ["goal"]),
        ([1.0, 0.0, 0.0], [np.pi, 0.0, 2.0], ["goal"]),
        ([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], []),
    ],
)
def test_the_frame_may_be_turned_about_its_free_axis(axis, rpy, found):
    assert names(used(at={**AT, "rpy": rpy}, any_turn=axis)) == found


def test_poses_and_ways_are_told_in_the_frame_of_what_the_tool_works_on():
    """A goal in the world, and on the plate turned over."""
    assert names(used(of=None, at={**AT, "xyz": (np.array(PLATE) + AT["xyz"]).tolist()})) == []
    table, plate = use_plan().task["cell"]
    cell = [table, {**plate, "at": {"xyz": PLATE, "rpy": [np.pi, 0.0, 0.0]}}]
    over = {"xyz": [0.0, 0.0, -AT["xyz"][2]], "rpy": [0.0, 0.0, 0.0]}
    approach = {"direction": [0.0, 0.0, 1.0], "distance": 0.04}
    for way, found in ((approach, []), ({**approach, "direction": [0.0, 0.0, -1.0]}, ["use"])):
        turned = used(at=over, approach=way)
        assert names(replace(turned, task={**turned.task, "cell": cell})) == found


def test_the_hand_that_uses_it_is_the_one_that_the_goal_names():
    assert names(used(arm="left")) == []
    (fault,) = goal_faults(used(arm="right"))
    assert (fault.name, fault.action) == ("goal", PRESS)
    assert "held by left" in fault.words


def test_it_stays_in_the_hand_until_it_is_drawn_back():
    plan = use_plan()
    late = Event(plan.actions[WITHDRAW].motion.duration, "detach", "block", "left")
    assert "use" in names(with_action(plan, WITHDRAW, events=(late,)))


def test_it_is_drawn_back_for_the_same_goal_by_the_same_arm_alone():
    assert names(with_action(use_plan(), WITHDRAW, goal=None)) == ["use"]
    for i in (PRESS, WITHDRAW):
        assert names(with_action(use_plan(), i, arms=("left", "right"))) == ["use"]


def test_it_is_drawn_back_at_once():
    plan = use_plan()
    still = plan.actions[PRESS]
    motion = still.motion
    rest = {
        "times": (0.0,),
        "positions": motion.positions[-1:],
        "velocities": motion.velocities[-1:],
        "openings": {arm: row[-1:] for arm, row in motion.openings.items()},
        "opening_velocities": {arm: row[-1:] for arm, row in motion.opening_velocities.items()},
    }
    waiting = replace(still, kind="transfer", start=still.end, motion=replace(motion, **rest))
    actions = (*plan.actions[:WITHDRAW], waiting, *plan.actions[WITHDRAW:])
    assert names(replace(plan, actions=actions)) == ["use"]


def test_a_second_press_may_make_good_for_the_first():
    """The tool is pressed, drawn back only by a transfer, pressed and drawn back again."""
    plan = use_plan()
    twice = with_action(plan, WITHDRAW, kind="transfer").actions + plan.actions[PRESS:]
    assert names(replace(plan, actions=twice)) == []
    assert names(replace(plan, actions=twice[:-2])) == ["use"]
