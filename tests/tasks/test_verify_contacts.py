"""Contact is nominal: it may be half a millimetre deep, wherever it is allowed, and no deeper."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from edits import kinds, with_states
from msgspec.structs import replace
from mutations_of_goals import pressed_against_what_it_is_not_used_on, pressed_too_deep
from mutations_of_holds import a_loose_grip
from plans import sample_plan, short_plan, use_plan

from kumitate.tasks.document import Mesh, Plan, matrix
from kumitate.tasks.verify import verify
from kumitate.transforms import pose


def names(plan: Plan) -> set[str]:
    return {fault.name for fault in verify(plan).faults}


def with_table(plan: Plan, rise: float) -> Plan:
    (table,) = plan.task["cell"]
    x, y, z = table["at"]["xyz"]
    return replace(plan, task={**plan.task, "cell": [{**table, "at": {**table["at"], "xyz": [x, y, z + rise]}}]})


@pytest.mark.parametrize(("rise", "found"), [(0.4e-3, set()), (0.6e-3, {"contact"})])
def test_a_part_may_lie_in_its_support_by_the_tolerance(rise, found):
    assert names(with_table(short_plan(), rise)) == found


@pytest.mark.parametrize(("wider", "found"), [(0.15e-3, False), (-0.6e-3, False), (-1.4e-3, True)])
def test_pads_may_lie_in_the_part_by_the_tolerance(wider, found):
    assert ("contact" in names(a_loose_grip(short_plan(), wider))) is found


def test_the_depth_is_told():
    fault = next(fault for fault in verify(with_table(short_plan(), 0.8e-3)).faults if fault.name == "contact")
    assert fault.bodies == ("block", "table")
    assert fault.action == 0
    assert float(fault.words.partition(", ")[2].split()[0]) == pytest.approx(0.8, abs=0.1)


def test_a_part_may_not_be_dragged_along_its_support():
    """A table as high as the carried part's bottom, but for the places where it stands."""
    plan = short_plan()
    lift = kinds(plan, "lift")[0]
    bottom = [np.array(state.poses["block"])[2, 3] - 0.06 for state in (plan.actions[lift].end, plan.actions[-1].end)]
    rail = {"name": "rail", "box": [0.004, 0.004, 0.01], "support": True}
    at = np.array(plan.actions[lift].end.poses["block"])[:3, 3]
    rail["at"] = {"xyz": [at[0], at[1] + 0.05, bottom[0] - 0.005 + 0.3e-3]}
    cell = [*plan.task["cell"], rail]
    meshes = {**plan.meshes, "rail": Mesh.of(trimesh.creation.box(rail["box"]))}
    found = verify(replace(plan, task={**plan.task, "cell": cell}, meshes=meshes)).faults
    (fault,) = (fault for fault in found if fault.name == "collision")
    assert fault.bodies == ("block", "rail")
    assert plan.actions[fault.action].kind == "transfer"


@pytest.mark.parametrize(("radius", "found"), [(0.0104, False), (0.0125, True)])
def test_mated_parts_are_looked_at_on_their_true_meshes(radius, found):
    """A peg with a thicker end goes into the bore of 11 mm, or does not."""
    plan = sample_plan()
    outline = [(0.0, -0.045), (radius, -0.045), (radius, -0.015), (0.009, -0.015), (0.009, 0.045), (0.0, 0.045)]
    peg = trimesh.creation.revolve(np.array(outline), sections=32)
    insert = kinds(plan, "insert")[0]
    faults = verify(replace(plan, meshes={**plan.meshes, "peg": Mesh.of(peg)})).faults
    there = [fault for fault in faults if set(fault.bodies) == {"peg", "tube"}]
    assert bool(there) is found
    if found:
        assert {fault.name for fault in there} == {"contact"}
        assert there[0].action == insert


def test_a_bracket_across_the_way_is_found():
    """A tube that is closed in the middle."""
    plan = sample_plan()
    plate = trimesh.creation.cylinder(0.012, 0.002, sections=16).apply_translation([0.0, 0.0, -0.01])
    tube = trimesh.util.concatenate([plan.meshes["tube"].trimesh(), plate])
    faults = verify(replace(plan, meshes={**plan.meshes, "tube": Mesh.of(tube)})).faults
    assert ("contact", kinds(plan, "insert")[0]) in {(fault.name, fault.action) for fault in faults}


def on_a_part(plan: Plan, plate: trimesh.Trimesh | None = None) -> Plan:
    """The plate that the tool is used on is a part that stands there."""
    table, entry = plan.task["cell"]
    where = matrix(pose(entry["at"]["xyz"]))
    part = {"mesh": "plate.stl", "unit": "m", "mass": 0.1, "at": entry["at"]}
    task = {**plan.task, "cell": [table], "parts": {**plan.task["parts"], "plate": part}}
    meshes = {**plan.meshes, "plate": plan.meshes["plate"] if plate is None else Mesh.of(plate)}

    def standing(state):
        return replace(state, poses={**state.poses, "plate": where})

    first = replace(plan.actions[0], start=standing(plan.actions[0].start))
    placed = replace(plan, task=task, meshes=meshes, actions=(first, *plan.actions[1:]))
    return with_states(placed, 0, standing)


@pytest.mark.parametrize("kind", ["obstacle", "part"])
@pytest.mark.parametrize(("deep", "found"), [(0.0, set()), (0.4e-3, set()), (0.6e-3, {"contact"})])
def test_a_tool_may_touch_what_it_is_used_on(kind, deep, found):
    plan = pressed_too_deep(use_plan(), deep)
    faults = verify(on_a_part(plan) if kind == "part" else plan).faults
    assert {fault.name for fault in faults} == found
    assert {fault.action for fault in faults} == ({*kinds(plan, "press", "withdraw")} if found else set())


@pytest.mark.parametrize("kind", ["obstacle", "part", "support"])
def test_a_tool_may_touch_nothing_else(kind):
    """Not even a support, on which parts may be put down."""
    plan = pressed_against_what_it_is_not_used_on(use_plan())
    if kind == "support":
        cell = [{**entry, "support": True} for entry in plan.task["cell"]]
        plan = replace(plan, task={**plan.task, "cell": cell})
    faults = verify(on_a_part(plan) if kind == "part" else plan).faults
    assert {fault.name for fault in faults} == {"collision"}
    assert {fault.action for fault in faults} == {*kinds(plan, "press", "withdraw")}


@pytest.mark.parametrize(("gap", "found"), [(0.5e-3, set()), (-0.3e-3, {"contact"})])
def test_a_tool_is_free_again_by_going_back(gap, found):
    """Not where it rubs along a wall that stands on what it is used on."""
    wall = trimesh.creation.box([0.01, 0.03, 0.02]).apply_translation([0.015 + gap + 0.005, 0.0, 0.03])
    plate = trimesh.util.concatenate([use_plan().meshes["plate"].trimesh(), wall])
    assert names(on_a_part(use_plan(), plate)) == found
