"""The planner: whole tasks planned and verified, the same each time; and what is told where there is no plan."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from math import pi

import numpy as np
import pytest
from msgspec.structs import replace
from mutations import ANYWHERE, TOGETHER
from mutations_of_goals import goals_in_another_order
from mutations_of_holds import a_detach_dropped, a_standing_part_moves, let_go_after_the_retreat
from mutations_of_scenes import a_speck_inside_a_part, a_table_that_ends_under_the_part, an_obstacle_in_the_way
from own_kinematics import Flanges

from kumitate.errors import InputError, PlanningError, TimeLimitError
from kumitate.robots.library import load_robot
from kumitate.tasks.document import Plan
from kumitate.tasks.planner import UnverifiedError, plan
from kumitate.tasks.reasons import NoPlanError
from kumitate.tasks.task import Area, At, Goal, Grasping, HandOver, Insert, Place, Use
from kumitate.tasks.task_file import read_task, task_of
from kumitate.tasks.verify import Fault, Verification, verify
from kumitate.transforms import invert, pose, pose_distance

ON_AXLE = pose([0.0, 0.032, 0.010])  # of the support
PUSH = np.array([0.0, -1.0, 0.0])
# What cannot be spoilt in a plan with one goal and no part that a hand puts down, or in parts that are hollow about
# their origin.
NOT_HERE = {
    a_detach_dropped,
    a_speck_inside_a_part,
    a_standing_part_moves,
    a_table_that_ends_under_the_part,
    an_obstacle_in_the_way,
    goals_in_another_order,
    let_go_after_the_retreat,
}


def with_attach(task, **changes):
    """The main job, but its goal changed."""
    return replace(task, goals=(Goal(attach=replace(task.goals[0].attach, **changes)),))


# The main job ---------------------------------------------------------------------------------------------------------


def test_the_main_job_is_planned_without_a_fault(wheel_plan):
    found = verify(wheel_plan)
    assert found.faults == ()
    assert 0.0 < found.clearance < 0.1
    assert wheel_plan.duration <= 30.0


def test_the_wheel_ends_on_the_axle_and_the_support_in_a_hand(wheel_plan):
    end = wheel_plan.actions[-1].end
    assert end.attached["wheel"].carrier == "support"
    assert end.attached["support"].carrier in ("left", "right")
    support_from_wheel = np.linalg.inv(end.poses["support"]) @ np.array(end.poses["wheel"])
    np.testing.assert_allclose(pose_distance(support_from_wheel, ON_AXLE), 0.0, atol=1e-4)


def test_the_arms_take_the_parts_there_by_kinematics_of_the_tests_own(wheel_plan):
    flanges = Flanges("nextage", wheel_plan.joints)
    push = next(action for action in wheel_plan.actions if action.kind == "insert")
    carried = push.start.attached
    ways = []
    for q in push.motion.positions:
        at = flanges.at(q)
        world = {
            part: at[carried[part].carrier] @ np.array(carried[part].carrier_from_part) for part in ("wheel", "support")
        }
        ways.append(invert(world["support"]) @ world["wheel"])
    ways = np.array(ways)
    distance, angle = pose_distance(ways[-1], ON_AXLE)
    assert distance < 1e-4
    assert angle < np.radians(0.1)
    # Straight along the axle, over the whole distance, without turning.
    offsets = ways[:, :3, 3] - ON_AXLE[:3, 3]
    along = offsets @ PUSH
    assert along[0] == pytest.approx(-0.070, abs=2e-4)
    assert (np.diff(along) > 0.0).all()
    assert np.linalg.norm(offsets - along[:, None] * PUSH, axis=1).max() < 0.2e-3
    assert max(pose_distance(way, ON_AXLE)[1] for way in ways) < np.radians(0.2)


def test_the_empty_arm_goes_home_and_the_other_stays(wheel_plan):
    end = wheel_plan.actions[-1].end
    robot = load_robot("nextage")
    holding = end.attached["support"].carrier
    empty = ({"left", "right"} - {holding}).pop()
    for arm, same in ((empty, True), (holding, False)):
        indices = robot.arms[arm].indices
        assert np.allclose(np.array(end.q)[indices], robot.home[indices], atol=1e-6) == same


def test_each_action_works_for_the_goal_but_the_way_home(wheel_plan):
    assert [action.goal for action in wheel_plan.actions[:-1]] == [0] * (len(wheel_plan.actions) - 1)
    assert wheel_plan.actions[-1].goal is None
    assert wheel_plan.actions[-1].kind == "transit"


def test_the_plan_has_all_that_made_it(wheel_plan, wheel_folder, wheel_task):
    assert wheel_plan.seed == 3
    assert task_of(wheel_plan.task) == wheel_task
    assert wheel_plan.folder == str(wheel_folder)
    assert set(wheel_plan.meshes) == {"table", "support", "wheel"}
    assert set(wheel_plan.seconds) == {"cell", "grasps", "regrasps and motions", "document", "verification"}
    assert all(seconds >= 0.0 for seconds in wheel_plan.seconds.values())


def test_the_plan_survives_its_file(wheel_plan, tmp_path):
    wheel_plan.save(tmp_path / "plan.json")
    assert Plan.load(tmp_path / "plan.json") == wheel_plan


@pytest.mark.slow
def test_every_mutation_of_it_is_caught(wheel_plan):
    for mutation, name in (ANYWHERE | TOGETHER).items():
        if mutation not in NOT_HERE:
            found = verify(mutation(wheel_plan))
            assert name in {fault.name for fault in found.faults}, mutation.__name__


@pytest.mark.slow
def test_the_same_seed_gives_the_same_plan_in_another_process(wheel_folder, tmp_path):
    code = "import sys, kumitate as km\nkm.plan(km.read_task(sys.argv[1]), sys.argv[2], seed=3).save(sys.argv[3])\n"
    plans = []
    for run in ("one", "two"):
        file = tmp_path / f"{run}.json"
        environment = {**os.environ, "KUMITATE_CACHE": str(tmp_path / run)}
        arguments = [str(wheel_folder / "task.yaml"), str(wheel_folder), str(file)]
        subprocess.run([sys.executable, "-c", code, *arguments], check=True, env=environment)
        plans.append(json.loads(file.read_bytes()))
        assert plans[-1].pop("seconds")
    assert plans[0] == plans[1]


@pytest.mark.slow
def test_another_seed_gives_another_plan(wheel_plan, wheel_task, wheel_folder):
    other = plan(wheel_task, wheel_folder, seed=4)
    assert [action.motion.positions for action in other.actions] != [a.motion.positions for a in wheel_plan.actions]
    assert verify(other).ok


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lying", "two_wheels", "two_wheels_lying"])
def test_the_other_examples_are_planned(name, wheel_folder):
    made = plan(read_task(wheel_folder / f"{name}.yaml"), wheel_folder, seed=1)
    assert verify(made).ok
    wheels = [part for part in made.task["parts"] if part != "support"]
    assert [made.actions[-1].end.attached[wheel].carrier for wheel in wheels] == ["support"] * len(wheels)


# Other goals ----------------------------------------------------------------------------------------------------------


def quick(task, *parts, goals, **changes):
    """A task with some of the parts, and fewer grasps of each."""
    coarse = {name: replace(task.parts[name], grasps=Grasping(t_rnn=0.01, n_da=4)) for name in parts}
    return replace(task, parts=coarse, goals=goals, **changes)


def test_a_tool_is_used_and_put_back(block_task, block_folder):
    down = (pi, 0.0, 0.0)
    press = Use("block", "foot", At((0.0, 0.1, 0.01), down), Insert((0.0, 0.0, -1.0), 0.03), of="table")
    goals = (Goal(use=press), Goal(place=Place("block", block_task.parts["block"].at)))
    task = quick(block_task, "block", goals=goals)
    tool = replace(task.parts["block"], frames={"foot": At((0.0, 0.0, -0.06), down)})
    made = plan(replace(task, parts={"block": tool}), block_folder, seed=1)
    assert verify(made).ok
    used = [action for action in made.actions if action.kind in ("press", "withdraw")]
    assert [(action.kind, action.goal) for action in used] == [("press", 0), ("withdraw", 0)]
    reached = np.array(used[0].end.poses["block"])
    np.testing.assert_allclose(pose_distance(reached, pose([0.4, 0.1, 0.01])), 0.0, atol=2e-4)
    assert made.actions[-1].end.attached == {}


def test_in_a_free_order_goals_come_so_that_all_are_reached_and_actions_tell_theirs(block_task, block_folder):
    """The left hand cannot put the peg elsewhere while it holds the block, which is asked for first."""
    goals = (
        Goal(hand_over=HandOver("block", "left", At((0.4, 0.1, 0.25), (-pi / 2, 0.0, 0.0)))),
        Goal(place=Place("peg", At((0.4, 0.5, -0.005)), arm="left")),
    )
    task = quick(block_task, "block", "peg", goals=goals)
    with pytest.raises(NoPlanError, match="goal 2 is not reached"):
        plan(task, block_folder, seed=1)
    made = plan(replace(task, order="free"), block_folder, seed=1)
    assert verify(made).ok
    first = [action.goal for action in made.actions].index(0)
    assert {action.goal for action in made.actions[:first]} == {1}
    assert {action.goal for action in made.actions[first:]} <= {0, None}
    assert made.actions[first - 1].end.attached == {}
    assert made.actions[-1].end.attached["block"].carrier == "left"


@pytest.mark.slow
def test_an_arm_makes_way_with_what_it_holds(block_task, block_folder):
    goals = (
        Goal(hand_over=HandOver("block", "left", At((0.4, 0.3, 0.075), (-pi / 2, 0.0, 0.0)))),
        Goal(place=Place("peg", At((0.4, 0.3, -0.005)), arm="right")),
    )
    made = plan(quick(block_task, "block", "peg", goals=goals), block_folder, seed=1)
    assert verify(made).ok
    second = [action.goal for action in made.actions].index(1)
    assert "makes way" in made.actions[second].words
    assert made.actions[second].arms == ("left",)
    assert made.actions[-1].end.attached["block"].carrier == "left"


def test_goals_that_are_reached_from_the_start_are_told(block_task, block_folder):
    goal = Goal(place=Place("block", area=Area("table")))
    with pytest.raises(InputError, match="goals: all are reached before anything moves"):
        plan(replace(block_task, goals=(goal,)), block_folder)


@pytest.mark.slow
def test_parts_go_into_an_area_side_by_side(block_task, block_folder):
    area = Area("table", ((0.3, 0.05), (0.45, 0.2)))
    goals = tuple(Goal(place=Place(part, area=area)) for part in ("peg", "tube", "block"))
    made = plan(quick(block_task, "block", "peg", "tube", goals=goals), block_folder, seed=1)
    assert verify(made).ok


# What is asked of it --------------------------------------------------------------------------------------------------


def test_progress_tells_the_stages_in_turn(wheel_task, wheel_folder):
    told: list[str] = []
    with pytest.raises(PlanningError):
        plan(replace(wheel_task, goals=_out_of_reach()), wheel_folder, progress=told.append)
    assert told[0] == "cell"
    assert "a way for wheel" in told


def test_a_time_limit_that_is_too_short_is_told(wheel_task, wheel_folder):
    with pytest.raises(TimeLimitError, match=r"1e-06 s was over while planning: cell") as caught:
        plan(wheel_task, wheel_folder, time_limit=1e-6)
    assert caught.value.seconds == 1e-6


def test_a_plan_that_fails_its_verification_is_no_plan(wheel_task, wheel_folder, monkeypatch):
    spoilt = Verification((Fault("collision", 0, 0.1, "table / wheel"),), 0.0, (), 1, 1, 0.1)
    monkeypatch.setattr("kumitate.tasks.planner.verify", lambda made: spoilt)
    put_aside = Goal(place=Place("wheel", At((0.4, 0.25, -0.05), (pi / 2, 0.0, 0.0))))
    with pytest.raises(UnverifiedError, match="does not pass its verification: table / wheel") as caught:
        plan(replace(wheel_task, goals=(put_aside,)), wheel_folder)
    assert caught.value.verification is spoilt


def test_a_task_that_is_not_sound_is_refused(wheel_task, wheel_folder):
    with pytest.raises(InputError, match="robot"):
        plan(replace(wheel_task, robot="nextagge"), wheel_folder)
    with pytest.raises(InputError, match="whel"):
        plan(with_attach(wheel_task, part="whel"), wheel_folder)


# Why there is none ----------------------------------------------------------------------------------------------------


def _out_of_reach():
    return (Goal(hand_over=HandOver("wheel", "left", At((0.4, 1.2, 0.3), (pi / 2, 0.0, 0.0)))),)


def test_a_pose_out_of_reach_is_named(wheel_task, wheel_folder):
    words = "goal 1 is not reached: no grasp of wheel works at its goal: no inverse kinematics"
    with pytest.raises(NoPlanError, match=words):
        plan(replace(wheel_task, goals=_out_of_reach()), wheel_folder)


def test_a_place_that_something_stands_on_is_named(wheel_task, wheel_folder):
    on_the_support = Goal(place=Place("wheel", At((0.4, -0.3, -0.05), (pi / 2, 0.0, 0.0))))
    with pytest.raises(NoPlanError, match="part against support"):
        plan(replace(wheel_task, goals=(on_the_support,)), wheel_folder)


def test_a_place_with_nothing_below_is_refused(wheel_task, wheel_folder):
    in_the_air = Goal(place=Place("wheel", At((0.4, 0.1, 0.2), (pi / 2, 0.0, 0.0))))
    with pytest.raises(InputError, match="nothing is below"):
        plan(replace(wheel_task, goals=(in_the_air,)), wheel_folder)


@pytest.mark.slow
def test_a_bore_that_does_not_fit_is_named(wheel_task, wheel_folder):
    beside = with_attach(wheel_task, at=At((0.0, 0.032, 0.016)))  # 6 mm beside the axle, with 0.97 mm of play
    with pytest.raises(NoPlanError) as caught:
        plan(beside, wheel_folder)
    assert "wheel against support" in _told(caught.value)


def test_an_assembly_pose_out_of_reach_is_named(wheel_task, wheel_folder):
    with pytest.raises(NoPlanError) as caught:
        plan(with_attach(wheel_task, where=At((2.0, 0.0, 0.3))), wheel_folder)
    assert "no inverse kinematics" in _told(caught.value)


def test_a_part_too_heavy_for_the_hand_is_named(wheel_task, wheel_folder):
    heavy = replace(wheel_task.parts["wheel"], mass=30.0)
    with pytest.raises(PlanningError) as caught:
        plan(replace(wheel_task, parts={**wheel_task.parts, "wheel": heavy}), wheel_folder)
    assert "has no grasp" in _told(caught.value)


def _told(error):
    return "\n".join([str(error), *error.report])
