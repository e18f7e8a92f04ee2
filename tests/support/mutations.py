"""Ways to spoil a plan, each with the fault that must be found then.

Every mutation is a function of a valid plan; it looks for an action that it can spoil, so that it works on other plans.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
import trimesh
from msgspec.structs import replace

from kumitate.tasks.document import Action, Event, Mesh, Motion, Plan, State, matrix
from kumitate.transforms import Array, pose

Mutation = Callable[[Plan], Plan]


# Tools ----------------------------------------------------------------------------------------------------------------


def kinds(plan: Plan, *wanted: str) -> list[int]:
    """Numbers of the actions of these kinds."""
    return [i for i, action in enumerate(plan.actions) if action.kind in wanted]


def with_action(plan: Plan, i: int, **changes: object) -> Plan:
    return replace(plan, actions=(*plan.actions[:i], replace(plan.actions[i], **changes), *plan.actions[i + 1 :]))


def with_motion(plan: Plan, i: int, **changes: object) -> Plan:
    return with_action(plan, i, motion=replace(plan.actions[i].motion, **changes))


def with_sample(plan: Plan, i: int, at: int, **row: Iterable[float]) -> Plan:
    """Another row of positions or velocities in action ``i``."""
    changes = {}
    for name, values in row.items():
        rows = list(getattr(plan.actions[i].motion, name))
        rows[at] = tuple(float(x) for x in values)
        changes[name] = tuple(rows)
    return with_motion(plan, i, **changes)


def with_part(plan: Plan, part: str, **changes: object) -> Plan:
    entry = {**plan.task["parts"][part], **changes}
    return replace(plan, task={**plan.task, "parts": {**plan.task["parts"], part: entry}})


def with_goal(plan: Plan, number: int, kind: str, **changes: object) -> Plan:
    goals = list(plan.task["goals"])
    goals[number] = {kind: {**goals[number][kind], **changes}}
    return replace(plan, task={**plan.task, "goals": goals})


def with_states(plan: Plan, first: int, change: Callable[[State], State], last: int | None = None) -> Plan:
    """Other states from the end of action ``first`` to the start of the one after ``last``."""
    actions = list(plan.actions)
    end = len(actions) if last is None else last + 1
    for i in range(first, end):
        start = actions[i].start if i == first else change(actions[i].start)
        actions[i] = replace(actions[i], start=start, end=change(actions[i].end))
    if end < len(actions):
        actions[end] = replace(actions[end], start=change(actions[end].start))
    return replace(plan, actions=tuple(actions))


def faster(motion: Motion, factor: float) -> Motion:
    """The same curve in a fraction of the time."""
    times = tuple(time / factor for time in motion.times)
    velocities = tuple(tuple(factor * v for v in row) for row in motion.velocities)
    rates = {arm: tuple(factor * v for v in row) for arm, row in motion.opening_velocities.items()}
    return replace(motion, times=times, velocities=velocities, opening_velocities=rates)


def detour(motion: Motion, q: Array) -> Motion:
    """Before the motion one to ``q`` and back, at ease."""
    start, still = motion.positions[0], (0.0,) * len(motion.positions[0])
    times = (0.0, 3.0, *(6.0 + time for time in motion.times))
    return Motion(
        times=times,
        positions=(start, tuple(q.tolist()), *motion.positions),
        velocities=(still, still, *motion.velocities),
        openings={arm: (row[0], row[0], *row) for arm, row in motion.openings.items()},
        opening_velocities={arm: (0.0, 0.0, *row) for arm, row in motion.opening_velocities.items()},
    )


def beyond(plan: Plan, i: int, share: float) -> Plan:
    """Action ``i``, but first a part of its way in the opposite direction and back."""
    motion = plan.actions[i].motion
    start, end = np.array(motion.positions[0]), np.array(motion.positions[-1])
    events = tuple(replace(event, time=event.time + 6.0) for event in plan.actions[i].events)
    return with_action(plan, i, motion=detour(motion, start - share * (end - start)), events=events)


def moved(where: object, shift: Array) -> object:
    return matrix(shift @ np.array(where))


def taking(plan: Plan) -> tuple[int, str, str]:
    """The first action in which a hand takes a part, the part and the arm."""
    for i in kinds(plan, "close"):
        for event in plan.actions[i].events:
            return i, event.part, event.carrier
    raise AssertionError("no hand takes a part")


def letting_go(plan: Plan) -> tuple[int, str, str]:
    """The last action in which a hand lets a part go that stands then, the part and the arm."""
    for i in reversed(kinds(plan, "open")):
        for event in plan.actions[i].events:
            if event.part not in plan.actions[i].end.attached:
                return i, event.part, event.carrier
    raise AssertionError("no hand puts a part down")


# The document ---------------------------------------------------------------------------------------------------------


def other_format(plan: Plan) -> Plan:
    return replace(plan, format=99)


def no_action(plan: Plan) -> Plan:
    return replace(plan, actions=())


def a_number_that_is_none(plan: Plan) -> Plan:
    return with_sample(plan, 1, 1, positions=[np.nan, *plan.actions[1].motion.positions[1][1:]])


def a_row_too_short(plan: Plan) -> Plan:
    return with_sample(plan, 1, 0, velocities=plan.actions[1].motion.velocities[0][1:])


def openings_too_few(plan: Plan) -> Plan:
    return with_motion(plan, 0, openings={arm: row[:-1] for arm, row in plan.actions[0].motion.openings.items()})


def a_pose_that_is_none(plan: Plan) -> Plan:
    part = next(iter(plan.actions[0].end.poses))
    return with_states(
        plan, 0, lambda state: replace(state, poses={**state.poses, part: matrix(2.0 * np.array(state.poses[part]))}), 0
    )


def an_unknown_carrier(plan: Plan) -> Plan:
    i, part, _ = taking(plan)
    return with_action(plan, i, events=(Event(0.0, "attach", part, "third hand"),))


def an_arm_named_twice(plan: Plan) -> Plan:
    return with_action(plan, 0, arms=2 * plan.actions[0].arms)


def an_unknown_goal(plan: Plan) -> Plan:
    return with_action(plan, 0, goal=len(plan.task["goals"]))


def time_stands_still(plan: Plan) -> Plan:
    times = plan.actions[1].motion.times
    return with_motion(plan, 1, times=(times[0], times[0], *times[2:]))


def an_event_after_the_end(plan: Plan) -> Plan:
    i = taking(plan)[0]
    late = replace(plan.actions[i].events[0], time=plan.actions[i].motion.duration + 1.0)
    return with_action(plan, i, events=(late,))


def a_joint_too_few(plan: Plan) -> Plan:
    return replace(plan, joints=plan.joints[1:])


def a_mesh_cut_off(plan: Plan) -> Plan:
    name, mesh = next(iter(plan.meshes.items()))
    return replace(plan, meshes={**plan.meshes, name: replace(mesh, faces=mesh.faces[:-7])})


def an_obstacle_unlike_its_box(plan: Plan) -> Plan:
    name = plan.task["cell"][0]["name"]
    smaller = plan.meshes[name].trimesh().apply_scale(0.9)
    return replace(plan, meshes={**plan.meshes, name: Mesh.of(smaller)})


def another_robot_file(plan: Plan) -> Plan:
    return replace(plan, digests=dict.fromkeys(plan.digests, "0" * 64))


# Motions --------------------------------------------------------------------------------------------------------------


def joints_permuted(plan: Plan) -> Plan:
    return replace(plan, joints=plan.joints[::-1])


def another_start(plan: Plan) -> Plan:
    joint = plan.joints[plan.actions[0].motion.positions[0].index(max(plan.actions[0].motion.positions[0]))]
    return replace(plan, task={**plan.task, "start": {joint: 0.1}})


def actions_swapped(plan: Plan) -> Plan:
    actions = list(plan.actions)
    actions[1], actions[2] = actions[2], actions[1]
    return replace(plan, actions=tuple(actions))


def a_start_that_jumps(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    start = plan.actions[i].start
    return with_action(plan, i, start=replace(start, q=tuple(x + 0.01 for x in start.q)))


def a_motion_from_elsewhere(plan: Plan) -> Plan:
    i = kinds(plan, "approach")[0]
    first = plan.actions[i].motion.positions[0]
    return with_sample(plan, i, 0, positions=[first[0] + 1e-3, *first[1:]])


def a_flying_start(plan: Plan) -> Plan:
    i = kinds(plan, "retreat")[0]
    return with_sample(plan, i, -1, velocities=[0.0] * 4 + [0.05] + [0.0] * (len(plan.joints) - 5))


def an_idle_joint_moves(plan: Plan) -> Plan:
    i = kinds(plan, "transit")[0]
    motion = plan.actions[i].motion
    column = int(np.flatnonzero(np.ptp(np.array(motion.positions), axis=0) == 0.0)[0])
    row = list(motion.positions[1])
    row[column] += 0.02
    return with_sample(plan, i, 1, positions=row)


def a_joint_beyond_its_limit(plan: Plan) -> Plan:
    i = kinds(plan, "transit")[0]
    motion = plan.actions[i].motion
    q = np.array(motion.positions[0])
    q[int(np.argmax(np.ptp(np.array(motion.positions), axis=0)))] += 3.5
    return with_motion(plan, i, **_fields(faster(detour(motion, q), 0.2)))


def a_joint_beyond_all_numbers(plan: Plan) -> Plan:
    """So far that it cannot be reckoned with: differences overflow."""
    i = kinds(plan, "transit")[0]
    motion = plan.actions[i].motion
    row = list(motion.positions[1])
    row[int(np.argmax(np.ptp(np.array(motion.positions), axis=0)))] = 1e308
    return with_sample(plan, i, 1, positions=row)


def too_fast(plan: Plan) -> Plan:
    i = kinds(plan, "transfer")[0]
    return with_motion(plan, i, **_fields(faster(plan.actions[i].motion, 4.0)))


def too_hard(plan: Plan) -> Plan:
    i = kinds(plan, "approach")[0]
    motion = plan.actions[i].motion
    middle = len(motion.times) // 2
    return with_sample(plan, i, middle, velocities=-np.array(motion.velocities[middle]))


def fingers_too_fast(plan: Plan) -> Plan:
    i = taking(plan)[0]
    motion = faster(plan.actions[i].motion, 2.0)
    events = tuple(replace(event, time=event.time / 2.0) for event in plan.actions[i].events)
    return with_action(plan, i, motion=motion, events=events)


def fingers_too_wide(plan: Plan) -> Plan:
    i, _, arm = taking(plan)
    rates = plan.actions[i].motion.opening_velocities
    return with_motion(plan, i, opening_velocities={**rates, arm: (0.01, *rates[arm][1:])})


def _fields(motion: Motion) -> dict[str, object]:
    return {name: getattr(motion, name) for name in motion.__struct_fields__}


# Carrying -------------------------------------------------------------------------------------------------------------


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


# Collisions -----------------------------------------------------------------------------------------------------------


def a_waypoint_in_the_table(plan: Plan) -> Plan:
    """The part goes back up after it was lowered, but first farther down."""
    i = kinds(plan, "lift")[0]
    return beyond(plan, i, 0.3)


def a_retreat_through_the_part(plan: Plan) -> Plan:
    return beyond(plan, kinds(plan, "retreat")[0], 0.8)


def a_bigger_part(plan: Plan) -> Plan:
    part = taking(plan)[1]
    bigger = plan.meshes[part].trimesh().apply_scale(1.1)
    return replace(plan, meshes={**plan.meshes, part: Mesh.of(bigger, plan.meshes[part].digest)})


def an_obstacle_in_the_way(plan: Plan) -> Plan:
    """A speck where a carried part ends up."""
    i = kinds(plan, "transfer")[0]
    part = plan.actions[i].part
    state = plan.actions[i].end
    place = np.array(state.poses[part])[:3, 3]
    entry = {"name": "speck", "box": [0.004, 0.004, 0.004], "at": {"xyz": place.tolist()}, "support": False}
    task = {**plan.task, "cell": [*plan.task["cell"], entry]}
    return replace(plan, task=task, meshes={**plan.meshes, "speck": Mesh.of(trimesh.creation.box(entry["box"]))})


def a_speck_inside_a_part(plan: Plan) -> Plan:
    """An obstacle that lies wholly in a part from the start, so that no surfaces meet."""
    entry = next(iter(plan.task["parts"].values()))
    speck = {"name": "speck", "box": [0.004, 0.004, 0.004], "at": entry["at"]}
    last = plan.actions[-1]
    still = replace(
        last,
        start=plan.actions[0].start,
        end=plan.actions[0].start,
        motion=replace(
            last.motion,
            times=(0.0,),
            positions=last.motion.positions[:1],
            velocities=last.motion.velocities[:1],
            openings={arm: row[:1] for arm, row in last.motion.openings.items()},
            opening_velocities={arm: row[:1] for arm, row in last.motion.opening_velocities.items()},
        ),
    )
    task = {**plan.task, "cell": [*plan.task["cell"], speck]}
    meshes = {**plan.meshes, "speck": Mesh.of(trimesh.creation.box(speck["box"]))}
    return replace(plan, task=task, meshes=meshes, actions=(still,))


# Resting --------------------------------------------------------------------------------------------------------------


def a_support_removed(plan: Plan) -> Plan:
    table = next(entry["name"] for entry in plan.task["cell"] if entry.get("support"))
    cell = [entry for entry in plan.task["cell"] if entry["name"] != table]
    meshes = {name: mesh for name, mesh in plan.meshes.items() if name != table}
    return replace(plan, task={**plan.task, "cell": cell}, meshes=meshes)


def no_support(plan: Plan) -> Plan:
    """The table is there, but not to put things on."""
    cell = [{**entry, "support": False} for entry in plan.task["cell"]]
    return replace(plan, task={**plan.task, "cell": cell})


def a_lower_table(plan: Plan) -> Plan:
    return _with_table(plan, lambda xyz, box: (xyz[0], xyz[1], xyz[2] - 3e-3))


def a_table_that_ends_under_the_part(plan: Plan) -> Plan:
    _, part, _ = letting_go(plan)
    x = np.array(plan.actions[-1].end.poses[part])[0, 3]
    return _with_table(plan, lambda xyz, box: (x - 0.5e-3 + box[0] / 2.0, xyz[1], xyz[2]))


def _with_table(plan: Plan, place: Callable[[list[float], list[float]], tuple[float, ...]]) -> Plan:
    cell = [
        {**entry, "at": {**entry["at"], "xyz": list(map(float, place(entry["at"]["xyz"], entry["box"])))}}
        for entry in plan.task["cell"]
    ]
    return replace(plan, task={**plan.task, "cell": cell})


# Goals ----------------------------------------------------------------------------------------------------------------


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


# Tools ----------------------------------------------------------------------------------------------------------------


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


ANYWHERE: dict[Mutation, str] = {
    a_number_that_is_none: "format",
    other_format: "format",
    no_action: "format",
    a_row_too_short: "format",
    openings_too_few: "format",
    a_pose_that_is_none: "format",
    an_unknown_carrier: "names",
    an_unknown_goal: "names",
    an_arm_named_twice: "names",
    time_stands_still: "times",
    an_event_after_the_end: "times",
    a_joint_too_few: "joints",
    an_obstacle_unlike_its_box: "mesh",
    a_mesh_cut_off: "mesh",
    another_robot_file: "models",
    joints_permuted: "start",
    another_start: "start",
    actions_swapped: "continuity",
    a_start_that_jumps: "continuity",
    a_motion_from_elsewhere: "continuity",
    a_flying_start: "standstill",
    an_idle_joint_moves: "idle",
    a_joint_beyond_its_limit: "position",
    a_joint_beyond_all_numbers: "position",
    too_fast: "velocity",
    too_hard: "acceleration",
    fingers_too_fast: "finger-speed",
    fingers_too_wide: "stroke",
    a_hand_that_closes_beside: "pads",
    an_opening_wider_than_the_part: "pads",
    a_loose_grip: "pads",
    another_grasp: "grasp",
    another_grasp_on_the_way: "grasp",
    no_grasp: "grasp",
    taken_twice: "carrier",
    let_go_before_it_is_taken: "carrier",
    taken_on_the_way: "kind",
    joints_move_while_a_hand_closes: "kind",
    a_hand_where_none_may_be: "no-touch",
    a_grip_that_loosens: "grip",
    a_detach_dropped: "attached",
    left_and_right_swapped: "idle",
    a_carrier_untold: "attached",
    a_carried_part_slips: "slip",
    a_standing_part_moves: "moved",
    a_waypoint_in_the_table: "contact",
    a_retreat_through_the_part: "collision",
    a_bigger_part: "contact",
    an_obstacle_in_the_way: "collision",
    a_speck_inside_a_part: "collision",
    a_support_removed: "unsupported",
    no_support: "unsupported",
    a_lower_table: "unsupported",
    a_table_that_ends_under_the_part: "topples",
    the_goal_turned: "goal",
    a_goal_undone: "goal",
    the_way_home_left_out: "end",
}
"""For plans in which a hand takes a part, carries it and puts it down, and goes home."""

TOGETHER: dict[Mutation, str] = {
    let_go_after_the_retreat: "two-hands",
    joined_without_a_goal: "assembly",
    an_attached_part_left_behind: "slip",
    goals_in_another_order: "goal",
    an_insertion_cut_short: "insertion",
    an_insertion_from_another_side: "insertion",
    the_other_hand_shall_be_interlocked: "interlock",
    taken_from_the_table_not_from_a_hand: "interlock",
}
"""For plans in which also a part goes from hand to hand, and another into a third."""

USING: dict[Mutation, str] = {
    a_tool_tilted: "goal",
    a_tool_in_the_other_hand: "goal",
    a_press_for_no_goal: "goal",
    a_press_cut_short: "use",
    a_press_from_another_side: "use",
    a_crooked_withdrawal: "use",
    never_drawn_back: "use",
    drawn_back_by_a_transfer: "use",
    pressed_too_deep: "contact",
    pressed_against_what_it_is_not_used_on: "collision",
}
"""For plans in which a tool is used on an obstacle."""
