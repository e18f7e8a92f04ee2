"""What the verifier takes for the cell: bodies, pairs, rigid groups, and meshes as their files give them."""

from __future__ import annotations

from hashlib import sha256
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from plans import short_plan

from kumitate.tasks.document import Mesh, Plan
from kumitate.tasks.models import LIBRARY, model_digests
from kumitate.tasks.verify import verify
from kumitate.tasks.verify_cell import read_cell
from kumitate.tasks.verify_faults import Findings


@pytest.fixture(scope="module")
def cell():
    return read_cell(short_plan(), Findings())


def from_file(folder, unit: str, scale: float) -> Plan:
    """The short plan with a block that comes from a file."""
    trimesh.creation.box(np.array([0.03, 0.03, 0.12]) * scale).export(folder / "block.stl")
    plan = short_plan()
    given = trimesh.load_mesh(folder / "block.stl", process=False)
    mesh = Mesh.of(given.apply_scale(1.0 / scale), sha256((folder / "block.stl").read_bytes()).hexdigest())
    parts = {"block": {**plan.task["parts"]["block"], "unit": unit}}
    task = {**plan.task, "parts": parts}
    return replace(plan, folder=str(folder), task=task, meshes={**plan.meshes, "block": mesh})


def mesh_faults(plan: Plan):
    findings = Findings()
    read_cell(plan, findings)
    return [fault for fault in findings.faults if fault.name == "mesh"]


@pytest.mark.parametrize(("unit", "scale"), [("m", 1.0), ("mm", 1000.0)])
def test_meshes_are_those_of_their_files(tmp_path, unit, scale):
    plan = from_file(tmp_path, unit, scale)
    assert mesh_faults(plan) == []
    bigger = plan.meshes["block"].trimesh().apply_scale(1.001)
    other = replace(plan, meshes={**plan.meshes, "block": Mesh.of(bigger, plan.meshes["block"].digest)})
    (fault,) = mesh_faults(other)
    assert "0.060 mm off" in fault.words
    trimesh.creation.icosphere(1, 0.02 * scale).export(tmp_path / "block.stl")
    (fault,) = mesh_faults(plan)
    assert "has changed" in fault.words


def bent(mesh: trimesh.Trimesh, number: float, rows: slice = slice(0, 1)) -> Mesh:
    mesh.vertices[rows, 0] = number
    return Mesh.of(mesh)


@pytest.mark.parametrize(
    "mesh",
    [
        Mesh("", ""),
        Mesh("AAAA*", ""),
        bent(trimesh.creation.box([0.03, 0.03, 0.12]), np.nan),
        bent(trimesh.creation.box([0.03, 0.03, 0.12]), 1e308),
        bent(trimesh.creation.box([0.03, 0.03, 0.12]), 50.0),
        bent(trimesh.creation.box([0.03, 0.03, 0.12]), 0.0, slice(None)),
        Mesh.of(trimesh.Trimesh(np.zeros((1, 3)), [[0, 0, 0]], process=False)),
        Mesh.of(trimesh.Trimesh(np.eye(3), [[0, 1, 3]], process=False)),
    ],
)
def test_what_is_no_body_is_a_fault_and_nothing_else_is_looked_at(mesh):
    spoiled = replace(short_plan(), meshes={**short_plan().meshes, "block": mesh})
    assert [fault.name for fault in verify(spoiled).faults] == ["mesh"]


def test_a_box_has_all_its_sides():
    box = trimesh.creation.box(short_plan().task["cell"][0]["box"])
    top = np.flatnonzero(box.face_normals[:, 2] > 0.5)
    box.faces[top[0]] = box.faces[top[1]]  # a hole, and as much volume by the flow along x through what is left
    assert box.volume == pytest.approx(np.prod(box.extents))
    (fault,) = mesh_faults(replace(short_plan(), meshes={**short_plan().meshes, "table": Mesh.of(box)}))
    assert fault.bodies == ("table",)


@pytest.mark.parametrize("name", ["nothing.stl", "", "/dev/zero", "a" * 5000, "a\0b"])
def test_what_is_no_file_is_not_compared(name):
    parts = {"block": {**short_plan().task["parts"]["block"], "mesh": name}}
    assert mesh_faults(replace(short_plan(), task={**short_plan().task, "parts": parts})) == []


def test_pairs_leave_out_what_cannot_meet(cell):
    named = {frozenset((cell.bodies[i].name, cell.bodies[j].name)) for i, j in cell.pairs}
    meet = {
        "left_link3": "right_link3",
        "left/base": "right/base",
        "right/base": "right_link2",
        "block": "table",
        "left_link2": "table",
        "left/left_inner_finger": "block",
        "waist": "block",
    }
    never = {"waist": "chest", "table": "waist", "left/base": "left/left_inner_finger", "right/base": "right_link5"}
    assert all(frozenset(pair) in named for pair in meet.items())
    assert not any(frozenset(pair) in named for pair in never.items())


def test_groups_are_rigid(cell, rng):
    """Bodies of one group keep their places whatever the moving columns do; others do not."""
    moving = np.zeros(len(cell.columns), dtype=bool)
    chosen = [cell.columns.index(name) for name in ("LARM_JOINT2", "LARM_JOINT4", "hand left")]
    moving[chosen] = True
    values = np.tile(np.append(cell.start, [0.04, 0.06]), (4, 1))
    values[:, chosen] = [-2.0, 0.1, 0.03] + rng.uniform(0.0, 0.05, (4, 3)) * [1.0, 1.0, 0.2]
    carried = {"block": "left"}
    poses = cell.poses(values, lambda flanges: {"block": flanges["left"]})
    groups = cell.groups(moving, carried)
    for i, j in cell.pairs:
        relative = np.linalg.inv(poses[:, j]) @ poses[:, i]
        assert (np.ptp(relative, axis=0).max() < 1e-9) == (groups[i] == groups[j])
    assert (cell.groups(np.zeros_like(moving), carried) == 0).all()


def test_without_disabled_pairs_links_that_always_touch_are_left_out(tmp_path):
    """The shipped robot as one of the user's own, its SRDF without disabled pairs."""
    srdf = ElementTree.parse(LIBRARY / "nextage.srdf")
    for pair in srdf.getroot().findall("disable_collisions"):
        srdf.getroot().remove(pair)
    srdf.write(tmp_path / "own.srdf")
    (tmp_path / "own.urdf").write_bytes((LIBRARY / "nextage.urdf").read_bytes())
    (tmp_path / "own.yaml").write_bytes((LIBRARY / "nextage_limits.yaml").read_bytes())
    plan = short_plan()
    task = {**plan.task, "robot": {"urdf": "own.urdf", "srdf": "own.srdf", "limits": "own.yaml"}}
    own = replace(plan, folder=str(tmp_path), task=task, digests=model_digests(task, tmp_path))
    assert verify(own).faults == ()
