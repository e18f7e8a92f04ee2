"""Orders in which goals are reached: one that works is found, nothing is tried twice, and all reasons are told."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from kumitate.errors import InputError, PlanningError, TimeLimitError
from kumitate.tasks.order import NoOrderError, in_some_order
from kumitate.tasks.planner import plan
from kumitate.tasks.reasons import NoPlanError
from kumitate.tasks.task import At, Goal, HandOver, Task
from kumitate.tasks.task_file import task_of
from kumitate.tasks.verify import verify
from kumitate.transforms import pose, pose_distance


class Done:
    """A job that only remembers which goals it has reached."""

    def __init__(self, possible: Callable[[list[int], int], bool]) -> None:
        self.reached: list[int] = []
        self.tried: list[tuple[int, ...]] = []
        self._possible = possible

    def mark(self) -> int:
        return len(self.reached)

    def back_to(self, mark: int) -> None:
        del self.reached[mark:]

    def reach(self, number: int, to_come: list[int]) -> None:
        """Reach a goal, or fail having done a part of it."""
        self.tried.append((*self.reached, number))
        assert sorted([*self.reached, number, *to_come]) == list(range(len(to_come) + len(self.reached) + 1))
        before = list(self.reached)
        self.reached.append(number)
        if not self._possible(before, number):
            raise PlanningError(f"not after {sorted(before)}")


def goals(n: int) -> list[Goal]:
    return [Goal(hand_over=HandOver(f"part {i}", "left", At())) for i in range(n)]


def drawn(seed: int) -> tuple[int, Callable[[list[int], int], bool]]:
    """Up to five goals, and whether one is possible after a set of others."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 6))
    table = {(frozenset(some), i): bool(rng.random() < 0.6)
             for k in range(n) for some in itertools.combinations(range(n), k) for i in range(n)}  # fmt: skip
    return n, lambda before, number: table[frozenset(before), number]


@settings(max_examples=200, deadline=None)
@given(st.integers(0, 10**6))
def test_the_first_order_that_works_is_found_if_there_is_one(seed):
    n, possible = drawn(seed)
    working = [
        order
        for order in itertools.permutations(range(n))
        if all(possible(list(order[:k]), number) for k, number in enumerate(order))
    ]
    job = Done(possible)
    if working:
        in_some_order(job, goals(n), job.reach)
        assert tuple(job.reached) == working[0]
    else:
        with pytest.raises(NoOrderError):
            in_some_order(job, goals(n), job.reach)
        assert job.reached == []
    # What can be done does not depend on the order before: no goal is tried twice once the same ones are reached.
    assert len({(frozenset(before), number) for *before, number in job.tried}) == len(job.tried)


def test_goals_come_as_they_are_given_where_that_works():
    job = Done(lambda before, number: True)
    in_some_order(job, goals(4), job.reach)
    assert job.reached == [0, 1, 2, 3]
    assert len(job.tried) == 4


def test_all_reasons_are_told_once():
    job = Done(lambda before, number: number == 1)
    with pytest.raises(NoOrderError, match="no order in which the goals can be reached: goal 3: not after") as caught:
        in_some_order(job, goals(3), job.reach)
    told = {f"goal {number + 1}: not after {before}" for number in (0, 2) for before in ([], [1])}
    assert set(caught.value.report) == told
    assert len(caught.value.report) == len(told)


def test_what_only_another_goal_makes_sound_is_no_mistake():
    """A part that shall stand on another one finds nothing there until that has come."""

    def reach(number: int, to_come: list[int]) -> None:
        if number == 0 and 1 in to_come:
            raise InputError("goal: place", "nothing is below it there", "give a pose")
        job.reached.append(number)

    job = Done(lambda before, number: True)
    in_some_order(job, goals(2), reach)
    assert job.reached == [1, 0]


def test_when_the_time_is_over_no_other_order_is_tried():
    tried = []

    def reach(number: int, to_come: list[int]) -> None:
        tried.append(number)
        raise TimeLimitError(1.0, "thinking")

    with pytest.raises(TimeLimitError):
        in_some_order(Done(lambda before, number: True), goals(3), reach)
    assert tried == [0]


# On a table -----------------------------------------------------------------------------------------------------------

TABLE = -0.05  # m
WALL = 0.06  # m
BOXES = {"bar": (0.15, 0.03, 0.04), "peg": (0.03, 0.03, 0.05), "base": (0.06, 0.06, 0.04), "post": (0.03, 0.03, 0.08)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("order")
    for name, sides in BOXES.items():
        trimesh.creation.box(sides).export(folder / f"{name}.stl")
    walls = [trimesh.creation.box([0.02, 0.1, WALL]).apply_translation([x, 0.0, WALL / 2.0]) for x in (-0.055, 0.055)]
    trimesh.util.concatenate(walls).export(folder / "walls.stl")
    return folder


def standing(name: str, y: float, under: float = TABLE) -> dict[str, list[float]]:
    """Where a box stands [m]."""
    return {"xyz": [0.4, y, under + BOXES[name][2] / 2.0]}


def task(at: dict[str, dict], wanted: dict[str, dict], cell=()) -> Task:
    """Boxes on a table, each to be placed, in any order; one arm and not too many grasps."""
    table = {"name": "table", "box": [0.3, 1.32, 0.02], "at": {"xyz": [0.4, 0.0, TABLE - 0.01]}, "support": True}
    part = {"unit": "m", "mass": 0.05, "grasps": {"t_rnn": 0.01, "n_da": 4}}
    return task_of(
        {
            "robot": "nextage",
            "hands": {"left": "robotiq_2f85"},
            "cell": [table, *cell],
            "parts": {name: {**part, "mesh": f"{name}.stl", "at": where} for name, where in at.items()},
            "goals": [{"place": {"part": name, "at": where}} for name, where in wanted.items()],
            "order": "free",
        }
    )


def assert_placed_in_order(made, order: list[str]) -> None:
    """That a plan is sound, and reaches its goals, which say where each part shall be, in an order."""
    assert verify(made).ok
    wanted = [goal["place"] for goal in made.task["goals"]]
    reached = dict.fromkeys(action.goal for action in made.actions if action.goal is not None)
    assert [wanted[number]["part"] for number in reached] == order
    for place in wanted:
        at = made.actions[-1].end.poses[place["part"]]
        np.testing.assert_allclose(pose_distance(np.array(at), pose(place["at"]["xyz"])), 0.0, atol=2e-4)


def test_what_bridges_over_a_pocket_comes_after_what_goes_into_it(folder):
    """The bar, listed first, lies across two walls in the end, the peg between them."""
    walls = {"name": "walls", "mesh": "walls.stl", "unit": "m", "at": {"xyz": [0.4, 0.25, TABLE]}, "support": True}
    at = {"bar": standing("bar", 0.45), "peg": standing("peg", 0.1)}
    wanted = {"bar": standing("bar", 0.25, TABLE + WALL), "peg": standing("peg", 0.25)}
    assert_placed_in_order(plan(task(at, wanted, [walls]), folder, seed=1), ["peg", "bar"])


@pytest.mark.slow
@pytest.mark.parametrize("listed", [["peg", "base"], ["base", "peg"]])
def test_what_stands_on_another_part_comes_after_it(folder, listed):
    at = {"base": standing("base", 0.45), "peg": standing("peg", 0.1)}
    wanted = {"base": standing("base", 0.25), "peg": standing("peg", 0.25, TABLE + BOXES["base"][2])}
    made = plan(task(at, {name: wanted[name] for name in listed}), folder, seed=1)
    assert_placed_in_order(made, ["base", "peg"])


@pytest.mark.slow
def test_what_stands_in_anothers_place_goes_first(folder):
    at = {"peg": standing("peg", 0.1), "base": standing("base", 0.25)}
    wanted = {"peg": standing("peg", 0.25), "base": standing("base", 0.45)}
    assert_placed_in_order(plan(task(at, wanted), folder, seed=1), ["base", "peg"])


@pytest.mark.slow
@pytest.mark.parametrize("listed", [["base", "peg", "post"], ["peg", "post", "base"]])
def test_a_part_is_not_held_back_for_what_another_one_blocks(folder, listed):
    """The peg's place is taken by the post, which goes onto the base; that does not keep the peg out."""
    at = {"base": standing("base", 0.45), "post": standing("post", 0.1), "peg": standing("peg", -0.05)}
    wanted = {
        "base": standing("base", 0.25),
        "post": standing("post", 0.25, TABLE + BOXES["base"][2]),
        "peg": standing("peg", 0.1),
    }
    made = plan(task(at, {name: wanted[name] for name in listed}), folder, seed=1)
    assert_placed_in_order(made, ["base", "post", "peg"])


@pytest.mark.slow
def test_a_part_is_asked_again_once_what_stood_in_its_way_is_gone(folder):
    """The bar goes onto the peg, but not as long as the post stands beside that."""
    at = {"peg": standing("peg", 0.1), "bar": standing("bar", 0.45), "post": standing("post", 0.25)}
    at["post"]["xyz"][0] += 0.05
    wanted = {
        "peg": standing("peg", 0.25),
        "bar": standing("bar", 0.25, TABLE + BOXES["peg"][2]),
        "post": standing("post", -0.05),
    }
    assert_placed_in_order(plan(task(at, wanted), folder, seed=1), ["peg", "post", "bar"])


def test_parts_for_one_place_keep_each_other_out(folder):
    at = {"peg": standing("peg", 0.1), "base": standing("base", 0.45)}
    with pytest.raises(NoPlanError, match="there is no order") as caught:
        plan(task(at, {"peg": standing("peg", 0.25), "base": standing("base", 0.26)}), folder)
    assert caught.value.report.notes == (
        "goal 1 in place keeps goal 2 from being reached",
        "goal 2 in place keeps goal 1 from being reached",
    )
