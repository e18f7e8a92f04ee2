"""Ways to miss the goals of a plan, and to misuse its tools."""

from __future__ import annotations

import numpy as np
from edits import kinds, taking, with_action, with_goal, with_sample
from msgspec.structs import replace

from kumitate.tasks.document import Plan
from kumitate.transforms import Array


def the_goal_turned(plan: Plan) -> Plan:
    number, kind = _last_goal(plan)
    at = plan.task["goals"][number][kind]["at"]
    roll, pitch, yaw = at.get("rpy", [0.0, 0.0, 0.0])
    return with_goal(plan, number, kind, at={**at, "rpy": [roll, pitch, yaw + 0.05]})


def goals_in_another_order(plan: Plan) -> Plan:
    return replace(plan, task={**plan.task, "goals": plan.task["goals"][::-1]})


def a_goal_undone(plan: Plan) -> Plan:
    """The part shall be where it was in the beginning, and was so for a while."""
    part = taking(plan)[1]
    goals = [{"place": {"part": part, "at": plan.task["parts"][part]["at"]}}]
    actions = tuple(replace(action, goal=None) for action in plan.actions)
    return replace(plan, task={**plan.task, "goals": goals}, actions=actions)


def the_other_hand_shall_be_interlocked(plan: Plan) -> Plan:
    """At a handover between hands of two fingers."""
    return with_goal(plan, _goal_of(plan, "hand_over"), "hand_over", interlocked=True)


def taken_from_the_table_not_from_a_hand(plan: Plan) -> Plan:
    """The giver shall be the one that was given the part hand in hand."""
    number = _goal_of(plan, "hand_over")
    giver = next(arm for arm in plan.task["hands"] if arm != plan.task["goals"][number]["hand_over"]["to"])
    return with_goal(plan, number, "hand_over", to=giver, interlocked=True)


def _goal_of(plan: Plan, kind: str) -> int:
    return next(k for k, goal in enumerate(plan.task["goals"]) if goal.get(kind))


def _last_goal(plan: Plan) -> tuple[int, str]:
    number = len(plan.task["goals"]) - 1
    return number, next(kind for kind, goal in plan.task["goals"][number].items() if goal)


def an_insertion_cut_short(plan: Plan) -> Plan:
    number = _goal_of(plan, "attach")
    insert = plan.task["goals"][number]["attach"]["insert"]
    return with_goal(plan, number, "attach", insert={**insert, "distance": insert["distance"] + 0.005})


def an_insertion_from_another_side(plan: Plan) -> Plan:
    number = _goal_of(plan, "attach")
    insert = plan.task["goals"][number]["attach"]["insert"]
    aside = [x + 0.02 for x in insert["direction"]]
    return with_goal(plan, number, "attach", insert={**insert, "direction": aside})


def the_way_home_left_out(plan: Plan) -> Plan:
    return replace(plan, actions=plan.actions[:-1])


def a_tool_tilted(plan: Plan) -> Plan:
    """By 3 degrees, and turning about its axis does not help."""
    goal = plan.task["goals"][_goal_of(plan, "use")]["use"]
    roll, pitch, yaw = goal["at"]["rpy"]
    return with_goal(
        plan,
        _goal_of(plan, "use"),
        "use",
        at={**goal["at"], "rpy": [roll + 0.05, pitch, yaw]},
        any_turn=[0.0, 0.0, 1.0],
    )


def a_tool_in_the_other_hand(plan: Plan) -> Plan:
    (arm,) = plan.actions[kinds(plan, "press")[0]].arms
    other = next(name for name in plan.task["hands"] if name != arm)
    return with_goal(plan, _goal_of(plan, "use"), "use", arm=other)


def a_press_for_no_goal(plan: Plan) -> Plan:
    return with_action(plan, kinds(plan, "press")[0], goal=None)


def a_press_cut_short(plan: Plan) -> Plan:
    number = _goal_of(plan, "use")
    approach = plan.task["goals"][number]["use"]["approach"]
    return with_goal(plan, number, "use", approach={**approach, "distance": approach["distance"] + 0.005})


def a_press_from_another_side(plan: Plan) -> Plan:
    number = _goal_of(plan, "use")
    approach = plan.task["goals"][number]["use"]["approach"]
    return with_goal(plan, number, "use", approach={**approach, "direction": [x + 0.02 for x in approach["direction"]]})


def a_crooked_withdrawal(plan: Plan) -> Plan:
    i = kinds(plan, "withdraw")[0]
    motion = plan.actions[i].motion
    middle = len(motion.times) // 2
    moving = np.ptp(np.array(motion.positions), axis=0) > 0.0
    return with_sample(plan, i, middle, positions=motion.positions[middle] + 2e-3 * moving)


def never_drawn_back(plan: Plan) -> Plan:
    return replace(plan, actions=plan.actions[: kinds(plan, "withdraw")[0]])


def drawn_back_by_a_transfer(plan: Plan) -> Plan:
    return with_action(plan, kinds(plan, "withdraw")[0], kind="transfer")


def pressed_too_deep(plan: Plan, by: float = 0.8e-3) -> Plan:
    """What the tool works on is nearer, by so much [m], and the goal in its frame farther."""
    number = _goal_of(plan, "use")
    goal = plan.task["goals"][number]["use"]
    way = by * np.array(goal["approach"]["direction"])
    cell = [
        {**entry, "at": _shifted(entry["at"], -way)} if entry["name"] == goal["of"] else entry
        for entry in plan.task["cell"]
    ]
    spoiled = with_goal(plan, number, "use", at=_shifted(goal["at"], way))
    return replace(spoiled, task={**spoiled.task, "cell": cell})


def pressed_against_what_it_is_not_used_on(plan: Plan) -> Plan:
    """The goal is in the world, and names nothing that the tool may touch."""
    number = _goal_of(plan, "use")
    goal = plan.task["goals"][number]["use"]
    there = next(entry["at"]["xyz"] for entry in plan.task["cell"] if entry["name"] == goal["of"])
    deeper = pressed_too_deep(plan, 0.2e-3)
    return with_goal(deeper, number, "use", of=None, at=_shifted(goal["at"], np.array(there)))


def _shifted(at: dict[str, list[float]], way: Array) -> dict[str, list[float]]:
    return {**at, "xyz": (np.array(at["xyz"]) + way).tolist()}
