"""Why there is no plan: tasks with one cause, and with two that compete, and the causes that are named first."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from infeasible import BLOCK, MESHES, ONE, PUT_ASIDE, TABLE, TWO, folder, moving, refusal
from msgspec.structs import replace

from kumitate.errors import TimeLimitError
from kumitate.grasping.measured import Measured
from kumitate.grasping.part import Part
from kumitate.grasping.store import cached_grasps
from kumitate.regrasp.diagnosis import Cause
from kumitate.robots.library import load_hand
from kumitate.tasks.planner import plan
from kumitate.tasks.reasons import NoPlanError, Report, funnel
from kumitate.tasks.task import At, Goal, HandOver, Place
from kumitate.tasks.task_checks import grasp_parameters
from kumitate.tasks.verify import verify

LONG = "a ring on a post with a head"


def named(report, n):
    """The first ``n`` causes, as the tasks tell them."""
    return [(cause.words, cause.bodies) for cause, _ in report.causes[:n]]


def is_told(told, expected):
    """Whether causes are those expected: the same bodies, and the words among those told."""
    return len(told) == len(expected) and all(
        words in said and bodies == met for (said, met), (words, bodies) in zip(told, expected, strict=True)
    )


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n == LONG else n for n in ONE])
def test_the_one_cause_is_named_first(name):
    error, expected = refusal(name), ONE[name]
    report = error.report
    assert report.goal == 0
    assert report.where == expected.where
    assert is_told(named(report, 1), expected.causes)
    assert str(error).startswith(f"goal 1 is not reached: {expected.where}: {report.causes[0][0]}")
    assert next(iter(report)).startswith(f"because of: {report.causes[0][0]} ({report.causes[0][1]})")


@pytest.mark.parametrize("name", TWO)
def test_two_causes_that_compete_are_both_named_with_their_counts(name):
    error, expected = refusal(name), TWO[name]
    report = error.report
    assert report.where == expected.where
    assert is_told(named(report, 2), expected.causes)
    (first, n), (second, m) = report.causes[:2]
    assert str(error).startswith(f"goal 1 is not reached: {expected.where}: {first}; {second}")
    assert next(iter(report)).startswith(f"because of: {first} ({n}); {second} ({m})")
    assert min(n, m) > 0
    if second.bodies:  # what the arms cannot reach was not asked further, and comes last
        assert n >= m


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE | TWO)
def test_without_the_cause_there_is_a_plan(name):
    assert verify(plan((ONE | TWO)[name].cured, folder())).ok


def unsteady(tmp_path, held, goal):
    """A heavy block of whose grasps by the gripper ``held`` held, for a gripper and a cup; and how many there are."""
    MESHES["block"]().export(tmp_path / "block.stl")
    entry = replace(BLOCK, mass=2.0)
    part = Part.load(tmp_path / entry.mesh, unit=entry.unit, mass=entry.mass)
    grasps = cached_grasps(part, load_hand("robotiq_2f85"), grasp_parameters(entry))
    n = len(grasps)
    measured = Measured(np.ones(n, dtype=bool), *np.zeros((3, n)), np.arange(n) < held)
    dataclasses.replace(grasps, measured=measured).save(tmp_path / "block.npz")
    entry = replace(entry, grasps=replace(entry.grasps, measured=("block.npz",)))
    return replace(moving("block", entry, goal), hands={"left": "robotiq_2f85", "right": "suction_cup"}), n


def test_that_no_grasp_held_in_simulation_is_named_first(tmp_path):
    task, n = unsteady(tmp_path, 0, PUT_ASIDE.goals[0])
    with pytest.raises(NoPlanError, match="robotiq_2f85 has no grasp, none held in simulation: block; suc") as caught:
        plan(task, tmp_path)
    report = caught.value.report
    assert report.where == "no grasp of block works where it is"
    assert report.causes[0] == (Cause("robotiq_2f85 has no grasp, none held in simulation:", ("block",)), n)
    second, fallen = report.causes[1]
    assert second == Cause("suction_cup has no grasp, turns under gravity:", ("block",))
    assert fallen > n
    assert f"0 of {n} grasps of block by robotiq_2f85 held in simulation" in list(report)


def test_how_many_grasps_held_in_simulation_is_told_where_others_are_not_used(tmp_path):
    task, n = unsteady(tmp_path, 7, Goal(place=Place("block", At((0.5, 0.6, 0.01)))))
    with pytest.raises(NoPlanError) as caught:
        plan(task, tmp_path)
    lines = list(caught.value.report)
    assert f"7 of {n} grasps of block by robotiq_2f85 held in simulation" in lines
    assert any(line.startswith("block, at its goal, left arm: 7 grasps planned, 7 looked at, 0 work") for line in lines)


def test_a_time_that_is_too_short_is_no_cause_in_the_cell():
    with pytest.raises(TimeLimitError, match=r"the time limit of 0\.01 s was over .*; give more time"):
        plan(PUT_ASIDE, folder(), time_limit=0.01)


# The report -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a goal that is occupied", "a bar across the bore", "an assembly pose too low"])
def test_each_part_place_and_arm_has_its_funnel(name):
    report = refusal(name).report
    task = (ONE | TWO)[name].task
    asked = {(entry.part, entry.node.name, entry.arm) for entry in report.diagnoses}
    expected = {(part, "where it is", arm) for part in task.parts for arm in task.hands}
    if name != "a bar across the bore":
        expected |= {(part, f"{part} at its goal", arm) for part in task.parts for arm in task.hands}
    assert asked == expected
    lines = list(report)
    for entry in report.diagnoses:
        assert funnel(entry) in lines
        assert entry.planned >= entry.looked > 0
        assert entry.stopped.total() == entry.looked


def test_a_funnel_tells_the_counts_that_the_diagnosis_has():
    entry = refusal("a goal that is occupied").report.diagnoses[2]
    told = funnel(entry)
    assert told.startswith("block, at its goal, left arm: 1000 grasps planned, 240 looked at, 0 work (")
    assert f"{entry.each[Cause('part against', ('crate',))]} part against crate" in told
    counts = [int(n) for n in re.findall(r"[(,] ?(\d+) ", told.split("work ")[1])]
    assert counts == sorted(counts, reverse=True)
    assert max(counts) <= entry.looked


def test_motions_that_failed_are_told_with_segment_and_bodies():
    report = refusal("a bar over the part").report
    assert len(report.attempts) >= 1
    assert set(report.attempts) <= set(report)
    for attempt in report.attempts:
        assert attempt.bodies == ("bar", "puck")
        assert re.match(r"start to .*: lift of puck by the \w+ arm: blocked after \d+% of the way", attempt)
    assert sum(n for _, n in report.causes) == len(report.attempts)


def test_what_the_search_counts_is_not_told_twice():
    lines = list(refusal("a lid over the part").report)
    assert not any("start, left arm" in line for line in lines)
    assert len(lines) == len(set(lines))


def test_pinned_arms_are_asked_alone_at_the_goal():
    goal = Goal(place=Place("block", At((0.5, 0.6, 0.01)), arm="right"))
    with pytest.raises(NoPlanError) as caught:
        plan(moving("block", PUT_ASIDE.parts["block"], goal), folder())
    assert [entry.arm for entry in caught.value.report.diagnoses] == ["left", "right", "right"]


def test_a_second_goal_is_told_from_where_the_first_has_brought_everything():
    goals = (*PUT_ASIDE.goals, Goal(hand_over=HandOver("block", "left", At((0.4, 1.2, 0.3)))))
    with pytest.raises(NoPlanError, match="goal 2 is not reached: no grasp of block works at its goal") as caught:
        plan(replace(PUT_ASIDE, goals=goals), folder())
    report = caught.value.report
    assert report.goal == 1
    (start, *_) = (entry for entry in report.diagnoses if entry.node.name == "where it is")
    assert start.node.world_from_part[:2, 3] == pytest.approx(PUT_ASIDE.goals[0].place.at.xyz[:2], abs=1e-4)


# The candidate to look at ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name", ["a lid over the part", "a goal that is occupied", "two walls, each before half of the grasps"]
)
def test_the_nearest_candidate_stands_there_with_a_hand_on_the_part(name):
    report = refusal(name).report
    blocked = report.blocked
    robot = blocked.scene.robot
    arm = next(arm for arm in robot.arms if (blocked.state.q != robot.home)[robot.arms[arm].indices].any())
    hand = robot.hand_pose(arm, blocked.state.q, blocked.state.openings[arm])
    assert abs(hand[:3, 3] - blocked.place).max() < 0.07  # the block is 120 mm long
    assert blocked.hand is None
    assert blocked.bodies
    assert blocked.bodies <= {body for cause, _ in report.causes for body in cause.bodies}


def test_a_hand_that_no_arm_brings_there_is_shown_by_itself():
    blocked = refusal("a goal out of reach").report.blocked
    assert (blocked.state.q == blocked.scene.robot.home).all()
    arm, base = blocked.hand
    assert arm in blocked.scene.robot.hands
    assert abs(base[:3, 3] - blocked.place).max() < 0.25
    assert blocked.bodies == set()


@pytest.mark.parametrize(
    ("name", "bodies"),
    [("a bar over the part", {"bar"}), ("a part too heavy", {"block"}), ("a bar across the bore", {"peg", "barred"})],
)
def test_where_no_grasp_is_to_blame_everything_is_shown_as_it_stands(name, bodies):
    blocked = refusal(name).report.blocked
    assert blocked.bodies == bodies
    assert blocked.hand is None
    assert (blocked.state.q == blocked.scene.robot.home).all()
    part = next(iter((ONE | TWO)[name].task.parts.values()))
    assert blocked.place == pytest.approx(part.at.xyz)


def test_a_report_of_no_single_goal_speaks_of_the_plan():
    error = NoPlanError(Report(None, "nothing works", ((Cause("blocked by", (TABLE.name,)), 3),)), ValueError("never"))
    assert str(error) == "there is no plan: nothing works: blocked by table"
    assert list(error.report) == ["because of: blocked by table (3)"]
