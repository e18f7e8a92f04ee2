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
from ..transforms import Array, checked_numbers, checked_pose
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
    """A joint of MoveIt's joint_limits.yaml; limits are in rad, rad/s and rad/s2, or m, m/s and m/s2."""

    has_position_limits: bool = False
    min_position: float = -np.inf
    max_position: float = np.inf
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
        home: str = "home",
    ) -> Robot:
        """Read a robot from its URDF and SRDF.

        Args:
            urdf: The URDF file.
            srdf: The SRDF file: serial groups become arms, the flange being the chain's tip or the link that the last
                joint of the group carries. Where it disables no collisions, the pairs are found by sampling.
            limits: MoveIt's joint_limits.yaml; accelerations that it lacks are 5 rad/s2.
            base: Pose (4, 4) of the URDF's root in the world.
            package_dirs: Folders in which ``package://`` addresses are looked up.
            home: The SRDF's state that is the home configuration; joints that it leaves out stand at zero, or at the
                limit nearest to it.

        Raises:
            InputError: A file is missing or wrong, or the files do not fit together.
        """
        parsed = read_urdf(urdf, package_dirs)
        model = parsed.model
        if not parsed.links:
            raise InputError(parsed.path, "no link has a collision shape", "give the links <collision> elements")
        if base is not None:
            base = checked_pose(base, "base")
            _place(model, parsed.geometry, base)
        semantics = read_srdf(srdf)
        acceleration = _apply_limits(model, parsed.path, limits)
        joints, placements = list(parsed.joints), parsed.placements
        if base is not None:
            fixed = np.array(joints) == 0
            placements = np.where(fixed[:, None, None], base @ placements, placements)
        links = tuple(
            Link(name, tuple(parsed.shapes[i] for i in members), placements[members], color, joints[members[0]])
            for name, members, color in _by_link(parsed.links, parsed.colors)
        )
        start = _home(model, semantics, home)
        arms = _arms(model, semantics, start)
        if semantics.disabled:
            disabled = _disabled(model, semantics)
        else:
            log.info("%s disables no collisions: the pairs that need no check are sampled", srdf)
            disabled = frozenset(frozenset(pair[:2]) for pair in disabled_collisions(model, parsed.geometry))
        return cls(Path(urdf).stem, model, links, arms, start, acceleration, disabled)

    def with_hand(self, arm: str, hand: Hand, flange_from_base: Array | None = None) -> Robot:
        """This robot with ``hand`` on the flange of ``arm``, its base at ``flange_from_base`` (4, 4).

        Raises:
            UnknownNameError: There is no such arm.
        """
        mount = np.eye(4) if flange_from_base is None else checked_pose(flange_from_base, "flange_from_base")
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
        """Places in a configuration of the joints of ``arms``, arm by arm.

        Raises:
            InputError: No arm is given, one twice, or a single name instead of several.
            UnknownNameError: There is no such arm.
        """
        names = list(arms)
        if isinstance(arms, str) or not names or len(set(names)) < len(names):
            raise InputError("arms", f"{arms!r} is no list of different arms", f"give some of {list(self.arms)}")
        return np.concatenate([self.arm(name).indices for name in names])

    def with_joints(self, q: Array, arm: str, joints: Array) -> Array:
        """Configurations (n, nq) like ``q`` (nq,) but with the joints of ``arm`` at ``joints`` (n, dof).

        Raises:
            InputError: The joints are of another shape.
            UnknownNameError: There is no such arm.
        """
        if np.shape(joints)[1:] != self.arm(arm).indices.shape:
            cure = f"give (n, {len(self.arm(arm).indices)})"
            raise InputError(f"joints of {arm}", f"shape {np.shape(joints)}", cure)
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
        """Pose (4, 4) of the flange of ``arm`` in the world at ``q`` (nq,).

        Raises:
            InputError: ``q`` has another length.
            UnknownNameError: There is no such arm.
        """
        mounted, data = self.arm(arm), self.model.createData()
        _sized(self, q, "q")
        pin.forwardKinematics(self.model, data, q)
        pose: Array = data.oMi[mounted.flange_joint].homogeneous @ mounted.joint_from_flange
        return pose

    def hand_pose(self, arm: str, q: Array, opening: float = 0.0) -> Array:
        """Pose (4, 4) of the hand frame of ``arm`` in the world at ``q`` (nq,) and ``opening`` [m]."""
        pose: Array = self.flange(arm, q) @ self.arm(arm).flange_from_hand(opening)[0]
        return pose


def _sized(robot: Robot, q: npt.ArrayLike, place: str) -> Array:
    array = checked_numbers(q, place)
    if array.shape != (robot.model.nq,):
        names = ", ".join(robot.joint_names)
        raise InputError(place, f"shape {array.shape} is no configuration", f"give {robot.model.nq} numbers: {names}")
    return array


def _checked(robot: Robot, q: npt.ArrayLike, place: str) -> Array:
    array = _sized(robot, q, place)
    inside = (array >= robot.lower - _LIMIT_SLACK) & (array <= robot.upper + _LIMIT_SLACK)
    if not inside.all():
        i = int(np.argmin(inside))
        cure = f"stay between {robot.lower[i]:.4f} and {robot.upper[i]:.4f}"
        raise InputError(place, f"joint {robot.joint_names[i]} at {array[i]:.4f} is outside its limits", cure)
    return array


def _place(model: pin.Model, geometry: pin.GeometryModel, base: Array) -> None:
    """Move everything that hangs on the world to ``base``."""
    world = pin.SE3(base)
    for i in range(1, model.njoints):
        if model.parents[i] == 0:
            model.jointPlacements[i] = world * model.jointPlacements[i]
    for frame in list(model.frames)[1:]:
        if frame.parentJoint == 0:
            frame.placement = world * frame.placement
    for entry in geometry.geometryObjects:
        if entry.parentJoint == 0:
            entry.placement = world * entry.placement


def _apply_limits(model: pin.Model, urdf: Path, path: str | Path | None) -> Array:
    """Set the position and velocity limits of ``path`` in the model; return the acceleration limits (nq,)."""
    acceleration = np.full(model.nv, DEFAULT_ACCELERATION)
    names = list(model.names)[1:]
    velocity = np.array(model.velocityLimit)
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    if path is None:
        log.warning("no joint limits file: accelerations are taken as %g rad/s2", DEFAULT_ACCELERATION)
    else:
        for name, limit in read_yaml(Path(path), LimitsFile).joint_limits.items():
            if name not in names:
                raise UnknownNameError(path, "joint", name, names)
            numbers = limit.min_position, limit.max_position, limit.max_velocity, limit.max_acceleration
            if np.isnan(numbers).any():
                raise InputError(f"{path}: joint_limits.{name}", "a limit is no number", "give numbers")
            i = names.index(name)
            if limit.has_position_limits:
                lower[i], upper[i] = max(lower[i], limit.min_position), min(upper[i], limit.max_position)
            if limit.has_velocity_limits:
                velocity[i] = limit.max_velocity
            if limit.has_acceleration_limits:
                acceleration[i] = limit.max_acceleration
    wrong = ~(np.isfinite(velocity) & (velocity > 0) & np.isfinite(acceleration) & (acceleration > 0))
    if wrong.any():
        problem = f"joint {names[int(np.argmax(wrong))]} has no positive velocity or acceleration limit"
        raise InputError(path or urdf, problem, "give one in the URDF or in the joint limits file")
    if not (lower <= upper).all():
        problem = f"joint {names[int(np.argmin(lower <= upper))]} has no position within its limits"
        raise InputError(path or urdf, problem, "give a lower limit below the upper one")
    model.velocityLimit, model.lowerPositionLimit, model.upperPositionLimit = velocity, lower, upper
    return acceleration


def _by_link(names: Sequence[str], colors: Array) -> list[tuple[str, list[int], Array]]:
    """Links in the order of their first shape, with the places of their shapes and the color of the first."""
    places = {name: [i for i, other in enumerate(names) if other == name] for name in dict.fromkeys(names)}
    return [(name, members, colors[members[0]]) for name, members in places.items()]


def _home(model: pin.Model, srdf: Srdf, wanted: str) -> Array:
    """The state called ``wanted``, joints that it leaves out at zero or at the limit nearest to it."""
    if wanted not in srdf.states:
        if wanted != "home":
            raise UnknownNameError(srdf.path, "group_state", wanted, tuple(srdf.states))
        log.warning("%s has no state 'home' (it has %s): all joints at zero", srdf.path, list(srdf.states))
    home = np.clip(np.zeros(model.nq), model.lowerPositionLimit, model.upperPositionLimit)
    names = list(model.names)[1:]
    for state, joints in srdf.states.items():
        for name, value in joints.items():
            if name not in names:
                raise UnknownNameError(f"{srdf.path}: group_state {state}", "joint", name, names)
            if state == wanted:
                home[names.index(name)] = value
    inside = (home >= model.lowerPositionLimit - _LIMIT_SLACK) & (home <= model.upperPositionLimit + _LIMIT_SLACK)
    if not inside.all():
        name = names[int(np.argmin(inside))]
        raise InputError(f"{srdf.path}: {wanted}", f"joint {name} is outside its limits", "choose one within them")
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
            tip = _child_of(model, group.joints[-1]) if joints else ""
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


def _child_of(model: pin.Model, joint: str) -> str:
    """The child link of ``joint``, which may be fixed."""
    links = (frame for frame in model.frames if frame.type == pin.FrameType.BODY)
    return str(next(link.name for link in links if model.frames[link.parentFrame].name == joint))


def _disabled(model: pin.Model, srdf: Srdf) -> frozenset[frozenset[str]]:
    known = [frame.name for frame in model.frames]
    for name in itertools.chain.from_iterable(srdf.disabled):
        if name not in known:
            raise UnknownNameError(f"{srdf.path}: disable_collisions", "link", name, known)
    return frozenset(frozenset(pair) for pair in srdf.disabled)
