"""Ways to spoil the document of a plan and its motions."""

from __future__ import annotations

import numpy as np
from edits import detour, faster, kinds, taking, with_action, with_motion, with_sample, with_states
from msgspec.structs import replace

from kumitate.tasks.document import Event, Mesh, Motion, Plan, matrix


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
