"""Bodies of a cell and the state of a scene: what exists besides the robot, and where everything is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import trimesh

from ..errors import InputError, UnknownNameError
from ..transforms import Array, checked_numbers, checked_pose
from . import shapes
from .rigid import Rigid
from .shapes import Shape

CONTACT_TOLERANCE = 0.5e-3  # m
_PART_COLOR = (0.85, 0.55, 0.2, 1.0)
_OBSTACLE_COLOR = (0.6, 0.6, 0.6, 1.0)
_UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Body(Rigid):
    """A part or obstacle.

    Attributes:
        fixed: True for an obstacle, which nothing ever carries; obstacles may touch each other and the robot's base.
    """

    fixed: bool = False

    @classmethod
    def of(cls, name: str, shape: Shape, fixed: bool = False) -> Body:
        """A body of one shape, in the shape's frame."""
        color = _OBSTACLE_COLOR if fixed else _PART_COLOR
        return cls(name, (shape,), np.eye(4)[None], np.array(color), fixed)

    @classmethod
    def from_mesh(cls, name: str, mesh: trimesh.Trimesh, fixed: bool = False) -> Body:
        """A body of triangles [m].

        Raises:
            InputError: It has no triangles, or a corner that is not finite.
        """
        if not len(mesh.faces) or not np.isfinite(mesh.vertices).all():
            raise InputError(f"body {name}", "no triangles, or a corner that is not finite", "mend the mesh")
        return cls.of(name, shapes.from_mesh(mesh), fixed)

    @classmethod
    def box(cls, name: str, size: Sequence[float], fixed: bool = False) -> Body:
        """A box of ``size`` (3,) [m] about its own origin.

        Raises:
            InputError: A side is not above zero, or not finite.
        """
        sides = checked_numbers(size, f"box {name}")
        if sides.shape != (3,) or not ((sides > 0.0) & np.isfinite(sides)).all():
            raise InputError(f"box {name}", f"sides {size}", "give three lengths above 0 m")
        return cls.of(name, shapes.box(sides), fixed)


@dataclass(frozen=True, eq=False)
class Contact:
    """Two bodies that touch on purpose.

    They may touch only so far that they are apart once the second has moved by the contact tolerance along ``normal``;
    with several contacts (in a corner), by the shortest way that goes so far along each normal.

    Attributes:
        first: A part or obstacle.
        second: A part, an obstacle, or a piece of a hand (``arm/piece``).
        normal: Direction (3,) from the first to the second, in the frame of the first.
    """

    first: str
    second: str
    normal: Array

    def __post_init__(self) -> None:
        normal = checked_numbers(self.normal, f"contact {self.first} / {self.second}")
        if self.first == self.second:
            raise InputError(f"contact {self.first}", "a body does not touch itself", "name two bodies")
        if normal.shape != (3,) or not abs(np.linalg.norm(normal) - 1.0) < _UNIT_TOLERANCE:
            cure = "give a unit vector from the first body to the second"
            raise InputError(f"contact {self.first} / {self.second}", f"normal {normal} is no direction", cure)
        object.__setattr__(self, "normal", normal)


@dataclass(frozen=True, eq=False)
class Attachment:
    """A body carried by an arm's hand or by another body.

    Attributes:
        carrier: Name of the arm or body.
        carrier_from_body: Pose (4, 4) in the frame of the arm's flange, or of the carrying body.
    """

    carrier: str
    carrier_from_body: Array


@dataclass(frozen=True, eq=False)
class SceneState:
    """Where everything is.

    Attributes:
        q: The robot's configuration (nq,).
        openings: Opening of each arm's hand [m].
        poses: Pose (4, 4) in the world of each body that nothing carries.
        attached: Bodies that an arm or another body carries.
        contacts: Pairs that touch on purpose.
    """

    q: Array
    openings: Mapping[str, float]
    poses: Mapping[str, Array]
    attached: Mapping[str, Attachment] = field(default_factory=lambda: MappingProxyType({}))
    contacts: tuple[Contact, ...] = ()

    def __post_init__(self) -> None:
        q = checked_numbers(self.q, "state: q").copy()
        q.setflags(write=False)
        object.__setattr__(self, "q", q)

    def carrier(self, body: str) -> tuple[str, Array]:
        """The arm that carries ``body``, through other bodies or not, and the body's pose (4, 4) in its flange's frame.

        For a body that stands in the world the name is empty and the pose is in the world.

        Raises:
            UnknownNameError: There is no such body.
        """
        pose = np.eye(4)
        while body in self.attached:
            entry = self.attached[body]
            pose, body = entry.carrier_from_body @ pose, entry.carrier
            if body not in self.poses and body not in self.attached:
                return body, pose
        if body not in self.poses:
            raise UnknownNameError("state", "body", body, (*self.poses, *self.attached))
        return "", np.asarray(self.poses[body]) @ pose

    def with_q(self, q: Array) -> SceneState:
        """This state at another configuration (nq,)."""
        return replace(self, q=q)

    def with_opening(self, arm: str, opening: float) -> SceneState:
        """This state with the hand of ``arm`` at another opening [m].

        Raises:
            UnknownNameError: There is no such arm, or it has no hand.
        """
        if arm not in self.openings:
            raise UnknownNameError("state", "arm with a hand", arm, tuple(self.openings))
        return replace(self, openings={**self.openings, arm: float(opening)})

    def with_pose(self, body: str, world_from_body: Array) -> SceneState:
        """This state with ``body`` at another pose (4, 4) in the world, carried by nothing.

        Raises:
            InputError: The pose is not rigid.
            UnknownNameError: There is no such body.
        """
        if body not in self.poses and body not in self.attached:
            raise UnknownNameError("state", "body", body, (*self.poses, *self.attached))
        world_from_body = checked_pose(world_from_body, f"pose of {body}")
        attached = {name: entry for name, entry in self.attached.items() if name != body}
        return replace(self, poses={**self.poses, body: world_from_body}, attached=attached)

    def with_contacts(self, contacts: Iterable[Contact]) -> SceneState:
        """This state with other contacts."""
        return replace(self, contacts=tuple(contacts))


@dataclass(frozen=True, eq=False)
class Margins:
    """Distances to keep [m]; bodies in contact and hands at work (grasping, placing, sharing a part) are exempt.

    Attributes:
        arms: Between links or hands of different arms.
        environment: Between links or hands and the bodies that they do not carry.
    """

    arms: float = 0.0
    environment: float = 0.0

    def __post_init__(self) -> None:
        for name in ("arms", "environment"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise InputError(f"margins.{name}", f"{getattr(self, name)} is no margin", "give 0 to 1 m")
