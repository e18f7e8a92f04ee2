"""One trial: a hand closes on a part that lies on a table, lifts it, and is shaken.

All is seen from the hand: it stands still while the table sinks, and what it would feel of its own accelerations acts
on the part as inertial forces (d'Alembert).
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np

from ..grasping.grasps import GraspSet
from ..robots.hand import Hand, Lip
from ..transforms import Array, invert, rotation_angle, transform_points
from .world import SURFACE, TIME_STEP, World, quaternion

GRAVITY = 9.81  # m/s2
LIFT, LIFT_TIME = 0.1, 0.4  # m, s
SHAKE, TWIST, SHAKE_TIME = 5.0, 20.0, 0.08  # m/s2 along and rad/s2 about each axis, a period each [s]
_HELD_STEP = 1e-3  # s, of simulation once the part is held
_LOST, _TURNED = 0.01, np.radians(20.0)  # m, rad: who moves farther in the hand is not held
_PATIENCE = 0.2  # s from when the fingers should be closed
_FREE = 5e-4  # m, of the opening: how near fingers come before there is anything to simulate
_STILL = 2e-3  # m/s, opening per time: slower fingers have closed
_ABOVE, _PRESSING, _PRESS_TIME = 5e-3, 5.0, 0.2  # m, N and s: where a cup comes from, how it presses, how long it takes
_FIXED = 1e4  # N
_RAYS = 24  # around a lip
_LOOK = 5e-3  # s from one look at the fingers to the next


class Outcome(NamedTuple):
    """What became of a part.

    Attributes:
        shift: (3,) way of the centre of mass while the fingers closed, along the table's x and y and upwards [m].
        turn: By which the part turned while they closed [rad].
        slip: Way of the centre of mass in the hand from then until it was lifted [m].
        slip_turn: Turn of the part in the hand meanwhile [rad].
        lifted: Whether the hand had it after lifting.
        held: Whether the hand had it after shaking too.
    """

    shift: Array
    turn: float
    slip: float
    slip_turn: float
    lifted: bool
    held: bool


def try_grasp(
    world: World, hand: Hand, grasps: GraspSet, i: int, surface_from_part: Array, aside: Array | None = None
) -> Outcome:
    """The outcome of grasp ``i`` on a part that rests on the table.

    Args:
        world: The part and the hand.
        hand: The hand.
        grasps: Grasps of the part by the hand.
        i: Which of them.
        surface_from_part: Pose (4, 4) of the part on the table.
        aside: How far the part lies off (3,), in the frame of the table [m]; where it should be unless given.
    """
    base_from_hand = hand.base_from_hand(grasps.opening[i : i + 1])[0]
    base_from_part = base_from_hand @ invert(grasps.part_from_hand[i])
    table = base_from_part @ invert(surface_from_part)
    if aside is not None:
        base_from_part[:3, 3] += table[:3, :3] @ aside
    trial = _Trial(world, base_from_part, table)
    rest = trial.part()
    if hand.lip is None:
        trial.close(hand, grasps.opening[i], grasps.approach_opening[i])
    else:
        trial.suck(hand.lip, base_from_hand)
    grasped = trial.part()
    trial.lift()
    lifted = trial.part()
    has_it = trial.has(grasped)
    if has_it:
        trial.shake(base_from_hand)
    return Outcome(
        shift=trial.table[:3, :3].T @ (trial.center(grasped) - trial.center(rest)),
        turn=_angle(rest, grasped),
        slip=float(np.linalg.norm(trial.center(lifted) - trial.center(grasped))),
        slip_turn=_angle(grasped, lifted),
        lifted=has_it,
        held=has_it and trial.has(grasped),
    )


class _Trial:
    """The state of a trial, in the frame of the hand's base."""

    def __init__(self, world: World, base_from_part: Array, table: Array) -> None:
        self.world, self.model, self.table = world, world.model, table
        self.model.opt.timestep = TIME_STEP
        self.data = mujoco.MjData(self.model)
        self.data.mocap_pos[0], self.data.mocap_quat[0] = table[:3, 3], quaternion(table[:3, :3])
        at = world.free[0]
        self.data.qpos[at : at + 3], self.data.qpos[at + 3 : at + 7] = (
            base_from_part[:3, 3],
            quaternion(base_from_part[:3, :3]),
        )
        self.up = table[:3, 2]
        self.model.opt.gravity = -GRAVITY * self.up

    def close(self, hand: Hand, opening: float, approach_opening: float) -> None:
        """Drive the fingers at the hand's speed until they stand, with no more than its force."""
        first, leader = self.world.joints, hand.mechanism.leader
        start = approach_opening
        for start in np.arange(approach_opening, opening, -_FREE):
            # What is not touched does not move: until then there is nothing to simulate.
            self.open_to(hand, max(start - _FREE, opening))
            if self.met():
                break
        self.open_to(hand, start)
        near = np.clip([opening - 1e-4, opening + 1e-4], *hand.stroke)
        low, high = hand.joint_positions(near)[:, leader]
        per_opening = (high - low) / (near[1] - near[0])  # of the driver's position
        force = hand.grip_force / abs(per_opening)  # the motor's work is that of the pads on their way
        self.model.actuator_forcerange[0] = -force, force
        self.data.ctrl[0] = -2.0 * hand.speed * per_opening
        still = _STILL * abs(per_opening) * _LOOK
        for _ in range(round(((start - opening) / (2.0 * hand.speed) + _PATIENCE) / _LOOK)):
            last = self.data.qpos[first + leader]
            mujoco.mj_step(self.model, self.data, round(_LOOK / TIME_STEP))
            if abs(self.data.qpos[first + leader] - last) <= still and self.touching():
                break

    def open_to(self, hand: Hand, opening: float) -> None:
        """Put the fingers where they are at an opening, and see what they touch there."""
        first = self.world.joints
        self.data.qpos[first : first + len(hand.joint_names)] = hand.joint_positions([opening])[0]
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)

    def suck(self, lip: Lip, base_from_hand: Array) -> None:
        """Press the cup on the part, evacuate it if the lip lies on the part all around, and hold it there."""
        self.data.qpos[self.world.joints] = -_ABOVE
        self.model.geom_adhesion[:] = 0.0
        self.model.actuator_forcerange[0] = -_PRESSING, _PRESSING
        steps = round(_PRESS_TIME / TIME_STEP)
        for down in np.minimum(np.linspace(-_ABOVE, _ABOVE / 2.0, steps), 0.0):  # comes, then stays
            self.data.ctrl[0] = down
            mujoco.mj_step(self.model, self.data)
        self.data.ctrl[0] = self.data.qpos[self.world.joints]
        self.model.actuator_forcerange[0] = -_FIXED, _FIXED
        sealed = self.sealed(lip, base_from_hand)
        self.model.geom_adhesion[list(self.world.lip)] = lip.force / len(self.world.lip) if sealed else 0.0
        mujoco.mj_step(self.model, self.data, steps // 4)

    def sealed(self, lip: Lip, base_from_hand: Array) -> bool:
        """Whether the surface lies within what the lip gives, all around it."""
        angles = 2.0 * np.pi * np.arange(_RAYS) / _RAYS
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(_RAYS)], axis=1) * lip.radius
        ring[:, 2] -= _ABOVE
        approach = base_from_hand[:3, 2]
        at = self.data.qpos[self.world.joints] * approach
        met, groups = np.zeros(1, dtype=np.int32), np.zeros(mujoco.mjNGROUP, dtype=np.uint8)
        groups[SURFACE] = 1
        for start in transform_points(base_from_hand, ring) + at:
            way = mujoco.mj_ray(self.model, self.data, start, approach, groups, 1, self.world.pads[0], met)
            of_part = met[0] >= 0 and self.model.geom_bodyid[met[0]] == self.world.part
            if not of_part or abs(way - _ABOVE) > lip.compliance:
                return False
        return True

    def lift(self) -> None:
        """Let the table sink as a hand rises that starts and stops smoothly."""
        self.model.opt.timestep = _HELD_STEP
        steps = round(LIFT_TIME / _HELD_STEP)
        s = (np.arange(steps) + 1.0) / steps
        way = LIFT * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        acceleration = LIFT / LIFT_TIME**2 * s * (60.0 - 180.0 * s + 120.0 * s**2)
        for down, felt in zip(way, acceleration, strict=True):
            self.data.mocap_pos[0] = self.table[:3, 3] - down * self.up
            self.model.opt.gravity = -(GRAVITY + felt) * self.up
            mujoco.mj_step(self.model, self.data)
        self.model.opt.gravity = -GRAVITY * self.up

    def shake(self, base_from_hand: Array) -> None:
        """Shake the hand along each of its axes, then about each."""
        steps = round(SHAKE_TIME / _HELD_STEP)
        wave = np.sin(2.0 * np.pi * (np.arange(steps) + 0.5) / steps)
        mass, inertia = self.model.body_mass[self.world.part], self.model.body_inertia[self.world.part]
        force = self.data.xfrc_applied[self.world.part]
        for axis in base_from_hand[:3, :3].T:
            for now in wave:
                force[:3] = -mass * SHAKE * now * axis
                mujoco.mj_step(self.model, self.data)
        for axis in base_from_hand[:3, :3].T:
            for now in wave:
                principal = self.data.ximat[self.world.part].reshape(3, 3)
                arm = self.data.xipos[self.world.part] - base_from_hand[:3, 3]
                force[:3] = -mass * TWIST * now * np.cross(axis, arm)
                force[3:] = -TWIST * now * (principal * inertia) @ principal.T @ axis
                mujoco.mj_step(self.model, self.data)
        force[:] = 0.0

    def part(self) -> Array:
        """Pose (4, 4) of the part."""
        at = self.world.free[0]
        pose = np.eye(4)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, self.data.qpos[at + 3 : at + 7])
        pose[:3, :3], pose[:3, 3] = rotation.reshape(3, 3), self.data.qpos[at : at + 3]
        return pose

    def center(self, pose: Array) -> Array:
        """Centre of mass (3,) of the part at a pose."""
        center: Array = pose[:3, :3] @ self.model.body_ipos[self.world.part] + pose[:3, 3]
        return center

    def has(self, grasped: Array) -> bool:
        """Whether fingers of both sides touch the part, and it is where it was grasped."""
        now = self.part()
        near = np.linalg.norm(self.center(now) - self.center(grasped)) < _LOST and _angle(grasped, now) < _TURNED
        return bool(near) and self.touching()

    def met(self) -> set[int]:
        """Bodies of the hand that touch the part."""
        if self.data.ncon == 0:
            return set()
        bodies = self.model.geom_bodyid[self.data.contact.geom]
        met = set(bodies[(bodies == self.world.part).any(axis=1)].ravel().tolist())
        return met - {self.world.part, self.world.table}

    def touching(self) -> bool:
        """Whether the single finger and another touch the part, or the cup does."""
        met = self.met()
        single, *others = self.world.pads
        return single in met and (not others or not met.isdisjoint(others))


def _angle(one: Array, other: Array) -> float:
    """Angle [rad] between two poses."""
    return float(rotation_angle(one[:3, :3].T @ other[:3, :3]))
