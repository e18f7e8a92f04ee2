"""The verifier: valid plans pass, and every way to spoil one is found under its own name."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from edits import with_part
from msgspec.structs import replace
from mutations import ANYWHERE, TOGETHER, USING
from mutations_of_goals import the_goal_turned
from mutations_of_motions import another_robot_file, too_fast
from mutations_of_scenes import a_bigger_part
from plans import interlocked_plan, sample_plan, short_plan, use_plan

from kumitate.errors import InputError
from kumitate.tasks.document import Plan
from kumitate.tasks.verify import FAULTS, verify

HANDS = {
    "robotiq_2f85": ("robotiq_2f85",),
    "suction_cup": ("suction_cup", (0.04, 0.04, 0.03), 0.015),
    "hrp5p_three_finger": ("hrp5p_three_finger", (0.03, 0.1, 0.1), 0.03),
}
# By default one mutation for every fault.
FIRST = {name: spoil for spoil, name in reversed([*ANYWHERE.items(), *TOGETHER.items(), *USING.items()])}


def spoiling(mutations):
    slow = {spoil: () if FIRST[name] is spoil else (pytest.mark.slow,) for spoil, name in mutations.items()}
    return pytest.mark.parametrize("spoil", [pytest.param(s, id=s.__name__, marks=slow[s]) for s in mutations])


def test_a_job_of_two_hands_passes(tmp_path):
    plan = sample_plan()
    found = verify(plan)
    assert found.faults == ()
    assert found.ok
    assert 0.0 < found.clearance < 0.05
    assert len(found.nearest) == 2
    plan.save(tmp_path / "plan.json")
    again = verify(Plan.load(tmp_path / "plan.json"))
    assert (again.faults, again.clearance, again.samples) == (found.faults, found.clearance, found.samples)


@pytest.mark.parametrize("hand", HANDS)
def test_every_kind_of_hand_may_take_a_part(hand):
    assert verify(short_plan(*HANDS[hand])).faults == ()


@pytest.mark.parametrize("make", [use_plan, interlocked_plan])
def test_tools_and_interlocked_hands_pass(make):
    assert verify(make()).faults == ()


@spoiling(ANYWHERE)
def test_what_is_spoiled_is_found(spoil):
    assert ANYWHERE[spoil] in {fault.name for fault in verify(spoil(short_plan())).faults}


@spoiling(TOGETHER)
def test_what_is_spoiled_between_two_hands_is_found(spoil):
    assert TOGETHER[spoil] in {fault.name for fault in verify(spoil(sample_plan())).faults}


@spoiling(USING)
def test_what_is_spoiled_with_a_tool_is_found(spoil):
    assert USING[spoil] in {fault.name for fault in verify(spoil(use_plan())).faults}


@pytest.mark.slow
@pytest.mark.parametrize("spoil", ANYWHERE, ids=lambda spoil: spoil.__name__)
def test_what_is_spoiled_in_a_long_job_is_found(spoil):
    assert ANYWHERE[spoil] in {fault.name for fault in verify(spoil(sample_plan())).faults}


def test_it_shares_nothing_with_the_planner():
    check = "import sys, kumitate.tasks.verify; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True).stdout.split()
    rooms = ("kumitate.robots", "kumitate.grasping", "kumitate.regrasp", "pinocchio", "coal", "ompl", "toppra")
    assert not [name for name in loaded if name.startswith(rooms)]


def test_every_name_is_explained_and_spoiled_by_some_mutation():
    assert {*ANYWHERE.values(), *TOGETHER.values(), *USING.values()} == set(FAULTS)
    assert all(sentence.endswith(".") for sentence in FAULTS.values())


def test_one_fault_does_not_hide_others():
    faults = verify(another_robot_file(the_goal_turned(too_fast(a_bigger_part(short_plan()))))).faults
    assert {"models", "goal", "velocity", "acceleration", "contact", "pads"} <= {fault.name for fault in faults}
    assert len({(fault.name, fault.action) for fault in faults}) == len(faults)
    for fault in faults:
        assert fault.bodies
        assert str(fault).startswith("plan: " if fault.action is None else f"action {fault.action}")


def test_faults_tell_action_time_bodies_and_amount():
    by_name = {fault.name: fault for fault in verify(too_fast(short_plan())).faults}
    fault = by_name["velocity"]
    transfer = next(i for i, action in enumerate(short_plan().actions) if action.kind == "transfer")
    assert fault.action == transfer
    assert 0.0 < fault.time < short_plan().actions[transfer].motion.duration
    assert fault.bodies[0] in short_plan().joints
    limit = {"LARM_JOINT4": 3.91, "LARM_JOINT5": 5.236, "LARM_JOINT3": 4.608}[fault.bodies[0]] * 0.5
    column = short_plan().joints.index(fault.bodies[0])
    fastest = 4.0 * np.abs(np.array(short_plan().actions[transfer].motion.velocities)[:, column]).max()
    assert float(fault.words.split()[2]) >= fastest - limit - 1e-5


def test_a_task_that_is_none_is_refused():
    plan = short_plan()
    for task, message in (
        ({}, "no task"),
        ({**plan.task, "speed": "fast"}, "no task"),
        ({**plan.task, "parts": {"block": {**plan.task["parts"]["block"], "mass": "heavy"}}}, "no task"),
        ({**plan.task, "speed": 1e9}, "speed"),
        ({**plan.task, "goals": [{}]}, "is not one of"),
        ({**plan.task, "parts": {"block": {**plan.task["parts"]["block"], "mass": 0.0}}}, "weighs nothing"),
        ({**plan.task, "robot": "robot of tomorrow"}, "no robot named"),
        ({**plan.task, "robot": "../nextage"}, "no robot named"),
        ({**plan.task, "robot": {"urdf": "mine.urdf", "srdf": "mine.srdf"}}, "cannot be read"),
        ({**plan.task, "hands": {"left": "robotiq_2f85", "third": "suction_cup"}}, "no arm named 'third'"),
        ({**plan.task, "hands": {"left": "claw", "right": "suction_cup"}}, "no hand named 'claw'"),
        ({**plan.task, "goals": [{"place": {"part": "wheel", "at": {}}}]}, "unknown: wheel"),
        ({**plan.task, "cell": plan.task["cell"] * 2}, "taken"),
    ):
        with pytest.raises(InputError, match=message):
            verify(replace(plan, task=task))


def test_quantities_of_the_task_are_plain_numbers():
    with pytest.raises(InputError, match="no task"):
        verify(with_part(short_plan(), "block", mass="50 g"))
