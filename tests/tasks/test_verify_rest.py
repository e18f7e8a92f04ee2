"""Parts at rest: what carries them, and how far they are from toppling."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from plans import TASK, short_plan

from kumitate.tasks.document import Mesh, Plan, matrix
from kumitate.tasks.verify import verify
from kumitate.tasks.verify_rest import LEAST_TILT
from kumitate.transforms import pose

TOP = -0.05


def standing(parts: dict[str, tuple[trimesh.Trimesh, np.ndarray]], **more: object) -> Plan:
    """Nothing happens: parts stand at poses on the table."""
    plan = short_plan()
    rpy = {name: trimesh.transformations.euler_from_matrix(where, "sxyz") for name, (_, where) in parts.items()}
    entries = {
        name: {"mesh": f"{name}.stl", "unit": "m", "mass": 0.1, "at": {"xyz": where[:3, 3].tolist(), "rpy": rpy[name]}}
        for name, (_, where) in parts.items()
    }
    action = plan.actions[0]
    state = replace(
        action.start, poses={name: matrix(pose(e["at"]["xyz"], e["at"]["rpy"])) for name, e in entries.items()}
    )
    motion = replace(
        action.motion,
        times=(0.0,),
        positions=action.motion.positions[:1],
        velocities=action.motion.velocities[:1],
        openings={arm: row[:1] for arm, row in action.motion.openings.items()},
        opening_velocities={arm: row[:1] for arm, row in action.motion.opening_velocities.items()},
    )
    still = replace(action, part=None, start=state, end=state, motion=motion, grasp=None, goal=None)
    meshes = {"table": plan.meshes["table"], **{name: Mesh.of(mesh) for name, (mesh, _) in parts.items()}}
    task = {**TASK, "parts": entries, "goals": []}
    return replace(plan, task=task, meshes=meshes, actions=(still,))


def names(plan: Plan) -> set[str]:
    return {fault.name for fault in verify(plan).faults}


def block(x=0.35, y=0.2, z=TOP + 0.03, rpy=(0.0, 0.0, 0.0), size=(0.03, 0.03, 0.06)):
    return trimesh.creation.box(size), pose([x, y, z], rpy)


@pytest.mark.parametrize(
    ("height", "found"), [(0.0, set()), (0.9e-3, set()), (1.1e-3, {"unsupported"}), (-0.4e-3, set())]
)
def test_a_support_lies_within_a_millimetre_below(height, found):
    assert names(standing({"block": block(z=TOP + 0.03 + height)})) == found


def test_parts_carry_parts():
    lower, upper = block(), block(z=TOP + 0.09)
    assert names(standing({"lower": lower, "upper": upper})) == set()
    aside = block(x=0.35 + 0.016, z=TOP + 0.09)
    assert names(standing({"lower": lower, "upper": aside})) == {"topples"}
    assert names(standing({"lower": lower, "upper": block(x=0.4, z=TOP + 0.09)})) == {"unsupported"}


@pytest.mark.parametrize("share", [0.5, 2.0])
def test_toppling_is_an_angle(share):
    """Over the table's edge by so much that the centre of mass is as far inside as the tilt asks, or half or twice."""
    inside = 0.03 * np.tan(share * LEAST_TILT)
    edge = 0.4 + 0.15
    fault = names(standing({"block": block(x=edge - inside)}))
    assert fault == ({"topples"} if share < 1.0 else set())


def test_a_block_on_its_edge_topples():
    half = np.hypot(0.03, 0.06) / 2.0
    on_edge = block(z=TOP + half, rpy=(0.0, np.arctan2(0.03, 0.06), 0.0))
    assert names(standing({"block": on_edge})) == {"topples"}


def test_open_surfaces_are_weighed_by_their_hull():
    mesh, where = block()
    lid = mesh.faces[np.abs(mesh.face_normals[:, 2] - 1.0) > 1e-6]
    open_block = trimesh.Trimesh(mesh.vertices, lid, process=False)
    assert not open_block.is_watertight
    assert names(standing({"block": (open_block, where)})) == set()


def test_triangles_may_have_corners_of_their_own():
    """As STL files write them."""
    mesh, where = block()
    soup = trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False)
    assert names(standing({"block": (soup, where)})) == set()
