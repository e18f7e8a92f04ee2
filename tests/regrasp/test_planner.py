"""Whole regrasps: solved by the means that are left, free of collision by the reference, the same again for a seed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from tabletops import Tabletop, robot_with_hands, tabletop
from witness import Witness, faults

from kumitate.errors import InputError, NoRegraspError, UnknownNameError
from kumitate.regrasp.graph import Held
from kumitate.regrasp.planner import Regrasp, plan_regrasp
from kumitate.regrasp.reach import Node
from kumitate.transforms import Array, pose_distance

Vector = tuple[float, float, float]
BOTH = ("left", "right")
UPRIGHT = (0.0, 0.0, 0.0)
OVER = (np.pi, 0.0, 0.0)  # upside down
ALONG = (np.pi / 2.0, 0.0, 0.0)  # a bar along y
BUDGET = 5.0  # s of processor time within which a problem without an answer is given up


@dataclass(frozen=True)
class Problem:
    """A part that stands at ``start`` and must stand at ``goal`` (xyz, rpy; z from the table's top)."""

    robot: str
    part: str
    start: tuple[Vector, Vector]
    goal: tuple[Vector, Vector]
    hands: tuple[str, ...] = BOTH
    supports: bool = True
    grasps: int = 200

    @property
    def table(self) -> Tabletop:
        return tabletop(self.robot, self.part)

    @property
    def ends(self) -> tuple[Array, Array]:
        return self.table.at(*self.start), self.table.at(*self.goal)

    def plan(self, seed: int = 0, **options) -> Regrasp:
        """The answer."""
        table, (start, goal) = self.table, self.ends
        grasps = table.grasps.thin(self.grasps)
        return plan_regrasp(
            table.scene,
            table.resting(start),
            table.part,
            dict.fromkeys(self.hands, grasps),
            [table.node("goal", goal)],
            [table.support] if self.supports else [],
            rests_on="table",
            seed=seed,
            **options,
        )

    def shared(self) -> dict[str, int]:
        """How many grasps each hand shares at start and goal."""
        table, grasps = self.table, self.table.grasps.thin(self.grasps)
        reacher, every = table.reacher(self.ends[0], grasps, self.hands), np.ones(self.grasps, dtype=bool)
        here, there = (table.node(name, at) for name, at in zip(("start", "goal"), self.ends, strict=True))
        both = {arm: [reacher.reach(n, arm, every).mask(self.grasps) for n in (here, there)] for arm in self.hands}
        assert all(any(masks[end].any() for masks in both.values()) for end in (0, 1))
        return {arm: int((a & b).sum()) for arm, (a, b) in both.items()}


FLIPS = {
    "one arm": Problem("nextage", "block", ((0.4, -0.2, 0.05), UPRIGHT), ((0.4, -0.35, 0.05), OVER), ("right",)),
    "the other": Problem("nextage", "block", ((0.4, 0.2, 0.05), UPRIGHT), ((0.4, 0.35, 0.05), OVER), ("left",)),
    "bracket": Problem("ur3_dual", "bracket", ((0.3, -0.2, 0.025), UPRIGHT), ((0.3, -0.3, 0.025), OVER), ("right",)),
}
HANDED = {
    "block": Problem("ur3_dual", "block", ((0.3, -0.2, 0.05), UPRIGHT), ((0.3, 0.2, 0.05), OVER), supports=False),
    "bracket": Problem("nextage", "bracket", ((0.4, -0.2, 0.025), UPRIGHT), ((0.4, 0.2, 0.025), OVER), supports=False),
    "bar": Problem("ur3_dual", "bar", ((0.3, -0.35, 0.01), ALONG), ((0.3, 0.35, 0.01), ALONG), supports=False),
    "bar, nextage": Problem("nextage", "bar", ((0.4, -0.4, 0.01), ALONG), ((0.4, 0.4, 0.01), ALONG), supports=False),
}


@cache
def solved(problem: Problem) -> Regrasp:
    return problem.plan()


@cache
def witness(robot: str, part: str) -> Witness:
    return Witness(tabletop(robot, part).scene)


def check(problem: Problem, found: Regrasp) -> None:
    """Everything that an answer promises."""
    table, (start, goal) = problem.table, problem.ends
    assert (
        faults(table.scene, table.resting(start), found.steps, problem.part, witness(problem.robot, problem.part)) == []
    )
    distance, angle = pose_distance(table.scene.world_from_body(found.state, problem.part), goal)
    assert distance < 1e-4
    assert angle < np.radians(0.1)
    assert found.state is found.steps[-1].end
    assert not found.state.attached
    assert [(c.first, c.second) for c in found.state.contacts] == [("table", problem.part)]
    assert found.steps[-1].kind == "retreat"
    assert tuple(link.arm for link in found.links) == found.route.arms
    taken = [step.arms[0] for step in found.steps if step.kind == "close"]
    assert taken == list(found.route.arms)
    grasps = table.grasps.thin(problem.grasps)
    for link, mask, step in zip(
        found.links, found.route.masks, [step for step in found.steps if step.kind == "close"], strict=True
    ):
        assert mask[link.grasp]
        assert step.grasp is not None
        np.testing.assert_array_equal(step.grasp.part_from_hand[0], grasps.part_from_hand[link.grasp])


slow = pytest.mark.slow


@pytest.mark.parametrize(
    "which", ["one arm", pytest.param("the other", marks=slow), pytest.param("bracket", marks=slow)]
)
def test_one_arm_turns_a_part_over_by_putting_it_down_between(which):
    problem = FLIPS[which]
    assert problem.shared() == dict.fromkeys(problem.hands, 0)
    found = solved(problem)
    assert found.route.regrasps >= 1
    assert all(node.support == "table" for node in found.route.nodes)
    assert set(found.route.arms) == set(problem.hands)
    check(problem, found)


@pytest.mark.parametrize("which", ["block", "bar", *(pytest.param(n, marks=slow) for n in ("bracket", "bar, nextage"))])
def test_without_a_support_a_part_goes_from_hand_to_hand(which):
    problem = HANDED[which]
    assert problem.shared() == {"left": 0, "right": 0}
    found = solved(problem)
    assert found.route.regrasps >= 1
    assert all(node.support is None for node in found.route.nodes[1:-1])
    assert found.route.arms[0] != found.route.arms[1]
    check(problem, found)


@slow
@pytest.mark.parametrize("which", ["bar", "bar, nextage"])
def test_with_a_support_a_bar_out_of_reach_is_put_down_or_handed_over(which):
    given = HANDED[which]
    problem = Problem(given.robot, given.part, given.start, given.goal)
    found = solved(problem)
    assert set(found.route.arms) == set(BOTH)
    check(problem, found)


@slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("which", ["block", "bracket"])
def test_with_a_thousand_grasps_and_other_seeds(which, seed):
    given = HANDED[which]
    problem = Problem(given.robot, given.part, given.start, given.goal, grasps=1000)
    check(problem, problem.plan(seed=seed))


# No answer


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (Problem("ur3_dual", "slab", ((0.3, -0.2, 0.05), UPRIGHT), ((0.3, 0.2, 0.05), UPRIGHT)), "hand too small"),
        (
            Problem("ur3_dual", "block", ((0.3, -0.2, 0.05), UPRIGHT), ((0.9, 0.2, 0.05), UPRIGHT)),
            "works at the goal: no inverse kinematics",
        ),
        (
            Problem("ur3_dual", "block", ((0.9, -0.2, 0.05), UPRIGHT), ((0.3, 0.2, 0.05), UPRIGHT)),
            "works where it is: no inverse kinematics",
        ),
        (
            Problem("nextage", "block", ((0.4, -0.2, 0.05), UPRIGHT), ((0.4, -0.35, 0.05), OVER), ("right",), False),
            "no support to put it down on, nor a second arm",
        ),
        (
            # A wheel lies on one side or the other, and a hand takes it from above.
            Problem(
                "ur3_dual", "wheel", ((0.3, -0.2, 0.01), UPRIGHT), ((0.3, -0.3, 0.01), OVER), ("right",), grasps=600
            ),
            "nor along any way over the placements",
        ),
        (
            Problem("ur3_dual", "block", ((0.3, -0.2, 0.05), UPRIGHT), ((0.3, 0.2, 0.03), UPRIGHT)),
            "works at the goal: part against table / block",
        ),
    ],
    ids=[
        "no grasp",
        "goal out of reach",
        "start out of reach",
        "no way between",
        "no placement helps",
        "goal in table",
    ],
)
def test_problems_without_an_answer_end_soon_and_name_the_cause(problem, words):
    robot_with_hands(problem.robot), problem.table.scene.checker(problem.table.resting(problem.ends[0]))
    before = time.process_time()
    with pytest.raises(NoRegraspError, match=words) as caught:
        problem.plan()
    assert time.process_time() - before < BUDGET
    assert caught.value.part == problem.part
    assert len(caught.value.report) >= 1


def test_only_the_arms_that_may_do_so_bring_the_part_to_the_goal():
    with pytest.raises(NoRegraspError, match="works at the goal"):
        HANDED["bar"].plan(arms=["right"])


def test_an_arm_that_does_not_exist_is_refused():
    problem = HANDED["block"]
    table = problem.table
    state, goal = table.resting(problem.ends[0]), table.node("goal", problem.ends[1])
    with pytest.raises(UnknownNameError, match="middle"):
        plan_regrasp(table.scene, state, table.part, {"middle": table.grasps}, [goal], rests_on="table")


def test_a_support_given_twice_is_refused():
    problem = FLIPS["one arm"]
    table, grasps = problem.table, problem.table.grasps.thin(50)
    start, goal = table.resting(problem.ends[0]), table.node("goal", problem.ends[1])
    twice = [table.support, table.support]
    with pytest.raises(InputError, match="same name"):
        plan_regrasp(table.scene, start, table.part, {"right": grasps}, [goal], twice, rests_on="table")


# The same again


def identical(a: Regrasp, b: Regrasp) -> bool:
    """Whether two answers are the same, bit for bit."""

    def content(found: Regrasp) -> list:
        return [
            (
                step.kind,
                step.arms,
                step.words,
                step.events,
                dict(step.openings),
                step.start.q.tobytes(),
                [
                    array.tobytes()
                    for array in (step.trajectory.times, step.trajectory.positions, step.trajectory.velocities)
                ],
                {name: at.tobytes() for name, at in step.end.poses.items()},
                None if step.grasp is None else step.grasp.part_from_hand.tobytes(),
            )
            for step in found.steps
        ]

    return content(a) == content(b)


def test_the_same_seed_gives_the_same_steps_bit_for_bit_and_another_does_not():
    problem = HANDED["block"]
    assert identical(solved(problem), problem.plan())
    assert not identical(solved(problem), problem.plan(seed=1))


# A part that is held already


def test_a_part_in_the_hand_is_put_down_from_where_it_is():
    problem = HANDED["block"]
    first = solved(problem)
    index = next(i for i, step in enumerate(first.steps) if step.kind == "transfer")
    state, link, table = first.steps[index].end, first.links[0], problem.table
    joints = state.q[table.robot.arms[link.arm].indices]
    grasps = table.grasps.thin(problem.grasps)
    found = plan_regrasp(
        table.scene,
        state,
        table.part,
        dict.fromkeys(BOTH, grasps),
        [table.node("goal", problem.ends[0])],
        held=Held(link.arm, link.grasp, joints),
        seed=1,
    )
    assert found.route.regrasps == 0
    assert [step.kind for step in found.steps] == ["transfer", "lower", "open", "retreat"]
    assert faults(table.scene, state, found.steps, problem.part, witness(problem.robot, problem.part)) == []


def test_a_part_is_brought_to_a_pose_in_the_air_and_held_there():
    problem = HANDED["block"]
    table = problem.table
    held = Node("held", table.at([0.3, -0.1, 0.3], [0.3, 0.2, 0.1]), None, to_leave=False)
    grasps = table.grasps.thin(problem.grasps)
    start = table.resting(problem.ends[0])
    found = plan_regrasp(
        table.scene, start, table.part, dict.fromkeys(BOTH, grasps), [held], rests_on="table", arms=["right"]
    )
    assert found.steps[-1].kind == "transfer"
    assert found.state.attached[problem.part].carrier == "right"
    distance, angle = pose_distance(table.scene.world_from_body(found.state, problem.part), held.world_from_part)
    assert distance < 1e-4
    assert angle < np.radians(0.1)
    assert faults(table.scene, start, found.steps, problem.part, witness(problem.robot, problem.part)) == []
