"""Goals, and what they pin: the arms, the place, whether the assembly is held in the end."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from edits import with_action, with_goal
from goal_faults import goal_faults
from msgspec.structs import replace
from mutations_of_holds import joining
from plans import sample_plan, short_plan, standing_plan

from kumitate.tasks.document import Mesh, Plan
from kumitate.tasks.verify import verify
from kumitate.tasks.verify_faults import Fault
from kumitate.transforms import Array, pose

HAND_OVER, PLACE, ATTACH = 0, 1, 2


def faults(number: int, kind: str, **changes: object) -> tuple[Fault, ...]:
    return goal_faults(with_goal(sample_plan(), number, kind, **changes))


def where_joined(shift: float) -> dict[str, list[float]]:
    """Where the tube is when the peg comes, in the world."""
    at = np.array(sample_plan().actions[joining(sample_plan())[0]].end.poses["tube"])
    return {"xyz": (at[:3, 3] + [shift, 0.0, 0.0]).tolist(), "rpy": [np.pi / 2, 0.0, 0.0]}


@pytest.mark.parametrize(
    ("number", "kind", "changes", "found"),
    [
        (ATTACH, "attach", {"arm": "left", "to_arm": "right", "where": where_joined, "shift": 0.0}, set()),
        (ATTACH, "attach", {"where": where_joined, "shift": 1e-3}, {"insertion"}),
        (ATTACH, "attach", {"arm": "right"}, {"insertion"}),
        (ATTACH, "attach", {"to_arm": "left"}, {"insertion"}),
        (ATTACH, "attach", {"then": "place"}, {"goal"}),
        (PLACE, "place", {"arm": "right"}, set()),
        (PLACE, "place", {"arm": "left"}, {"goal"}),
        (HAND_OVER, "hand_over", {"at": {"xyz": [0.4, 0.0, 0.251], "rpy": [-np.pi / 2, 0.0, 0.0]}}, {"goal"}),
    ],
)
def test_a_goal_is_reached_as_it_is_written(number, kind, changes, found):
    changes = dict(changes)
    if "where" in changes:
        changes["where"] = where_joined(changes.pop("shift"))
    assert {fault.name for fault in faults(number, kind, **changes)} == found


def test_faults_of_goals_name_the_action_that_should_have_reached_them():
    at = {"xyz": [0.35, -0.35, 0.02], "rpy": [np.pi, 0.0, 0.0]}
    (fault,) = faults(PLACE, "place", at=at)
    assert fault.action == max(i for i, action in enumerate(sample_plan().actions) if action.goal == PLACE)
    assert fault.bodies == ("block",)
    assert "10.000 mm" in fault.words


def test_what_is_joined_where_it_stands_need_not_be_held():
    """The goal says hold, but no hand held the tube when the peg came, and none need hold it now."""
    assert standing_plan().task["goals"][0]["attach"].get("then", "hold") == "hold"
    assert verify(standing_plan()).faults == ()
    assert goal_faults(with_goal(standing_plan(), 0, "attach", then="place")) == ()
    (fault,) = goal_faults(with_goal(sample_plan(), ATTACH, "attach", then="place"))
    assert "held by right" in fault.words


def at(where: Array) -> dict[str, list[float]]:
    return {"xyz": where[:3, 3].tolist(), "rpy": list(trimesh.transformations.euler_from_matrix(where, "sxyz"))}


@pytest.mark.parametrize(
    ("axis", "turn", "found"),
    [
        (None, [0.0, 0.0, 0.0], set()),
        (None, [0.0, 0.0, 1.0], {"goal"}),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0], set()),
        ([0.0, 0.0, -3.0], [0.0, 0.0, np.pi], set()),
        ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], {"goal"}),
        ([1.0, 0.0, 0.0], [-2.0, 0.0, 0.0], set()),
        ([0.0, 0.0, 1.0], [0.003, 0.0, 0.0], {"goal"}),
    ],
)
@pytest.mark.parametrize(("number", "kind"), [(HAND_OVER, "hand_over"), (PLACE, "place")])
def test_a_part_may_be_turned_about_its_free_axis(number, kind, axis, turn, found):
    given = sample_plan().task["goals"][number][kind]["at"]
    turned = at(pose(given["xyz"], given["rpy"]) @ pose(rpy=turn))
    assert {fault.name for fault in faults(number, kind, at=turned, any_turn=axis)} == found


def in_area(**area: object) -> tuple[Fault, ...]:
    """The block of 30 by 30 by 120 mm ends upright, its middle at (0.35, 0.35)."""
    return goal_faults(with_goal(short_plan(), 0, "place", at=None, area={"on": "table", **area}))


@pytest.mark.parametrize(
    ("area", "missed"),
    [
        ({}, ""),
        ({"corners": [[0.335, 0.335], [0.365, 0.365]]}, ""),
        ({"corners": [[0.5, 0.3], [0.3, 0.365]]}, ""),  # any two opposite corners
        ({"corners": [[0.3, 0.3], [0.3648, 0.4]]}, "0.20 mm out"),
        ({"corners": [[0.3, 0.3363], [0.4, 0.4]]}, "1.30 mm out"),
        ({"up": [0.0, 0.0, 2.0]}, ""),
        ({"up": [0.0, 0.017, 1.0]}, ""),
        ({"up": [0.0, 0.019, 1.0]}, "1.09 deg"),
        ({"up": [0.0, 0.0, -1.0]}, "180.00 deg"),
    ],
)
def test_a_part_lies_in_an_area_as_that_asks(area, missed):
    found = in_area(**area)
    assert [fault.name for fault in found] == (["goal"] if missed else [])
    assert all(missed in fault.words for fault in found)


@pytest.mark.parametrize(("drop", "missed"), [(0.0, False), (0.9e-3, False), (1.1e-3, True)])
def test_a_part_lies_on_the_obstacle_of_its_area(drop, missed):
    plan = with_goal(short_plan(), 0, "place", at=None, area={"on": "slab"})
    slab = {"name": "slab", "box": [0.1, 0.1, 0.02], "at": {"xyz": [0.35, 0.35, -0.06 - drop]}, "support": True}
    meshes = {**plan.meshes, "slab": Mesh.of(trimesh.creation.box(slab["box"]))}
    found = goal_faults(replace(plan, task={**plan.task, "cell": [*plan.task["cell"], slab]}, meshes=meshes))
    assert [fault.name for fault in found] == (["goal"] if missed else [])
    assert all("does not lie on slab" in fault.words for fault in found)


def test_without_corners_a_part_stays_above_the_obstacle_of_its_area():
    plan = with_goal(short_plan(), 0, "place", at=None, area={"on": "post"})
    post = {"name": "post", "box": [0.02, 0.02, 0.02], "at": {"xyz": [0.35, 0.35, -0.06]}, "support": True}
    meshes = {**plan.meshes, "post": Mesh.of(trimesh.creation.box(post["box"]))}
    (fault,) = goal_faults(replace(plan, task={**plan.task, "cell": [*plan.task["cell"], post]}, meshes=meshes))
    assert "5.00 mm out of its area" in fault.words


def test_all_that_is_joined_to_a_part_lies_in_its_area():
    """The peg's goal is an area that it lies in, but not the tube around it."""
    place = {"place": {"part": "peg", "area": {"on": "table"}}}
    peg, tube = ([[0.35 - r, 0.2 - r], [0.35 + r, 0.2 + r]] for r in (0.01, 0.026))
    for corners, found in ((peg, ["goal"]), (tube, [])):
        place["place"]["area"]["corners"] = corners
        plan = standing_plan()
        joined = replace(plan, task={**plan.task, "goals": [*plan.task["goals"], place]})
        assert [fault.name for fault in goal_faults(joined)] == found


def test_what_a_hand_holds_lies_in_no_area():
    place = {"place": {"part": "tube", "area": {"on": "table"}}}
    plan = sample_plan()
    (fault,) = goal_faults(replace(plan, task={**plan.task, "goals": [*plan.task["goals"], place]}))
    assert "held by right" in fault.words


def in_free_order(order: list[int]) -> Plan:
    """The sample plan with its goals given in another order."""
    plan = sample_plan()
    task = {**plan.task, "goals": [plan.task["goals"][number] for number in order], "order": "free"}
    actions = (replace(a, goal=a.goal if a.goal is None else order.index(a.goal)) for a in plan.actions)
    return replace(plan, task=task, actions=tuple(actions))


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 1, 0], [1, 0, 2]])
def test_goals_without_an_order_are_reached_in_any(order):
    assert goal_faults(in_free_order(order)) == ()


def test_goals_with_an_order_are_not():
    fixed = in_free_order([2, 1, 0])
    found = goal_faults(replace(fixed, task={**fixed.task, "order": "fixed"}))
    assert {fault.name for fault in found} == {"goal"}


def test_without_an_order_a_goal_is_reached_by_actions_of_its_own():
    plan = in_free_order([0, 1, 2])
    last = max(i for i, action in enumerate(plan.actions) if action.goal == PLACE)
    for i, action in enumerate(plan.actions):
        if action.goal == PLACE and i > last - 2:
            plan = with_action(plan, i, goal=ATTACH)
    (fault,) = goal_faults(plan)
    assert "goal 1 is not reached" in fault.words


def test_a_goal_reached_from_the_start_needs_no_action_of_its_own():
    plan = in_free_order([0, 1, 2])
    there = {"place": {"part": "tube", "at": plan.task["parts"]["tube"]["at"]}}
    assert goal_faults(replace(plan, task={**plan.task, "goals": [*plan.task["goals"], there]})) == ()


def test_without_an_order_a_goal_may_be_undone_only_for_one_reached_later():
    plan = in_free_order([0, 1, 2])
    start = {"place": {"part": "block", "at": plan.task["parts"]["block"]["at"]}}
    goals = [*plan.task["goals"], start]
    assert goal_faults(replace(plan, task={**plan.task, "goals": goals})) == ()
    plan = short_plan()
    alone = replace(plan, task={**plan.task, "goals": [start], "order": "free"})
    (fault,) = goal_faults(replace(alone, actions=tuple(replace(action, goal=None) for action in plan.actions)))
    assert "undone at the end" in fault.words
