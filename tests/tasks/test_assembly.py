"""Assembly: two parts meet where and by which arms they shall, and no arm moves while two hands hold them."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from kumitate.tasks.assembly import NoMeetingError, attach
from kumitate.tasks.cell import build_cell
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.job import Job
from kumitate.tasks.task import At
from kumitate.tasks.task_file import read_task
from kumitate.transforms import pose, pose_distance

IN_TUBE = pose([0.0, 0.0, -0.045], [np.pi, 0.0, 0.0])


@pytest.fixture
def job(block_cell):
    return Job(block_cell, 0, Deadline(600.0))


@pytest.fixture
def goal(block_task):
    return block_task.goals[2].attach


@pytest.fixture(scope="module")
def done(block_cell, block_task):
    """The job once the peg is in the tube, nothing of it pinned."""
    job = Job(block_cell, 0, Deadline(600.0))
    attach(job, block_task.goals[2].attach, [])
    return job


def test_the_part_is_where_the_goal_says_and_carried_by_the_other(done):
    state = done.motions.state
    assert state.attached["peg"].carrier == "tube"
    assert state.attached["tube"].carrier in done.cell.robot.arms
    tube_from_peg = np.linalg.inv(done.pose("tube")) @ done.pose("peg")
    distance, angle = pose_distance(tube_from_peg, IN_TUBE)
    assert distance < 1e-4
    assert angle < np.radians(0.1)


def test_it_comes_straight_along_the_whole_way(done):
    push = next(step for step in done.motions.steps if step.kind == "insert")
    scene = done.cell.scene
    shares = np.linspace(0.0, push.trajectory.duration, 60)
    ways = []
    for q in push.trajectory.sample(shares):
        state = push.start.with_q(q)
        ways.append(np.linalg.inv(scene.world_from_body(state, "tube")) @ scene.world_from_body(state, "peg"))
    offset = np.array(ways)[:, :3, 3] - IN_TUBE[:3, 3]
    assert offset[0] == pytest.approx([0.0, 0.0, -0.04], abs=2e-4)
    assert np.abs(offset[:, :2]).max() < 0.2e-3
    assert (np.diff(offset[:, 2]) > -1e-9).all()


def test_no_arm_moves_while_two_hands_hold_the_assembly(done):
    steps = done.motions.steps
    push = next(i for i, step in enumerate(steps) if step.kind == "insert")
    assert [step.kind for step in steps[push : push + 3]] == ["insert", "open", "retreat"]
    assert np.ptp(steps[push + 1].trajectory.positions, axis=0).max() == 0.0
    (mover,) = steps[push].arms
    assert steps[push + 1].arms == steps[push + 2].arms == (mover,)
    still = [arm for name, arm in done.cell.robot.arms.items() if name != mover]
    assert np.ptp(steps[push].trajectory.positions[:, still[0].indices], axis=0).max() == 0.0


def test_pinned_arms_and_place_are_kept_to(job, goal, done):
    mover = next(step for step in done.motions.steps if step.kind == "insert").arms[0]
    holder = done.motions.state.attached["tube"].carrier
    where = At((0.4, 0.0, 0.25), (0.0, 0.0, 0.0))
    attach(job, replace(goal, arm=mover, to_arm=holder, where=where), [])
    push = next(step for step in job.motions.steps if step.kind == "insert")
    assert push.arms == (mover,)
    assert push.start.attached["tube"].carrier == holder
    distance, angle = pose_distance(job.cell.scene.world_from_body(push.start, "tube"), pose(where.xyz, where.rpy))
    assert distance < 1e-3
    assert angle < np.radians(1.0)


@pytest.mark.slow
def test_the_arms_may_be_pinned_the_other_way_round(job, goal, done):
    mover = next(step for step in done.motions.steps if step.kind == "insert").arms[0]
    other = next(arm for arm in job.cell.robot.arms if arm != mover)
    attach(job, replace(goal, arm=other), [])
    assert next(step for step in job.motions.steps if step.kind == "insert").arms == (other,)


def test_a_meeting_out_of_reach_is_told_and_leaves_no_motion(job, goal):
    with pytest.raises(NoMeetingError, match="no way to join peg to tube") as caught:
        attach(job, replace(goal, where=At((2.0, 0.0, 0.3))), [])
    assert caught.value.report
    assert job.motions.steps == []
    assert not job.motions.state.attached


@pytest.mark.slow
def test_the_first_of_two_wheels_leaves_room_for_the_second(wheel_folder):
    """What is to come is looked at before the holding grasp is chosen: the support is not taken anew between them."""
    task = read_task(wheel_folder / "two_wheels.yaml")
    job = Job(build_cell(task, wheel_folder), 0, Deadline(600.0))
    first, second = (goal.attach for goal in task.goals)
    attach(job, first, [second])
    attach(job, second, [])
    takings = [step for step in job.motions.steps if step.kind == "close" and step.part == "support"]
    assert len(takings) == 1
