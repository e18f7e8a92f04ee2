"""The cell of a plan as the verifier sees it: every body with its triangles, and where a state puts it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import trimesh

from ..errors import InputError
from ..transforms import Array, pose
from .document import Mesh, Plan
from .models import read_bytes
from .quantities import UNITS
from .task import Task
from .verify_arms import Machine, adjacent, read_machine, rigid_pairs
from .verify_faults import Findings
from .verify_solids import Solids
from .verify_task import read_task

_ROUNDING = 1e-9  # m
_LARGEST_PART, _FARTHEST = 10.0, 1e3  # m; what turns is looked at the more often, the larger it is
_STATES = 50  # in which links must touch to be taken for joined, where an SRDF says nothing


@dataclass(frozen=True, eq=False)
class Body:
    """Something solid.

    Attributes:
        name: Its name: of a link, ``arm/piece`` of a hand, of a part or an obstacle.
        kind: What it is.
        mesh: Its triangles in its own frame [m].
        arm: The arm whose hand it is a piece of.
        link: Number of its link in the tree of the robot or of the hand.
        support: For an obstacle, whether parts may rest on it.
    """

    name: str
    kind: Literal["link", "hand", "part", "obstacle"]
    mesh: trimesh.Trimesh
    arm: str = ""
    link: int = 0
    support: bool = False


@dataclass(frozen=True, eq=False)
class Cell:
    """What exists.

    Attributes:
        task: The task.
        machine: The robot with its hands.
        order: (nq,) where the plan's arrays have the machine's joints.
        bodies: Links, pieces of hands, parts, obstacles.
        solids: The same for questions of collision.
        standing: Pose (4, 4) in the world of every obstacle.
    """

    task: Task
    machine: Machine
    order: npt.NDArray[np.intp]
    bodies: tuple[Body, ...]
    solids: Solids
    standing: Mapping[str, Array]

    @cached_property
    def number(self) -> dict[str, int]:
        """Number of each body by its name."""
        return {body.name: i for i, body in enumerate(self.bodies)}

    @property
    def hands(self) -> tuple[str, ...]:
        """The arms that have hands, in the order of the curves' openings."""
        return tuple(self.machine.grippers)

    @property
    def columns(self) -> tuple[str, ...]:
        """What the columns of a curve are called: joints, then hands."""
        return self.machine.joint_names + tuple(f"hand {arm}" for arm in self.hands)

    @property
    def start(self) -> Array:
        """Configuration (nq,) from which the task starts, in the machine's order."""
        given = self.task.start
        return np.array([given.get(n, h) for n, h in zip(self.machine.joint_names, self.machine.home, strict=True)])

    @property
    def limits(self) -> Array:
        """Lowest, highest, fastest and hardest (4, n) for the columns of a curve, at the task's speed."""
        joints = self.machine.limits * np.array([[1.0], [1.0], [self.task.speed], [1.0]])
        grippers = self.machine.grippers.values()
        hands = [[*g.stroke, 2.0 * g.speed * self.task.speed, np.inf] for g in grippers]
        return np.hstack([joints, np.array(hands).reshape(-1, 4).T])

    @cached_property
    def pairs(self) -> npt.NDArray[np.intp]:
        """The pairs of bodies (p, 2) that are looked at.

        Left out are links that are joined or that the SRDF disables, pieces of one hand, a hand and the links that its
        flange does not move against, obstacles among themselves, and obstacles and the links that no joint moves.
        """
        tree = self.machine.tree
        joined = adjacent(tree) | rigid_pairs(tree) | (self.machine.disabled or self._always_touching)
        flanges = {arm: tree.movers[flange] for arm, (_, flange) in self.machine.arms.items()}

        def looked_at(a: Body, b: Body) -> bool:
            kinds = {a.kind, b.kind}
            if kinds == {"link"}:
                return frozenset((a.name, b.name)) not in joined
            if kinds == {"hand"}:
                return a.arm != b.arm
            if kinds == {"link", "hand"}:
                link, piece = (a, b) if a.kind == "link" else (b, a)
                return tree.movers[link.link] != flanges[piece.arm]
            if kinds == {"link", "obstacle"}:
                return tree.movers[(a if a.kind == "link" else b).link] >= 0
            return kinds != {"obstacle"}

        both = itertools.combinations(range(len(self.bodies)), 2)
        chosen = [(i, j) for i, j in both if looked_at(self.bodies[i], self.bodies[j])]
        return np.array(chosen, dtype=np.intp).reshape(-1, 2)

    @cached_property
    def _always_touching(self) -> frozenset[frozenset[str]]:
        """Pairs of links that touch in every one of some random states, for an SRDF that disables no pairs."""
        links = [i for i, body in enumerate(self.bodies) if body.kind == "link"]
        rng, (lower, upper) = np.random.default_rng(0), self.machine.limits[:2]
        poses = self.machine.links(rng.uniform(lower, upper, (_STATES, len(lower))))
        left = list(itertools.combinations(links, 2))
        for state in poses:
            at = {i: state[self.bodies[i].link] for i in links}
            left = [(i, j) for i, j in left if self.solids.touch(i, at[i], j, at[j])]
        return frozenset(frozenset((self.bodies[i].name, self.bodies[j].name)) for i, j in left)

    def split(self, values: Array) -> tuple[Array, dict[str, Array]]:
        """Configurations (n, nq), and openings (n,) by arm, of the rows (n, columns) of a curve."""
        count = len(self.order)
        return values[:, :count], {arm: values[:, count + k] for k, arm in enumerate(self.hands)}

    def flanges(self, values: Array) -> dict[str, Array]:
        """Pose (n, 4, 4) of each arm's flange at the rows (n, columns) of a curve."""
        return self.machine.flanges(self.split(values)[0])

    def hand(self, arm: str, values: Array) -> Array:
        """Pose (n, 4, 4) of the hand frame of an arm at the rows (n, columns) of a curve."""
        openings = self.split(values)[1][arm]
        return self.flanges(values)[arm] @ self.machine.grippers[arm].hand(openings)

    def poses(self, values: Array, place: Callable[[Mapping[str, Array]], Mapping[str, Array]]) -> Array:
        """Poses (n, bodies, 4, 4) of all bodies at the rows (n, columns) of a curve.

        Args:
            values: The rows.
            place: Tells the poses ((n or 1), 4, 4) of the parts by those of the flanges (n, 4, 4).
        """
        q, openings = self.split(values)
        links = self.machine.links(q)
        flanges = {arm: links[:, flange] for arm, (_, flange) in self.machine.arms.items()}
        parts = place(flanges)
        pieces = {}
        for arm, gripper in self.machine.grippers.items():
            still = np.ptp(openings[arm]) == 0.0
            pieces[arm] = flanges[arm][:, None] @ gripper.links(openings[arm][:1] if still else openings[arm])
        poses = np.zeros((len(values), len(self.bodies), 4, 4))
        for i, body in enumerate(self.bodies):
            if body.kind == "link":
                poses[:, i] = links[:, body.link]
            elif body.kind == "hand":
                poses[:, i] = pieces[body.arm][:, body.link]
            else:
                poses[:, i] = parts[body.name] if body.kind == "part" else self.standing[body.name]
        return poses

    def groups(self, moving: npt.NDArray[np.bool_], carriers: Mapping[str, str]) -> npt.NDArray[np.intp]:
        """Number of the rigid group of each body (bodies,): those of one group keep their places to each other.

        Args:
            moving: (columns,) which columns of the curve change.
            carriers: The arm that carries a part, for parts that one does.
        """
        tree, count = self.machine.tree, len(self.order)
        links, at = np.zeros(len(tree.links), dtype=np.intp), 0
        for k, joint in enumerate(tree.joints):
            links[joint.child] = k + 1 if joint.moves and moving[at] else links[joint.parent]
            at += joint.moves
        flanges = {arm: links[flange] for arm, (_, flange) in self.machine.arms.items()}
        groups = np.zeros(len(self.bodies), dtype=np.intp)
        for i, body in enumerate(self.bodies):
            if body.kind == "link":
                groups[i] = links[body.link]
            elif body.kind == "hand":
                apart = moving[count + self.hands.index(body.arm)]
                mover = self.machine.grippers[body.arm].tree.movers[body.link]
                groups[i] = len(tree.joints) + i + 1 if apart and mover >= 0 else flanges[body.arm]
            elif body.name in carriers:
                groups[i] = flanges[carriers[body.name]]
        return groups


def read_cell(plan: Plan, findings: Findings) -> Cell | None:
    """The cell of a plan; none, and faults, where joints or meshes are not the task's.

    Raises:
        InputError: The task is none, or a file of the robot or of a hand cannot be read.
    """
    task = read_task(plan.task)
    machine = read_machine(task, plan.task, Path(plan.folder))
    if sorted(plan.joints) != sorted(machine.joint_names):
        odd = sorted(set(plan.joints) ^ set(machine.joint_names))
        words = f"{len(plan.joints)} joints, the robot has {len(machine.joint_names)}; not in both: {', '.join(odd)}"
        findings.add("joints", words, bodies=odd)
    meshes = _meshes(plan, task, findings)
    if sorted(plan.joints) != sorted(machine.joint_names) or {*task.parts, *(e.name for e in task.cell)} - set(meshes):
        return None
    bodies = [
        Body(link, "link", mesh, link=machine.tree.links.index(link)) for link, mesh in machine.tree.meshes.items()
    ]
    for arm, gripper in machine.grippers.items():
        bodies += [Body(f"{arm}/{n}", "hand", mesh, arm=arm, link=i) for n, (i, mesh) in gripper.pieces.items()]
    bodies += [Body(part, "part", meshes[part]) for part in task.parts]
    bodies += [Body(entry.name, "obstacle", meshes[entry.name], support=entry.support) for entry in task.cell]
    return Cell(
        task=task,
        machine=machine,
        order=np.array([plan.joints.index(name) for name in machine.joint_names], dtype=np.intp),
        bodies=tuple(bodies),
        solids=Solids([body.mesh for body in bodies]),
        standing={entry.name: pose(entry.at.xyz, entry.at.rpy) for entry in task.cell},
    )


def _meshes(plan: Plan, task: Task, findings: Findings) -> dict[str, trimesh.Trimesh]:
    """The triangles of parts and obstacles, checked against the task."""
    boxes = {entry.name: entry.box for entry in task.cell if entry.box is not None}
    files = {entry.name: (entry.mesh, entry.unit or "m") for entry in task.cell if entry.mesh is not None}
    files |= {name: (entry.mesh, entry.unit) for name, entry in task.parts.items()}
    meshes = {}
    for name in sorted({*boxes, *files} ^ set(plan.meshes)):
        findings.add("mesh", f"there is a mesh or a body {name}, but not both", bodies=[name])
    for name, packed in plan.meshes.items():
        mesh = _solid(packed)
        if mesh is None or (name in task.parts and mesh.extents.max() > _LARGEST_PART):
            findings.add("mesh", f"the triangles of {name} cannot be read, or are no body of its size", bodies=[name])
            continue
        meshes[name] = mesh
        if name in boxes:
            off = np.abs(mesh.bounds - np.array(boxes[name]) * [[-0.5], [0.5]]).max()
            if off > _ROUNDING or not (mesh.is_watertight and np.isclose(mesh.volume, np.prod(boxes[name]))):
                words = f"the triangles of {name} are not the task's box: a side is {1e3 * off:.3f} mm off"
                findings.add("mesh", words, bodies=[name])
        if name in files and (unlike := _unlike_its_file(mesh, packed.digest, Path(plan.folder), *files[name])):
            findings.add("mesh", f"{name}: {unlike}", bodies=[name])
    return meshes


def _solid(packed: Mesh) -> trimesh.Trimesh | None:
    """The triangles of a mesh, if they are some, of points that there are, and not all in one plane."""
    try:
        mesh = packed.trimesh()
        if not 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices):
            return None
    except (ValueError, IndexError):
        return None
    corners = mesh.triangles.reshape(-1, 3)
    sound = np.abs(corners).max() < _FARTHEST and np.linalg.matrix_rank(corners - corners[0]) == 3
    return mesh if sound else None


def _unlike_its_file(mesh: trimesh.Trimesh, digest: str, folder: Path, name: str, unit: str) -> str:
    """What differs between triangles [m] and the file that they come from; empty if nothing does or it is not there."""
    try:
        content = read_bytes(folder / name)
    except InputError:
        return ""
    if sha256(content).hexdigest() != digest:
        return f"{name} has changed since the plan was made"
    try:
        given = trimesh.load_mesh(BytesIO(content), file_type=Path(name).suffix.lower().lstrip("."), process=False)
        off = np.abs(given.triangles * UNITS["length"][unit] - mesh.triangles).max()
    except Exception as error:  # the readers raise whatever their parsing meets
        return f"{name} cannot be compared ({error})"
    return "" if off <= _ROUNDING else f"its triangles are {1e3 * off:.3f} mm off those of {name}"
