"""Where every rigid body of a plan is, moment by moment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError, UnknownNameError
from ..robots.chain import Chain
from ..robots.robot import Robot
from ..robots.trajectory import Trajectory
from ..transforms import Array, checked_poses, invert
from .document import Action, Motion, Plan

_OVERSHOOT = 1e-4  # m that a curve of openings may leave the stroke by between its samples


@dataclass(frozen=True, eq=False)
class Film:
    """Poses of the rigid bodies of a plan on one clock.

    Attributes:
        names: Names of the bodies: the robot's links, the hands' pieces (``arm/piece``), the parts.
        times: Moments (n,) from the plan's start on [s].
        poses: Poses (n, bodies, 4, 4) in the world: of a link the frame of the joint that moves it, of a piece and a
            part its own.
    """

    names: tuple[str, ...]
    times: Array
    poses: Array

    def of(self, name: str) -> Array:
        """Poses (n, 4, 4) of one body in the world."""
        poses: Array = self.poses[:, self.names.index(name)]
        return poses


def film(plan: Plan, robot: Robot, rate: float) -> Film:
    """Every body of ``plan``, at least ``rate`` times a second and at the start, end and events of every action.

    Args:
        plan: The plan.
        robot: Its robot, with its hands.
        rate: Moments a second [1/s].

    Raises:
        InputError: The plan has no action, or does not fit together or to the robot.
    """
    if not plan.actions:
        raise InputError("plan", "it has no action", "give a plan in which something moves")
    check_names(plan, robot)
    parts = tuple(plan.actions[0].start.poses)
    pieces = [f"{arm}/{piece.name}" for arm, hand in robot.hands.items() for piece in hand.pieces]
    chains = _chains(robot)
    times, poses, start = [np.zeros(1)], [], 0.0
    for i, action in enumerate(plan.actions):
        moments = _moments(action, rate)
        shot = _shot(action, robot, chains, parts, curve(plan.joints, action.motion), moments)
        poses.append(shot if i == 0 else shot[1:])  # an action starts where the one before ends
        times.append(start + moments[1:])
        start += action.motion.duration
    names = (*(link.name for link in robot.links), *pieces, *parts)
    return Film(names, np.concatenate(times), np.concatenate(poses))


def check_names(plan: Plan, robot: Robot) -> None:
    """Whether ``plan`` moves the joints and hands of ``robot``, and always speaks of the same parts, at poses.

    Raises:
        InputError: It does not; the message tells where.
    """
    if plan.joints != robot.joint_names:
        cure = f"plan the task again: the robot has {', '.join(robot.joint_names)}"
        raise InputError("plan: joints", f"they are not those of robot {robot.name}", cure)
    parts = set(plan.meshes) & set(plan.actions[0].start.poses) if plan.actions else set()
    for i, action in enumerate(plan.actions):
        place = f"plan: actions[{i}]"
        hands = [set(action.motion.openings), set(action.motion.opening_velocities)]
        if hands != [set(robot.hands)] * 2:
            raise InputError(place, "it does not move the robot's hands", f"plan again for {sorted(robot.hands)}")
        if set(action.start.poses) != parts:
            raise InputError(place, f"it has the parts {sorted(action.start.poses)}", f"there are {sorted(parts)}")
        carried = [(part, entry.carrier) for part, entry in action.start.attached.items()]
        for part, carrier in carried + [(event.part, event.carrier) for event in action.events]:
            if part not in parts:
                raise UnknownNameError(place, "part", part, sorted(parts))
            if carrier not in parts and carrier not in robot.arms:
                raise UnknownNameError(place, "carrier", carrier, (*robot.arms, *sorted(parts)))
        carriers = [entry.carrier_from_part for entry in action.start.attached.values()]
        checked_poses([*action.start.poses.values(), *carriers], place)


def curve(joints: Sequence[str], motion: Motion) -> Trajectory:
    """The cubic Hermite curve of a motion: ``joints``, then the opening of each arm's hand, by name.

    Raises:
        InputError: Its samples do not fit together.
    """
    arms = sorted(motion.openings)
    openings, speeds = ([given[arm] for arm in arms] for given in (motion.openings, motion.opening_velocities))
    try:
        positions = np.column_stack([motion.positions, *openings])
        velocities = np.column_stack([motion.velocities, *speeds])
    except ValueError as error:
        problem = f"positions, velocities or openings are not as many as the samples ({error})"
        raise InputError("plan: motion", problem, "plan the task again") from error
    names = (*joints, *map(opening_of, arms))
    return Trajectory(names, np.array(motion.times), positions, velocities)


def opening_of(arm: str) -> str:
    """What the opening of an arm's hand is called among joints."""
    return f"{arm}/opening"


def _moments(action: Action, rate: float) -> Array:
    """Times (n,) of an action at which it is looked at [s]: evenly, and at its events."""
    duration = action.motion.duration
    even = np.linspace(0.0, duration, int(np.ceil(duration * rate)) + 1)
    moments: Array = np.union1d(even, np.clip([event.time for event in action.events], 0.0, duration))
    return moments


_Chains = Mapping[int, tuple[Chain, npt.NDArray[np.intp]]]


def _chains(robot: Robot) -> _Chains:
    """For each joint that moves a link or a flange: the chain up to it, and the places of its joints."""
    model = robot.model
    moving = {link.joint for link in robot.links} | {arm.flange_joint for arm in robot.arms.values()}
    chains = {}
    for joint in moving - {0}:
        row = list(model.supports[joint])[1:]
        names = [str(model.names[i]) for i in row]
        chains[joint] = Chain.from_model(model, names, names[-1]), np.array(row) - 1
    return chains


def _shot(
    action: Action, robot: Robot, chains: _Chains, parts: Sequence[str], motion: Trajectory, moments: Array
) -> Array:
    """Poses (n, bodies, 4, 4) of everything at ``moments`` (n,) of one action."""
    states = motion.sample(moments)
    still = np.tile(np.eye(4), (len(moments), 1, 1))
    joints = {joint: chain.forward(states[:, places]) for joint, (chain, places) in chains.items()} | {0: still}
    flanges = {name: joints[arm.flange_joint] @ arm.joint_from_flange for name, arm in robot.arms.items()}
    bodies = [joints[link.joint][:, None] for link in robot.links]
    for name, hand in robot.hands.items():
        opening = states[:, motion.joint_names.index(opening_of(name))]
        base = flanges[name] @ robot.arms[name].flange_from_base
        bodies.append(base[:, None] @ hand.base_from_piece(within(opening, hand.stroke)))
    ridden = _ride(action, flanges, moments)
    return np.concatenate([*bodies, *(ridden[part][:, None] for part in parts)], axis=1)


def still(robot: Robot, q: Array, openings: Mapping[str, float]) -> dict[str, Array]:
    """Pose (4, 4) of every link and piece of a hand, by name, at one configuration (nq,)."""
    joints = {joint: chain.forward(q[None, places])[0] for joint, (chain, places) in _chains(robot).items()}
    joints[0] = np.eye(4)
    poses = {link.name: joints[link.joint] for link in robot.links}
    for name, hand in robot.hands.items():
        arm = robot.arms[name]
        base = joints[arm.flange_joint] @ arm.joint_from_flange @ arm.flange_from_base
        pieces = base @ hand.base_from_piece(np.array([openings[name]]))[0]
        poses.update({f"{name}/{piece.name}": at for piece, at in zip(hand.pieces, pieces, strict=True)})
    return poses


def within(opening: Array, stroke: tuple[float, float]) -> Array:
    """``opening`` (n,) without what a curve overshoots between its samples."""
    clipped: Array = np.clip(opening, *stroke)
    return np.where(np.abs(clipped - opening) < _OVERSHOOT, clipped, opening)


def _ride(action: Action, flanges: Mapping[str, Array], moments: Array) -> dict[str, Array]:
    """Poses (n, 4, 4) of each part at ``moments`` (n,): with its carrier, or where it stands."""
    carriers: dict[str, tuple[str, Array]] = {
        part: (entry.carrier, np.array(entry.carrier_from_part)) for part, entry in action.start.attached.items()
    }
    standing = {part: np.tile(np.array(pose), (len(moments), 1, 1)) for part, pose in action.start.poses.items()}

    def world_from(body: str, *above: str) -> Array:
        if body in flanges:
            return flanges[body]
        if body in above:
            raise InputError("plan", f"{body} carries itself", "plan the task again")
        if body in carriers:
            carrier, carrier_from_body = carriers[body]
            return world_from(carrier, body, *above) @ carrier_from_body
        return standing[body]

    poses = {part: world_from(part) for part in standing}
    for event in action.events:
        now = int(np.searchsorted(moments, min(event.time, moments[-1])))
        here = world_from(event.part)[now]
        if event.kind == "attach":
            carriers[event.part] = event.carrier, invert(world_from(event.carrier)[now]) @ here
        elif carriers.get(event.part, ("", here))[0] == event.carrier:  # else another hand holds it by now
            del carriers[event.part]
            standing[event.part] = np.tile(here, (len(moments), 1, 1))
        poses = {part: np.concatenate([poses[part][:now], world_from(part)[now:]]) for part in poses}
    return poses
