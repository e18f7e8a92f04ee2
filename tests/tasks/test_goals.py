"""Goals of one part: put down at a pose, given to an arm, put down once assembled; and the way home."""

from __future__ import annotations

import dataclasses
from math import pi

import numpy as np
import pytest
from msgspec.structs import replace

from kumitate.errors import InputError, NoRegraspError
from kumitate.grasping.parameters import GraspParameters
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.goals import go_home, hand_over, make_way, place
from kumitate.tasks.job import Job
from kumitate.tasks.planner import plan
from kumitate.tasks.task import Area, At, HandOver, Place
from kumitate.tasks.verify import verify
from kumitate.transforms import invert, pose, pose_distance, transform_points

ASIDE = At((0.45, 0.2, 0.01), (0.0, 0.0, pi / 2))
UPSIDE_DOWN = At((0.45, 0.25, 0.01), (pi, 0.0, 0.0))
AREA = Area("table", ((0.26, 0.0), (0.42, 0.14)), up=(0.0, 0.0, 1.0))
IN_THE_AIR = At((0.4, 0.1, 0.25), (-pi / 2, 0.0, 0.0))


@pytest.fixture
def job(block_cell):
    return Job(block_cell, 0, Deadline(600.0))


@pytest.fixture
def quick(block_cell):
    """A job with fewer grasps of each part."""
    coarse = dict.fromkeys(block_cell.parameters, GraspParameters(t_rnn=0.01, n_da=4))
    return Job(dataclasses.replace(block_cell, parameters=coarse), 0, Deadline(600.0))


def only(task, *parts, goals):
    return replace(task, parts={name: task.parts[name] for name in parts}, goals=goals)


@pytest.mark.parametrize("at", [ASIDE, UPSIDE_DOWN])
def test_a_part_is_put_where_it_shall_stand(job, at):
    place(job, Place("block", at))
    state = job.motions.state
    assert not state.attached
    assert job.rests_on("block") == "table"
    distance, angle = pose_distance(job.pose("block"), pose(at.xyz, at.rpy))
    assert distance < 1e-4
    assert angle < np.radians(0.1)
    assert job.motions.steps[-1].kind == "retreat"


def test_a_pinned_arm_does_it(job):
    place(job, Place("block", At((0.4, 0.0, 0.01)), arm="right"))
    last = next(step for step in reversed(job.motions.steps) if step.kind == "lower")
    assert last.arms == ("right",)


def test_a_part_is_put_anywhere_in_an_area_and_stays_there(quick):
    place(quick, Place("block", area=AREA))
    around = transform_points(quick.pose("block"), quick.cell.parts["block"].mesh.vertices)
    low, high = AREA.corners
    assert (around[:, :2] >= np.array(low) - 1e-5).all()
    assert (around[:, :2] <= np.array(high) + 1e-5).all()
    assert around[:, 2].min() == pytest.approx(-0.05, abs=1e-5)
    np.testing.assert_allclose(quick.pose("block")[:3, :3] @ AREA.up, [0.0, 0.0, 1.0], atol=1e-4)
    steps = len(quick.motions.steps)
    place(quick, Place("block", area=AREA))
    assert len(quick.motions.steps) == steps


def test_a_part_that_may_be_turned_is_put_down_so_that_no_other_is_in_the_way(quick):
    """Lying, it would reach into the peg; turned about the vertical it does not."""
    beside = Place("block", At((0.35, 0.3, -0.035), (pi / 2, 0.0, 0.0)))
    with pytest.raises(NoRegraspError, match="part against block / peg"):
        place(quick, beside)
    place(quick, replace(beside, any_turn=(0.0, 1.0, 0.0)))
    np.testing.assert_allclose(quick.pose("block")[:3, 3], beside.at.xyz, atol=1e-4)
    np.testing.assert_allclose(quick.pose("block")[:3, 1], [0.0, 0.0, 1.0], atol=1e-4)  # as at the pose
    assert quick.rests_on("block") == "table"


def test_a_part_that_may_be_turned_is_held_so_that_nothing_is_in_the_way(quick):
    """Upright, it would reach into the table; turned about its x it does not."""
    low = HandOver("block", "left", At((0.4, 0.1, 0.0)))
    with pytest.raises(NoRegraspError, match="part against table / block"):
        hand_over(quick, low)
    hand_over(quick, replace(low, any_turn=(1.0, 0.0, 0.0)))
    np.testing.assert_allclose(quick.pose("block")[:3, 3], low.at.xyz, atol=1e-4)
    np.testing.assert_allclose(quick.pose("block")[:3, 0], [1.0, 0.0, 0.0], atol=1e-4)
    assert quick.motions.state.attached["block"].carrier == "left"


def test_a_part_is_given_to_the_arm_that_shall_hold_it(job):
    hand_over(job, HandOver("block", "left", IN_THE_AIR))
    assert job.motions.state.attached["block"].carrier == "left"
    assert job.held("block").arm == "left"
    distance, angle = pose_distance(job.pose("block"), pose(IN_THE_AIR.xyz, IN_THE_AIR.rpy))
    assert distance < 1e-3
    assert angle < np.radians(1.0)


def test_the_arms_that_hold_nothing_go_home(job):
    hand_over(job, HandOver("block", "left", IN_THE_AIR))
    robot, before = job.cell.robot, job.motions.state
    go_home(job)
    right, left = (robot.arms[arm].indices for arm in ("right", "left"))
    np.testing.assert_allclose(job.motions.state.q[right], robot.home[right], atol=1e-9)
    np.testing.assert_array_equal(job.motions.state.q[left], before.q[left])


def test_arms_at_home_need_no_motion(job):
    go_home(job)
    assert job.motions.steps == []


def test_an_arm_that_holds_something_makes_way_for_the_other(quick):
    """The left arm holds the block so near above the place of the peg that this cannot be lowered there."""
    hand_over(quick, HandOver("block", "left", At((0.4, 0.3, 0.075), (-pi / 2, 0.0, 0.0))))
    go_home(quick)
    below, mark = Place("peg", At((0.4, 0.3, -0.005)), arm="right"), quick.mark()
    with pytest.raises(NoRegraspError):
        place(quick, below)
    quick.back_to(mark)
    hand_from_block = invert(hand(quick, "left")) @ quick.pose("block")
    assert make_way(quick)
    robot, last = quick.cell.robot, quick.motions.steps[-1]
    left = robot.arms["left"].indices
    np.testing.assert_allclose(quick.motions.state.q[left], robot.home[left], atol=1e-9)
    np.testing.assert_allclose(invert(hand(quick, "left")) @ quick.pose("block"), hand_from_block, atol=1e-9)
    assert (last.kind, last.arms) == ("transfer", ("left",))
    assert not make_way(quick)  # it is out of the way already
    place(quick, below)
    assert quick.rests_on("peg") == "table"
    assert quick.motions.state.attached["block"].carrier == "left"


def test_arms_that_hold_nothing_make_no_way(quick):
    assert not make_way(quick)
    place(quick, Place("block", ASIDE))
    assert not make_way(quick)
    assert quick.motions.steps[-1].kind == "retreat"


def hand(job, arm):
    return job.cell.robot.hand_pose(arm, job.motions.state.q, job.motions.state.openings[arm])


def test_nothing_can_be_put_into_the_air(job):
    with pytest.raises(InputError, match="nothing is below"):
        place(job, Place("block", At((0.4, 0.0, 0.3))))


def test_a_goal_out_of_reach_is_told_with_what_was_tried(job):
    with pytest.raises(NoRegraspError, match="no grasp of it works at the goal") as caught:
        hand_over(job, HandOver("block", "left", At((2.0, 0.0, 0.3))))
    assert any("no inverse kinematics" in line for line in caught.value.report)
    assert job.motions.steps == []


@pytest.mark.slow
def test_from_hand_to_hand_and_down_again(block_task, block_folder):
    task = only(block_task, "block", goals=block_task.goals[:2])
    made = plan(task, block_folder, seed=1)
    assert verify(made).ok
    assert made.actions[-1].end.attached == {}
    over = task.goals[0].hand_over
    held = next(a.end for a in reversed(made.actions) if a.goal == 0)
    assert held.attached["block"].carrier == over.to
    for state, at in ((held, over.at), (made.actions[-1].end, task.goals[1].place.at)):
        distance, angle = pose_distance(np.array(state.poses["block"]), pose(at.xyz, at.rpy))
        assert distance < 1e-4
        assert angle < np.radians(0.1)


@pytest.mark.slow
def test_an_assembly_is_put_down_after_it_is_made(block_task, block_folder):
    joined = replace(block_task.goals[2], attach=replace(block_task.goals[2].attach, then="place"))
    made = plan(only(block_task, "peg", "tube", goals=(joined,)), block_folder, seed=1)
    assert verify(made).ok
    end = made.actions[-1].end
    assert set(end.attached) == {"peg"}
    assert end.attached["peg"].carrier == "tube"


@pytest.mark.slow
def test_an_assembly_that_stands_on_what_was_joined_is_put_down(wheel_task, wheel_folder):
    """The support then stands on the wheel too: its lowest point is the wheel's rim."""
    joined = replace(wheel_task.goals[0], attach=replace(wheel_task.goals[0].attach, then="place"))
    made = plan(replace(wheel_task, goals=(joined,)), wheel_folder, seed=1)
    assert verify(made).ok
    assert set(made.actions[-1].end.attached) == {"wheel"}
