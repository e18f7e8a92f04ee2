"""Ways to bring bodies of a plan into each other, and parts off what they rest on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from edits import beyond, kinds, letting_go, taking
from msgspec.structs import replace

from kumitate.tasks.document import Mesh, Plan


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
