"""The plan document: versioned JSON that a controller or another program can run with nothing else but the robot.

Poses are (4, 4) matrices, row by row; numbers are SI. Between two samples of a motion joints and openings follow cubic
Hermite curves: the planner, the verifier, the replay and the exports all read them so.
"""

from __future__ import annotations

import base64
import os
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import trimesh

from ..errors import InputError
from ..transforms import Array

FORMAT = 1
LARGEST_PLAN = 256 * 2**20  # bytes

Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
Vector = tuple[float, float, float]
Kind = Literal[
    "transit", "approach", "close", "lift", "transfer", "lower", "open", "retreat", "insert", "press", "withdraw"
]


class Mesh(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Triangles of a body in its own frame [m], as the user's file gives them.

    Attributes:
        vertices: Base64 of little-endian float64, three a vertex.
        faces: Base64 of little-endian int32, three a triangle.
        digest: SHA-256 of the file that they come from; empty for a box.
    """

    vertices: str
    faces: str
    digest: str = ""

    @classmethod
    def of(cls, mesh: trimesh.Trimesh, digest: str = "") -> Mesh:
        """Pack the triangles of ``mesh`` [m]."""
        vertices, faces = (
            base64.b64encode(np.ascontiguousarray(array, dtype=kind).tobytes()).decode()
            for array, kind in ((mesh.vertices, "<f8"), (mesh.faces, "<i4"))
        )
        return cls(vertices, faces, digest)

    def trimesh(self) -> trimesh.Trimesh:
        """The triangles [m], neither merged nor repaired.

        Raises:
            ValueError: The text is no base64, or not of three numbers each.
        """
        vertices = np.frombuffer(base64.b64decode(self.vertices, validate=True), dtype="<f8").reshape(-1, 3)
        faces = np.frombuffer(base64.b64decode(self.faces, validate=True), dtype="<i4").reshape(-1, 3)
        return trimesh.Trimesh(vertices.copy(), faces.copy(), process=False)


class Carried(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What carries a part: an arm (by its flange) or another part, and the part's pose in the carrier's frame."""

    carrier: str
    carrier_from_part: Matrix


class State(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where everything is.

    Attributes:
        q: Positions of the plan's ``joints`` [rad or m].
        openings: Opening of each arm's hand [m].
        poses: Pose in the world of every part, carried or not.
        attached: Parts that an arm or another part carries.
    """

    q: tuple[float, ...]
    openings: dict[str, float]
    poses: dict[str, Matrix]
    attached: dict[str, Carried]


class Motion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Joints and openings over time, all on one clock.

    Attributes:
        times: Sample times (k) from 0 upwards [s].
        positions: Joint positions (k, joints) [rad or m].
        velocities: Joint velocities (k, joints) [rad/s or m/s].
        openings: Openings (k) of every arm's hand [m].
        opening_velocities: How fast they change (k) [m/s].
    """

    times: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    velocities: tuple[tuple[float, ...], ...]
    openings: dict[str, tuple[float, ...]]
    opening_velocities: dict[str, tuple[float, ...]]

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]; 0 without samples."""
        return self.times[-1] if self.times else 0.0


class GraspUse(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a hand holds a part: one row of a grasp set, in the part's frame."""

    part_from_hand: Matrix
    opening: float
    approach_opening: float
    contacts: tuple[Vector, ...]
    normals: tuple[Vector, ...]
    force: float


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """At ``time`` [s] of its action, a carrier (an arm or another part) takes a part or lets it go."""

    time: float
    kind: Literal["attach", "detach"]
    part: str
    carrier: str


class Action(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One motion of the job.

    A part that two hands hold for a moment is attached to the second before the first lets go; in ``end.attached`` its
    carrier is then the second.

    Attributes:
        kind: What the motion is for.
        arms: Arms that move or whose hands do.
        words: What happens, in words.
        part: The part it is about, if any.
        start: Where everything is at its start: the end of the action before.
        motion: The motion.
        events: Takings and lettings go, by time.
        grasp: How that one of the arms which takes, holds or leaves the part holds it, if one does.
        goal: Number, from 0, of the task's goal that it works for; none for the way home.
        end: Where everything is at its end.
    """

    kind: Kind
    arms: tuple[str, ...]
    words: str
    part: str | None
    start: State
    motion: Motion
    events: tuple[Event, ...]
    grasp: GraspUse | None
    goal: int | None
    end: State


class Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole job.

    Attributes:
        format: Version of this document's format.
        version: Version of Kumitate that made it.
        task: The task, every number in SI (see `tasks.task.Task`).
        folder: Where relative paths of the task start: those of a robot or hand of the user's own.
        digests: SHA-256 of the robot's and the hands' files, by what they are.
        seed: Seed of the planner.
        joints: Names of the joints, in the order of every configuration.
        meshes: Triangles of the parts and obstacles, by name.
        actions: What happens, one after the other.
        seconds: Measured planning time by stage [s]: all that differs between two runs with the same seed.
    """

    format: int
    version: str
    task: dict[str, Any]
    folder: str
    digests: dict[str, str]
    seed: int
    joints: tuple[str, ...]
    meshes: dict[str, Mesh]
    actions: tuple[Action, ...]
    seconds: dict[str, float]

    @property
    def duration(self) -> float:
        """Time of the whole motion [s]."""
        return sum(action.motion.duration for action in self.actions)

    def save(self, path: str | Path) -> None:
        """Write the document; whoever reads finds the whole of it or nothing new.

        Raises:
            OSError: It cannot be written.
        """
        path = Path(path)
        beside = path.with_name(path.name + f".{os.getpid()}.part")
        try:
            beside.write_bytes(msgspec.json.encode(self))
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)

    @classmethod
    def load(cls, path: str | Path) -> Plan:
        """Read what `save` wrote.

        Raises:
            InputError: The file is missing, too large, no plan, or of another format.
        """
        path = Path(path)
        cure = "give a file that `kumitate plan` wrote"
        try:
            if path.exists() and not (path.is_file() and path.stat().st_size <= LARGEST_PLAN):
                raise InputError(path, f"cannot be read: no plain file, or larger than {LARGEST_PLAN} bytes", cure)
            content = path.read_bytes()
            head = msgspec.json.decode(content, type=_Head)
            if head.format != FORMAT:
                raise InputError(path, f"format {head.format}, and this version reads {FORMAT}", "plan the task again")
            return msgspec.json.decode(content, type=cls)
        except OSError as error:
            raise InputError(path, f"cannot be read ({error.strerror})", cure) from error
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise InputError(path, f"no plan ({error})", cure) from error


class _Head(msgspec.Struct):
    format: int


def plan_schema() -> dict[str, Any]:
    """JSON Schema of the plan document."""
    return msgspec.json.schema(Plan)


def matrix(pose: Array) -> Matrix:
    """``pose`` (4, 4) as the document writes it."""
    a, b, c, d = (tuple(float(x) for x in row) for row in np.asarray(pose))
    return (a, b, c, d)  # type: ignore[return-value]
