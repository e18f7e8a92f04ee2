"""Robots: a URDF for the body, an SRDF for arms and home, hands mounted on the flanges."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from ..errors import InputError, UnknownNameError
from ..transforms import Array, checked_poses
from .allowed import disabled_collisions
from .arm import Arm
from .chain import Chain
from .files import read_yaml
from .hand import Hand
from .srdf import Srdf, read_srdf
from .urdf import Link, read_urdf

log = logging.getLogger(__name__)

DEFAULT_ACCELERATION = 5.0  # rad/s2 or m/s2, assumed where no limits file says otherwise
_LIMIT_SLACK = 1e-6


class JointLimitFile(msgspec.Struct):
    """A joint of MoveIt's joint_limits.yaml; limits are in rad/s and rad/s2, or m/s and m/s2."""

    has_velocity_limits: bool = False
    max_velocity: float = 0.0
    has_acceleration_limits: bool = False
    max_acceleration: float = 0.0


class LimitsFile(msgspec.Struct):
    """MoveIt's joint_limits.yaml."""

    joint_limits: dict[str, JointLimitFile]


@dataclass(frozen=True, eq=False)
class Robot:
    """A robot of one or more arms.

    Attributes:
        name: Its name.
        model: Kinematics; every joint has one degree of freedom, so a configuration is (nq,).
        links: Links with collision shapes.
        arms: Arms by name.
        home: The home configuration (nq,).
        acceleration: Acceleration limits (nq,) [rad/s2 or m/s2].
        disabled: Pairs of links whose collisions are not checked.
    """

    name: str
    model: pin.Model
    links: tuple[Link, ...]
    arms: Mapping[str, Arm]
    home: Array
    acceleration: Array
    disabled: frozenset[frozenset[str]]

    @classmethod
    def load(
        cls,
        urdf: str | Path,
        srdf: str | Path,
        limits: str | Path | None = None,
        base: Array | None = None,
        package_dirs: Sequence[str | Path] = (),
    ) -> Robot:
        """Read a robot from its URDF and SRDF.

        Args:
            urdf: The URDF file.
            srdf: The SRDF file: serial groups become arms, the state ``home`` the home configuration. Where it disables
                no collisions, the pairs are found by sampling.
            limits: MoveIt's joint_limits.yaml; accelerations that it lacks are 5 rad/s2.
            base: Pose (4, 4) of the URDF's root in the world.
            package_dirs: Folders in which ``package://`` addresses are looked up.

        Raises:
            InputError: A file is missing or wrong, or the files do not fit together.
        """
        parsed = read_urdf(urdf, package_dirs)
        model = parsed.model
        if base is not None:
            _place(model, checked_poses(base, "base"))
        semantics = read_srdf(srdf)
        acceleration = _apply_limits(model, limits)
        joints, placements = list(parsed.joints), parsed.placements
        if base is not None:
            fixed = np.array(joints) == 0
            placements = np.where(fixed[:, None, None], base @ placements, placements)
        links = tuple(
            Link(name, tuple(parsed.shapes[i] for i in members), placements[members], color, joints[members[0]])
            for name, members, color in _by_link(parsed.links, parsed.colors)
        )
        home = _home(model, semantics)
        arms = _arms(model, semantics, home)
        if semantics.disabled:
            disabled = _disabled(model, semantics)
        else:
            log.info("%s disables no collisions: the pairs that need no check are sampled", srdf)
            disabled = frozenset(frozenset(pair[:2]) for pair in disabled_collisions(model, parsed.geometry))
        return cls(Path(urdf).stem, model, links, arms, home, acceleration, disabled)

    def with_hand(self, arm: str, hand: Hand, flange_from_base: Array | None = None) -> Robot:
        """This robot with ``hand`` on the flange of ``arm``, its base at ``flange_from_base`` (4, 4).

        Raises:
            UnknownNameError: There is no such arm.
        """
        mount = np.eye(4) if flange_from_base is None else checked_poses(flange_from_base, "flange_from_base")
        equipped = replace(self.arm(arm), hand=hand, flange_from_base=mount)
        return replace(self, arms={**self.arms, arm: equipped})

    def with_home(self, home: npt.ArrayLike) -> Robot:
        """This robot with another home (nq,): joints that belong to no arm, such as a chest, stay there.

        Raises:
            InputError: It is no configuration within the limits.
        """
        q = _checked(self, home, "home")
        arms = {
            name: replace(arm, chain=Chain.from_model(self.model, arm.chain.names, arm.flange, q))
            for name, arm in self.arms.items()
        }
        return replace(self, home=q, arms=arms)

    def arm(self, name: str) -> Arm:
        """The arm called ``name``.

        Raises:
            UnknownNameError: There is no such arm.
        """
        if name not in self.arms:
            raise UnknownNameError(f"robot {self.name}", "arm", name, tuple(self.arms))
        return self.arms[name]

    @cached_property
    def hands(self) -> dict[str, Hand]:
        """The mounted hands by arm."""
        return {name: arm.hand for name, arm in self.arms.items() if arm.hand is not None}

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names (nq,) of the joints, in the order of a configuration."""
        return tuple(self.model.names)[1:]

    @property
    def lower(self) -> Array:
        """Lower limits (nq,) [rad or m]."""
        return np.array(self.model.lowerPositionLimit)

    @property
    def upper(self) -> Array:
        """Upper limits (nq,) [rad or m]."""
        return np.array(self.model.upperPositionLimit)

    @property
    def velocity(self) -> Array:
        """Velocity limits (nq,) [rad/s or m/s]."""
        return np.array(self.model.velocityLimit)

    def indices(self, arms: Iterable[str]) -> npt.NDArray[np.intp]:
        """Places in a configuration of the joints of ``arms``, arm by arm."""
        return np.concatenate([self.arm(name).indices for name in arms])

    def with_joints(self, q: Array, arm: str, joints: Array) -> Array:
        """Configurations (n, nq) like ``q`` (nq,) but with the joints of ``arm`` at ``joints`` (n, dof)."""
        configurations = np.tile(q, (len(joints), 1))
        configurations[:, self.arm(arm).indices] = joints
        return configurations

    def checked_configuration(self, q: npt.ArrayLike, place: str = "q") -> Array:
        """``q`` as a configuration (nq,).

        Raises:
            InputError: Wrong length, a number that is not finite, a joint outside its limits, or a joint of no arm that
                is not at home.
        """
        array = _checked(self, q, place)
        still = np.setdiff1d(np.arange(len(array)), self.indices(self.arms))
        moved = np.abs(array - self.home)[still] > _LIMIT_SLACK
        if moved.any():
            name = self.joint_names[int(still[np.argmax(moved)])]
            raise InputError(place, f"joint {name} belongs to no arm, but is not at home", "use Robot.with_home")
        return array

    def flange(self, arm: str, q: Array) -> Array:
        """Pose (4, 4) of the flange of ``arm`` in the world at ``q`` (nq,)."""
        mounted, data = self.arm(arm), self.model.createData()
        pin.forwardKinematics(self.model, data, q)
        pose: Array = data.oMi[mounted.flange_joint].homogeneous @ mounted.joint_from_flange
        return pose

    def hand_pose(self, arm: str, q: Array, opening: float = 0.0) -> Array:
        """Pose (4, 4) of the hand frame of ``arm`` in the world at ``q`` (nq,) and ``opening`` [m]."""
        pose: Array = self.flange(arm, q) @ self.arm(arm).flange_from_hand(opening)[0]
        return pose


def _checked(robot: Robot, q: npt.ArrayLike, place: str) -> Array:
    array = np.asarray(q, dtype=float)
    if array.shape != (robot.model.nq,):
        names = ", ".join(robot.joint_names)
        raise InputError(place, f"shape {array.shape} is no configuration", f"give {robot.model.nq} numbers: {names}")
    inside = (array >= robot.lower - _LIMIT_SLACK) & (array <= robot.upper + _LIMIT_SLACK)
    if not inside.all():
        i = int(np.argmin(inside))
        cure = f"stay between {robot.lower[i]:.4f} and {robot.upper[i]:.4f}"
        raise InputError(place, f"joint {robot.joint_names[i]} at {array[i]:.4f} is outside its limits", cure)
    return array


def _place(model: pin.Model, base: Array) -> None:
    """Move everything that hangs on the world to ``base``."""
    world = pin.SE3(base)
    for i in range(1, model.njoints):
        if model.parents[i] == 0:
            model.jointPlacements[i] = world * model.jointPlacements[i]
    for frame in list(model.frames)[1:]:
        if frame.parentJoint == 0:
            frame.placement = world * frame.placement


def _apply_limits(model: pin.Model, path: str | Path | None) -> Array:
    """Set the velocity limits of ``path`` in the model; return the acceleration limits (nq,)."""
    acceleration = np.full(model.nv, DEFAULT_ACCELERATION)
    names = list(model.names)[1:]
    velocity = np.array(model.velocityLimit)
    if path is None:
        log.warning("no joint limits file: accelerations are taken as %g rad/s2", DEFAULT_ACCELERATION)
    else:
        for name, limit in read_yaml(Path(path), LimitsFile).joint_limits.items():
            if name not in names:
                raise UnknownNameError(path, "joint", name, names)
            if limit.has_velocity_limits:
                velocity[names.index(name)] = limit.max_velocity
            if limit.has_acceleration_limits:
                acceleration[names.index(name)] = limit.max_acceleration
    wrong = ~(np.isfinite(velocity) & (velocity > 0) & np.isfinite(acceleration) & (acceleration > 0))
    if wrong.any():
        problem = f"joint {names[int(np.argmax(wrong))]} has no positive velocity or acceleration limit"
        raise InputError(path or "URDF", problem, "give one in the URDF or in the joint limits file")
    model.velocityLimit = velocity
    return acceleration


def _by_link(names: Sequence[str], colors: Array) -> list[tuple[str, list[int], Array]]:
    """Links in the order of their first shape, with the places of their shapes and the color of the first."""
    places = {name: [i for i, other in enumerate(names) if other == name] for name in dict.fromkeys(names)}
    return [(name, members, colors[members[0]]) for name, members in places.items()]


def _home(model: pin.Model, srdf: Srdf) -> Array:
    """The state ``home``, joints that it leaves out at zero or at the limit nearest to it."""
    home = np.clip(np.zeros(model.nq), model.lowerPositionLimit, model.upperPositionLimit)
    names = list(model.names)[1:]
    for state, joints in srdf.states.items():
        for name, value in joints.items():
            if name not in names:
                raise UnknownNameError(f"{srdf.path}: group_state {state}", "joint", name, names)
            if state == "home":
                home[names.index(name)] = value
    outside = (home < model.lowerPositionLimit - _LIMIT_SLACK) | (home > model.upperPositionLimit + _LIMIT_SLACK)
    if outside.any():
        name = names[int(np.argmax(outside))]
        raise InputError(f"{srdf.path}: home", f"joint {name} is outside its limits", "choose one within them")
    return home


def _arms(model: pin.Model, srdf: Srdf, home: Array) -> dict[str, Arm]:
    """The serial groups of the SRDF: chains between links, and joint lists in which each joint carries the next."""
    arms = {}
    for group in srdf.groups:
        if group.chain is not None:
            joints = _joints_between(model, *group.chain, srdf.path)
            tip = group.chain[1]
        else:
            joints = _serial(model, group.joints, srdf.path)
            tip = _link_below(model, joints[-1]) if joints else ""
        if not joints:
            continue
        frame = model.frames[model.getFrameId(tip, pin.FrameType.BODY)]
        names = [model.names[i] for i in joints]
        arms[group.name] = Arm(
            name=group.name,
            chain=Chain.from_model(model, names, tip, home),
            flange=tip,
            indices=np.array([model.joints[i].idx_q for i in joints]),
            flange_joint=int(frame.parentJoint),
            joint_from_flange=np.array(frame.placement.homogeneous),
        )
    if not arms:
        raise InputError(
            srdf.path, "no group is a serial chain of joints", "add <group><chain .../></group> for each arm"
        )
    return arms


def _joints_between(model: pin.Model, base: str, tip: str, path: Path) -> list[int]:
    """Joints that move ``tip`` but not ``base``, from the base outwards."""
    known = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    for link in (base, tip):
        if link not in known:
            raise UnknownNameError(path, "link", link, known)
    ends = [model.frames[model.getFrameId(link, pin.FrameType.BODY)].parentJoint for link in (base, tip)]
    still = set(model.supports[ends[0]])
    return [int(i) for i in model.supports[ends[1]] if i not in still]


def _serial(model: pin.Model, names: Sequence[str], path: Path) -> list[int]:
    """The movable ones of ``names``, if there are five or more and each carries the next; else nothing."""
    frames = [frame.name for frame in model.frames]
    for name in names:
        if name not in frames:
            raise UnknownNameError(path, "joint", name, tuple(model.names)[1:])
    joints = [int(model.getJointId(name)) for name in names if model.existJointName(name)]
    linked = all(model.parents[b] == a for a, b in itertools.pairwise(joints))
    return joints if len(joints) >= 5 and linked else []


def _link_below(model: pin.Model, joint: int) -> str:
    """The last link that ``joint`` carries without another joint between."""
    return str([f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY][-1])


def _disabled(model: pin.Model, srdf: Srdf) -> frozenset[frozenset[str]]:
    known = [frame.name for frame in model.frames]
    for name in itertools.chain.from_iterable(srdf.disabled):
        if name not in known:
            raise UnknownNameError(f"{srdf.path}: disable_collisions", "link", name, known)
    return frozenset(frozenset(pair) for pair in srdf.disabled)
