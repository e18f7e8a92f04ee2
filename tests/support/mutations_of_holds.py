"""Ways to spoil how hands and parts hold each other."""

from __future__ import annotations

import numpy as np
from edits import kinds, letting_go, moved, taking, with_action, with_motion, with_part, with_states
from msgspec.structs import replace

from kumitate.tasks.document import Action, Event, Plan, matrix
from kumitate.transforms import pose


def a_hand_that_closes_beside(plan: Plan) -> Plan:
    i, part, _ = taking(plan)
    entry = plan.task["parts"][part]["at"]
    x, y, z = entry["xyz"]
    spoiled = with_part(plan, part, at={**entry, "xyz": [x, y + 0.06, z]})
    shift = pose([0.0, 0.06, 0.0])
    return with_states(spoiled, 0, lambda s: replace(s, poses={**s.poses, part: moved(s.poses[part], shift)}), i)


def a_loose_grip(plan: Plan, wider: float = 4e-3) -> Plan:
    """The hand closes less, and whatever tells its opening says so."""
    i, _, arm = taking(plan)
    end = next(
        (k for k in kinds(plan, "open") if k > i and any(e.carrier == arm for e in plan.actions[k].events)),
        len(plan.actions) - 1,
    )
    held = plan.actions[i].end.openings[arm]
    actions = list(plan.actions)

    def widened(opening: float) -> float:
        return opening + wider if abs(opening - held) < 1e-9 else opening

    for k in range(i, end + 1):
        action = actions[k]
        openings = {a: tuple(map(widened, row)) if a == arm else row for a, row in action.motion.openings.items()}
        states = {
            name: replace(state, openings={**state.openings, arm: widened(state.openings[arm])})
            for name, state in (("start", action.start), ("end", action.end))
        }
        grasp = action.grasp and replace(action.grasp, opening=widened(action.grasp.opening))
        actions[k] = replace(action, motion=replace(action.motion, openings=openings), grasp=grasp, **states)
    return replace(plan, actions=tuple(actions))


def an_opening_wider_than_the_part(plan: Plan) -> Plan:
    return a_loose_grip(plan, 0.03)


def another_grasp(plan: Plan) -> Plan:
    i = taking(plan)[0]
    grasp = plan.actions[i].grasp
    turned = matrix(np.array(grasp.part_from_hand) @ pose(rpy=[0.0, 0.02, 0.0]))
    return with_action(plan, i, grasp=replace(grasp, part_from_hand=turned))


def another_grasp_on_the_way(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    grasp = plan.actions[i].grasp
    aside = matrix(pose([0.0, 0.0, 0.01]) @ grasp.part_from_hand)
    return with_action(plan, i, grasp=replace(grasp, part_from_hand=aside))


def no_grasp(plan: Plan) -> Plan:
    return with_action(plan, taking(plan)[0], grasp=None)


def taken_twice(plan: Plan) -> Plan:
    i = taking(plan)[0]
    return with_action(plan, i, events=plan.actions[i].events * 2)


def a_hand_where_none_may_be(plan: Plan) -> Plan:
    """Around one of the pads, or the lip."""
    i, part, _ = taking(plan)
    region = {"box": [0.002, 0.002, 0.002], "at": {"xyz": list(plan.actions[i].grasp.contacts[0])}}
    return with_part(plan, part, no_touch=[region])


def let_go_before_it_is_taken(plan: Plan) -> Plan:
    i, part, arm = taking(plan)
    return with_action(plan, i, events=(Event(0.0, "detach", part, arm), *plan.actions[i].events))


def taken_on_the_way(plan: Plan) -> Plan:
    return with_action(plan, taking(plan)[0], kind="approach")


def joints_move_while_a_hand_closes(plan: Plan) -> Plan:
    return with_action(plan, kinds(plan, "approach")[0], kind="close")


def a_grip_that_loosens(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    (arm,) = plan.actions[i].arms
    motion = plan.actions[i].motion
    row = list(motion.openings[arm])
    row[1] += 1e-3
    return with_motion(plan, i, openings={**motion.openings, arm: tuple(row)})


def a_detach_dropped(plan: Plan) -> Plan:
    return with_action(plan, letting_go(plan)[0], events=())


def let_go_after_the_retreat(plan: Plan) -> Plan:
    """At a handover: the giver keeps holding while it retreats."""
    i = handing_over(plan)
    late = replace(plan.actions[i].events[0], time=plan.actions[i + 1].motion.duration)
    return with_action(with_action(plan, i, events=()), i + 1, events=(late,))


def handing_over(plan: Plan) -> int:
    """The action in which a hand lets a part go that another hand holds."""
    for i in kinds(plan, "open"):
        for event in plan.actions[i].events:
            carried = plan.actions[i].end.attached.get(event.part)
            if carried is not None and carried.carrier in plan.task["hands"]:
                return i
    raise AssertionError("no part is handed over")


def joined_without_a_goal(plan: Plan) -> Plan:
    """A part is attached to one that stands there, though no goal says so."""
    one, other = list(plan.task["parts"])[:2]
    here = kinds(plan, "transit")[0]
    return with_action(plan, here, kind="insert", events=(Event(0.0, "attach", one, other),))


def an_attached_part_left_behind(plan: Plan) -> Plan:
    """What was joined stays where it was while the other part is carried on."""
    i, part = joining(plan)
    carried = next((k for k in kinds(plan, "transfer") if k > i), i)
    stays = plan.actions[carried].start.poses[part]
    return with_states(plan, carried, lambda state: replace(state, poses={**state.poses, part: stays}))


def joining(plan: Plan) -> tuple[int, str]:
    """The action in which a part is attached to another, and the part."""
    for i in kinds(plan, "insert"):
        for event in plan.actions[i].events:
            return i, event.part
    raise AssertionError("no parts are joined")


def left_and_right_swapped(plan: Plan) -> Plan:
    other = {"left": "right", "right": "left"}

    def swapped(action: Action) -> Action:
        events = tuple(replace(event, carrier=other.get(event.carrier, event.carrier)) for event in action.events)
        return replace(action, arms=tuple(other[arm] for arm in action.arms), events=events)

    return replace(plan, actions=tuple(map(swapped, plan.actions)))


def a_carrier_untold(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    return with_states(plan, i, lambda state: replace(state, attached={}), i)


def a_carried_part_slips(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    part, shift = plan.actions[i].part, pose([0.0, 0.0, 1e-3])
    return with_states(plan, i, lambda s: replace(s, poses={**s.poses, part: moved(s.poses[part], shift)}), i)


def a_standing_part_moves(plan: Plan) -> Plan:
    i, part, _ = letting_go(plan)
    shift = pose([0.0, 0.0, 0.0], [0.0, 0.0, 0.01])
    return with_states(plan, i, lambda s: replace(s, poses={**s.poses, part: moved(s.poses[part], shift)}), i + 1)
