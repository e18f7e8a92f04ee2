"""Hands: a URDF with mimic joints and a short YAML with pads, forces and friction.

The hand frame has its origin at the grasp centre (midway between the pads, ``contact_depth`` above the fingertips; at
the lip's centre of a suction cup), z along the approach out of the palm and x along the closing direction. Where the
pads advance while closing, the origin moves with them, so every pose of a hand goes with an opening.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from ..errors import InputError
from ..transforms import Array, checked_numbers, compose, invert, rotation_about
from .files import read_yaml
from .urdf import Link, Urdf, read_urdf

_TABLE_SIZE = 2001
_STROKE_SLACK = 1e-6  # m

Positive = Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
Kind = Literal["suction", "two_finger", "three_finger"]
_OF_FINGERS = ("driver", "stroke", "contact_depth", "grip_force", "speed")
_OF_CUPS = ("lip", "vacuum_force")
_FINGERS: dict[str, int] = {"suction": 0, "two_finger": 2, "three_finger": 3}


class PadFile(msgspec.Struct, forbid_unknown_fields=True):
    """A pad in the hand's YAML: link at the face's centre (x outward, z to the tip), sides along y and z [m]."""

    link: str
    size: tuple[Positive, Positive]


class DriverFile(msgspec.Struct, forbid_unknown_fields=True):
    """The joint that drives the fingers, with its positions at the widest and the narrowest opening [rad or m]."""

    joint: str
    open: float
    closed: float


class LipFile(msgspec.Struct, forbid_unknown_fields=True):
    """The lip of a suction cup: link at its centre (z outward), radius and compliance [m]."""

    link: str
    radius: Positive
    compliance: Positive


class HandFile(msgspec.Struct, forbid_unknown_fields=True):
    """The YAML of a hand: fingers need driver, stroke, contact_depth, pads, grip_force, speed; cups a lip and force."""

    name: str
    kind: Kind
    urdf: str
    friction: Positive
    source: str
    assumed: list[str] = []
    driver: DriverFile | None = None
    stroke: tuple[Annotated[float, msgspec.Meta(ge=0.0)], Positive] | None = None
    contact_depth: Positive | None = None
    pads: list[PadFile] = []
    grip_force: Positive | None = None
    speed: Positive | None = None
    lip: LipFile | None = None
    vacuum_force: Positive | None = None


@dataclass(frozen=True, eq=False)
class Pad:
    """The face of a finger pad.

    Attributes:
        link: Its URDF link.
        size: Sides along y (lateral) and z (towards the tip) [m].
        joint: Index of the joint that carries it.
        joint_from_pad: Pose (4, 4) in that joint's frame; x is the outward normal of the face.
    """

    link: str
    size: tuple[float, float]
    joint: int
    joint_from_pad: Array

    @property
    def radius(self) -> float:
        """Half the shorter side [m]."""
        return min(self.size) / 2.0


@dataclass(frozen=True, eq=False)
class Lip:
    """The lip of a suction cup: radius and compliance [m], vacuum force [N]."""

    radius: float
    compliance: float
    force: float


@dataclass(frozen=True, eq=False)
class Hand:
    """A suction cup, or a hand whose fingers one number opens.

    Attributes:
        name: Its name.
        kind: ``suction``, ``two_finger`` or ``three_finger`` (one finger against two).
        stroke: Smallest and largest opening between opposing contact points [m]; (0, 0) for a cup.
        pads: The single finger's pad first; it stands at negative x and faces +x. Empty for a cup.
        contact_depth: Height of the grasp centre above the fingertips [m]; 0 for a cup.
        grip_force: Force of the fingers, or of the vacuum [N].
        friction: Coulomb coefficient between pad or lip and part.
        speed: Speed of one finger [m/s]; 0 for a cup.
        lip: The lip of a cup; None for fingers.
        pieces: Rigid pieces, each with the joint that moves it (0: the base, which comes first).
        joint_names: Joints of the fingers, mimics included.
        mechanism: How these joints move.
    """

    name: str
    kind: Kind
    stroke: tuple[float, float]
    pads: tuple[Pad, ...]
    contact_depth: float
    grip_force: float
    friction: float
    speed: float
    lip: Lip | None
    pieces: tuple[Link, ...]
    joint_names: tuple[str, ...]
    mechanism: Linkage
    _base_from_lip: Array

    @classmethod
    def load(cls, path: str | Path) -> Hand:
        """Read a hand from its YAML file (which names its URDF, relative to itself).

        Raises:
            InputError: A file is missing or wrong: the message names file, field and cure.
        """
        path = Path(path)
        spec = read_yaml(path, HandFile)
        urdf = read_urdf(path.parent / spec.urdf)
        fingers = _FINGERS[spec.kind]
        needed, foreign = (_OF_FINGERS, _OF_CUPS) if fingers else (_OF_CUPS, _OF_FINGERS)
        for field in needed:
            if getattr(spec, field) is None:
                raise InputError(f"{path}: {field}", f"missing, but kind is {spec.kind}", f"give {field}")
        for field in foreign:
            if getattr(spec, field) is not None:
                raise InputError(f"{path}: {field}", f"given, but kind is {spec.kind}", f"leave {field} out")
        if not urdf.shapes:
            raise InputError(urdf.path, "no link has a collision shape", "give the links <collision> elements")
        if len(spec.pads) != fingers:
            raise InputError(f"{path}: pads", f"{len(spec.pads)} pads for kind {spec.kind}", f"give {fingers}")
        linkage = Linkage.of(urdf, spec.driver, path)
        lip = None
        if spec.lip is not None and spec.vacuum_force is not None:
            lip = Lip(spec.lip.radius, spec.lip.compliance, spec.vacuum_force)
        hand = cls(
            name=spec.name,
            kind=spec.kind,
            stroke=spec.stroke or (0.0, 0.0),
            pads=tuple(_pad(urdf, pad, path) for pad in spec.pads),
            contact_depth=spec.contact_depth or 0.0,
            grip_force=spec.grip_force or spec.vacuum_force or 0.0,
            friction=spec.friction,
            speed=spec.speed or 0.0,
            lip=lip,
            pieces=_pieces(urdf),
            joint_names=tuple(urdf.model.names)[1:],
            mechanism=linkage,
            _base_from_lip=_frame(urdf, spec.lip.link, path)[1] if spec.lip else np.eye(4),
        )
        hand._check_stroke(path)
        return hand

    def joint_positions(self, openings: npt.ArrayLike) -> Array:
        """Positions (n, joints) of all finger joints [rad or m] at ``openings`` (n,) [m].

        Raises:
            InputError: An opening lies outside the stroke.
        """
        openings = np.atleast_1d(checked_numbers(openings, f"hand {self.name}: openings"))
        if not self.pads:
            return np.zeros((len(openings), 0))
        low, high = self.stroke
        inside = (openings >= low - _STROKE_SLACK) & (openings <= high + _STROKE_SLACK)
        if not inside.all():
            wrong = openings[~inside][0]
            cure = f"choose one between {low:g} and {high:g} m"
            raise InputError(f"hand {self.name}", f"opening {wrong:g} m is outside the stroke", cure)
        values, reached = self._opening_table
        return self.mechanism.joints(np.interp(openings, reached, values))

    def base_from_hand(self, openings: npt.ArrayLike) -> Array:
        """Pose (n, 4, 4) of the hand frame in the frame of the hand's base at ``openings`` (n,) [m]."""
        if not self.pads:
            return np.tile(self._base_from_lip, (np.size(openings), 1, 1))
        _, centres, closing, approach = self._grasp(self.joint_positions(openings))
        return compose(np.stack([closing, np.cross(approach, closing), approach], axis=-1), centres)

    def base_from_piece(self, openings: npt.ArrayLike) -> Array:
        """Poses (n, pieces, 4, 4) of the pieces in the frame of the hand's base at ``openings`` (n,) [m]."""
        joints = self.mechanism.forward(self.joint_positions(openings))
        return joints[:, [piece.joint for piece in self.pieces]]

    def hand_from_piece(self, openings: npt.ArrayLike) -> Array:
        """Poses (n, pieces, 4, 4) of the pieces in the hand frame at ``openings`` (n,) [m]."""
        return invert(self.base_from_hand(openings))[:, None] @ self.base_from_piece(openings)

    def hand_from_pad(self, openings: npt.ArrayLike) -> Array:
        """Poses (n, pads, 4, 4) of the pads' faces in the hand frame at ``openings`` (n,) [m]."""
        return invert(self.base_from_hand(openings))[:, None] @ self._pads(self.joint_positions(openings))

    @cached_property
    def _opening_table(self) -> tuple[Array, Array]:
        """Positions of the driving joint and the openings they give, by rising opening."""
        values = np.linspace(self.mechanism.closed, self.mechanism.open, _TABLE_SIZE)
        return values, self._grasp(self.mechanism.joints(values))[0]

    def _pads(self, joints: Array) -> Array:
        poses = self.mechanism.forward(joints)
        return np.stack([poses[:, pad.joint] @ pad.joint_from_pad for pad in self.pads], axis=1)

    def _grasp(self, joints: Array) -> tuple[Array, Array, Array, Array]:
        """Opening (n,), grasp centre, closing and approach direction (n, 3) in the base frame."""
        pads = self._pads(joints)
        points = np.array([[0.0, 0.0, pad.size[1] / 2.0 - self.contact_depth, 1.0] for pad in self.pads])
        contacts = np.einsum("npij,pj->npi", pads, points)[..., :3]
        single, others = contacts[:, 0], contacts[:, 1:].mean(axis=1)
        gap = others - single
        approach = pads[:, 0, :3, 2] + pads[:, 1:, :3, 2].mean(axis=1)
        closing = pads[:, 0, :3, 0] - pads[:, 1:, :3, 0].mean(axis=1)
        approach /= np.linalg.norm(approach, axis=-1, keepdims=True)
        closing -= np.sum(closing * approach, axis=-1, keepdims=True) * approach
        closing /= np.linalg.norm(closing, axis=-1, keepdims=True)
        return np.sum(gap * closing, axis=-1), (single + others) / 2.0, closing, approach

    def _check_stroke(self, path: Path) -> None:
        if not self.pads:
            return
        _, reached = self._opening_table
        if not (np.diff(reached) > 0.0).all():
            raise InputError(
                f"{path}: driver", "the opening does not grow from closed to open", "check open and closed"
            )
        low, high = self.stroke
        if not reached[0] - 1e-3 <= low < high <= reached[-1] + 1e-3:
            cure = f"the fingers reach {reached[0]:.4f} to {reached[-1]:.4f} m"
            raise InputError(f"{path}: stroke", f"{low:g} to {high:g} m is not what the URDF gives", cure)
        shortest = min(pad.size[1] for pad in self.pads)
        if self.contact_depth > shortest:
            cure = f"give at most the pads' height, {shortest:g} m"
            raise InputError(f"{path}: contact_depth", f"{self.contact_depth:g} m lies beyond the pads", cure)


@dataclass(frozen=True, eq=False)
class Linkage:
    """Forward kinematics of j finger joints over arrays; every joint is ``factor * driver + offset``.

    Attributes:
        parents: Index of the parent of the base and of each joint; the base is 0.
        placements: (1 + j, 4, 4) pose of each joint in its parent's frame.
        axes: (j, 3) unit axes, in the joints' frames.
        prismatic: (j,) whether a joint slides.
        factors: (j,).
        offsets: (j,) [rad or m].
        open: Position of the driver where the hand is open.
        closed: And where it is closed.
    """

    parents: tuple[int, ...]
    placements: Array
    axes: Array
    prismatic: npt.NDArray[np.bool_]
    factors: Array
    offsets: Array
    open: float
    closed: float

    @property
    def leader(self) -> int:
        """Index of a joint that moves as the driver does."""
        return int(np.flatnonzero((self.factors == 1.0) & (self.offsets == 0.0))[0])

    @classmethod
    def of(cls, urdf: Urdf, driver: DriverFile | None, path: Path) -> Linkage:
        """The linkage of a hand's URDF.

        Raises:
            InputError: A joint is not driven by the driver, or of a kind that no finger has.
        """
        model = urdf.model
        names = list(model.names)[1:]
        if model.nq != len(names):
            raise InputError(urdf.path, "a finger joint is continuous or floating", "use revolute or prismatic joints")
        subspaces = [_subspace(model, i) for i in range(1, model.njoints)]
        factors, offsets = np.zeros(len(names)), np.zeros(len(names))
        for i, name in enumerate(names):
            root, factors[i], offsets[i] = urdf.mimics.get(name, (name, 1.0, 0.0))
            if driver is None or root != driver.joint:
                cure = "make every joint a mimic of the driver, and the driver a joint of the URDF"
                raise InputError(f"{path}: driver", f"joint {name!r} of {urdf.path.name} is not driven by it", cure)
        return cls(
            parents=tuple(int(p) for p in model.parents),
            placements=np.array([p.homogeneous for p in model.jointPlacements]),
            axes=np.array([s[3:] if s[3:].any() else s[:3] for s in subspaces]).reshape(-1, 3),
            prismatic=np.array([not s[3:].any() for s in subspaces], dtype=bool),
            factors=factors,
            offsets=offsets,
            open=driver.open if driver else 0.0,
            closed=driver.closed if driver else 0.0,
        )

    def joints(self, values: Array) -> Array:
        """All joints (n, joints) at the driver's ``values`` (n,)."""
        return values[:, None] * self.factors + self.offsets

    def forward(self, joints: Array) -> Array:
        """Poses (n, 1 + joints, 4, 4) of the base and of each joint's frame in the base frame."""
        poses = np.tile(np.eye(4), (len(joints), len(self.parents), 1, 1))
        for i in range(1, len(self.parents)):
            axis, value = self.axes[i - 1], joints[:, i - 1]
            if self.prismatic[i - 1]:
                motion = compose(np.eye(3), value[:, None] * axis)
            else:
                motion = compose(rotation_about(axis, value), np.zeros(3))
            poses[:, i] = poses[:, self.parents[i]] @ self.placements[i] @ motion
        return poses


def _subspace(model: pin.Model, joint: int) -> Array:
    """Motion direction (6,) of a joint with one degree of freedom, in its own frame: linear, then angular."""
    jacobian = pin.computeJointJacobian(model, model.createData(), pin.neutral(model), joint)
    return np.asarray(jacobian[:, model.joints[joint].idx_v], dtype=float)


def _frame(urdf: Urdf, link: str, path: Path) -> tuple[int, Array]:
    """The joint that carries ``link`` and the link's pose (4, 4) in that joint's frame."""
    known = [frame.name for frame in urdf.model.frames if frame.type == pin.FrameType.BODY]
    if link not in known:
        raise InputError(path, f"{urdf.path.name} has no link {link!r}", f"known: {', '.join(known)}")
    frame = urdf.model.frames[urdf.model.getFrameId(link, pin.FrameType.BODY)]
    return int(frame.parentJoint), np.array(frame.placement.homogeneous)


def _pad(urdf: Urdf, spec: PadFile, path: Path) -> Pad:
    joint, placement = _frame(urdf, spec.link, path)
    return Pad(spec.link, spec.size, joint, placement)


def _pieces(urdf: Urdf) -> tuple[Link, ...]:
    pieces = []
    for joint in sorted(set(urdf.joints)):
        members = [i for i, carrier in enumerate(urdf.joints) if carrier == joint]
        shapes = tuple(urdf.shapes[i] for i in members)
        color = urdf.colors[members[0]]
        pieces.append(Link(urdf.links[members[0]], shapes, urdf.placements[members], color, joint))
    return tuple(pieces)
