"""Tools that are used: straight to where they work and straight back, held as they were; and why they cannot be."""

from __future__ import annotations

from dataclasses import replace
from math import pi

import msgspec
import numpy as np
import pytest
from own_kinematics import Flanges

from kumitate.errors import NoRegraspError
from kumitate.tasks.cell import Cell
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.job import Job
from kumitate.tasks.task import At, Grasping, Insert, Use
from kumitate.tasks.task_checks import grasp_parameters
from kumitate.tasks.use import use
from kumitate.transforms import invert, pose, pose_distance

TABLE_TOP = 0.01  # m, in the table's frame
HALF = 0.06  # m, of the block's height
FRAMES = {
    "foot": At((0.0, 0.0, -HALF), (pi, 0.0, 0.0)),  # z out of the face
    "head": At((0.0, 0.0, HALF)),
    "edge": At((0.0, 0.015, -HALF), (pi, 0.0, 0.0)),
}
DOWN = (pi, 0.0, 0.0)
ON_TABLE = Use(
    part="block",
    frame="foot",
    of="table",
    at=At((0.02, 0.05, TABLE_TOP), DOWN),
    approach=Insert((0.0, 0.0, -2.0), 0.04),
)


@pytest.fixture(scope="module")
def cell(block_cell) -> Cell:
    """The block as a tool with three frames, and not too many grasps."""
    task = block_cell.task
    block = msgspec.structs.replace(task.parts["block"], frames=FRAMES, grasps=Grasping(t_rnn=0.012, n_da=4))
    task = msgspec.structs.replace(task, parts={**task.parts, "block": block})
    return replace(block_cell, task=task, parameters={**block_cell.parameters, "block": grasp_parameters(block)})


@pytest.fixture
def job(cell):
    return Job(cell, 0, Deadline(600.0))


def changed(**fields) -> Use:
    return msgspec.structs.replace(ON_TABLE, **fields)


def kinds(job: Job) -> list[str]:
    return [step.kind for step in job.motions.steps]


def frames(job: Job, step, frame: str) -> np.ndarray:
    """Poses (n, 4, 4) of a frame of the block along a step, by kinematics of the tests' own."""
    flanges, (arm,) = Flanges("nextage", job.cell.robot.joint_names), step.arms
    assert step.start.attached["block"].carrier == step.end.attached["block"].carrier == arm
    flange_from_frame = step.start.attached["block"].carrier_from_body @ pose(FRAMES[frame].xyz, FRAMES[frame].rpy)
    times = np.linspace(0.0, step.trajectory.duration, 60)
    return np.array([flanges.at(q)[arm] @ flange_from_frame for q in step.trajectory.sample(times)])


def assert_straight(ways: np.ndarray, end: np.ndarray, way: np.ndarray) -> None:
    """That poses (n, 4, 4) lead along ``way`` (3,) to ``end`` (4, 4), forward only and without turning."""
    direction = way / np.linalg.norm(way)
    offsets = ways[:, :3, 3] - end[:3, 3]
    along = offsets @ direction
    np.testing.assert_allclose(along[[0, -1]], [-np.linalg.norm(way), 0.0], atol=2e-4)
    assert (np.diff(along) >= -1e-9).all()
    assert np.linalg.norm(offsets - along[:, None] * direction, axis=1).max() < 0.3e-3
    assert max(pose_distance(at, end)[1] for at in ways) < np.radians(0.3)


# What it does ---------------------------------------------------------------------------------------------------------


def test_the_frame_comes_straight_to_its_pose_and_straight_back(job):
    before = job.motions.state
    use(job, ON_TABLE)
    press, withdraw = job.motions.steps[-2:]
    assert kinds(job) == ["transit", "approach", "close", "lift", "transfer", "press", "withdraw"]
    world_from_table = before.poses["table"]
    end, way = world_from_table @ pose(ON_TABLE.at.xyz, ON_TABLE.at.rpy), np.array([0.0, 0.0, -0.04])
    assert_straight(frames(job, press, "foot"), end, way)
    assert_straight(frames(job, withdraw, "foot")[::-1], end, way)
    assert job.motions.state.attached["block"].carrier == press.arms[0]


def test_it_touches_what_it_is_used_on_while_it_is_used_and_not_before_or_after(job):
    use(job, ON_TABLE)
    transfer, press, withdraw = job.motions.steps[-3:]
    pairs = {step: {(c.first, c.second) for c in step.start.contacts} for step in (transfer, press, withdraw)}
    assert pairs[press] - pairs[transfer] == pairs[withdraw] - pairs[transfer] == {("table", "block")}
    assert {(c.first, c.second) for c in job.motions.state.contacts} == pairs[transfer]


def test_a_tool_in_the_hand_is_used_again_without_being_let_go(job):
    use(job, ON_TABLE)
    steps = len(job.motions.steps)
    use(job, changed(at=At((0.02, 0.12, TABLE_TOP), DOWN)))
    assert kinds(job)[steps:] == ["transfer", "press", "withdraw"]
    assert len({step.arms for step in job.motions.steps[steps:]}) == 1


def test_direction_and_pose_are_told_in_the_frame_of_a_part(job):
    """Slanting up into the air above the peg, told from the peg."""
    up = changed(of="peg", at=At((0.0, -0.08, 0.1), DOWN), approach=Insert((1.0, 0.0, 1.0), 0.03))
    use(job, up)
    end = job.pose("peg") @ pose(up.at.xyz, up.at.rpy)
    way = job.pose("peg")[:3, :3] @ (0.03 * np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0))
    assert_straight(frames(job, job.motions.steps[-2], "foot"), end, way)


@pytest.mark.slow
def test_the_arm_that_shall_do_it_is_given_the_tool(job):
    far_left = pose([0.35, 0.55, 0.01])
    job.motions.state = job.motions.state.with_pose("block", far_left)
    use(job, changed(arm="right", at=At((0.02, -0.3, TABLE_TOP), DOWN)))
    assert job.motions.steps[0].arms == ("left",)
    assert job.motions.steps[-2].arms == job.motions.steps[-1].arms == ("right",)
    assert kinds(job)[-2:] == ["press", "withdraw"]


def test_a_tool_that_must_be_turned_over_is_regrasped_first(job):
    """No grasp with which the standing block can be taken leaves room for the hand when its head is on the table."""
    over = changed(frame="head", arm="left")
    use(job, over)
    assert kinds(job).count("close") == 2
    end = job.motions.steps[-1].start.poses["table"] @ pose(over.at.xyz, over.at.rpy)
    assert_straight(frames(job, job.motions.steps[-2], "head"), end, np.array([0.0, 0.0, -0.04]))


# Turns ----------------------------------------------------------------------------------------------------------------

# The block's edge, from which it reaches 30 mm towards the peg, 11 mm behind the peg.
BY_THE_PEG = changed(frame="edge", at=At((-0.05, 0.37, TABLE_TOP), DOWN))


def test_any_turn_finds_one_where_the_pose_itself_is_not_free(job):
    with pytest.raises(NoRegraspError) as caught:
        use(job, BY_THE_PEG)
    assert "part against block / peg" in caught.value.report[0]
    assert job.motions.steps == []
    use(job, msgspec.structs.replace(BY_THE_PEG, any_turn=(0.0, 0.0, 1.0)))
    reached = frames(job, job.motions.steps[-2], "edge")[-1]
    turn = invert(job.pose("table") @ pose(BY_THE_PEG.at.xyz, BY_THE_PEG.at.rpy)) @ reached
    np.testing.assert_allclose(turn[:3, 3], 0.0, atol=1e-4)
    np.testing.assert_allclose(turn[:3, 2], [0.0, 0.0, 1.0], atol=1e-3)
    assert np.linalg.norm(turn[:3, :3] - np.eye(3)) > 0.5


# Why it does not ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("of", [None, "peg"])
def test_it_may_touch_nothing_but_what_it_is_used_on(job, of):
    """The same pose as on the table, told in the world or from the peg."""
    world_from_of = np.eye(4) if of is None else job.pose(of)
    there = invert(world_from_of) @ job.pose("table") @ pose(ON_TABLE.at.xyz, ON_TABLE.at.rpy)
    with pytest.raises(NoRegraspError, match="its foot does not come to where it is used") as caught:
        use(job, changed(of=of, at=At(tuple(there[:3, 3]), DOWN)))
    assert "part against table / block" in caught.value.report[0]
    assert job.motions.steps == []


def test_what_stands_in_the_way_there_is_told(job):
    """Along the table past the peg, which is at neither end of the way."""
    past = changed(at=At((-0.05, 0.41, TABLE_TOP + 0.005), DOWN), approach=Insert((0.0, 1.0, 0.0), 0.12), arm="left")
    with pytest.raises(NoRegraspError) as caught:
        use(job, past)
    assert any("press of block by the left arm: blocked" in line and "peg" in line for line in caught.value.report)
    assert job.motions.steps == []


def test_a_pose_out_of_reach_is_told(job):
    with pytest.raises(NoRegraspError) as caught:
        use(job, changed(of=None, at=At((1.5, 0.0, 0.3), DOWN)))
    assert "no inverse kinematics at the grasp" in caught.value.report[0]
