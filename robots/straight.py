"""Straight motions of a hand, for approach, retreat and insertion."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import InputError, OffLineError, UnreachableLineError
from ..transforms import Array, checked_pose, compose, pose_distance, rotation_angle
from .paths import LINEAR_STEP, PathCheck
from .scene import Scene
from .state import SceneState

_PATH_SHARE = 0.5  # of a line's tolerance; the rest is for the timing of the path
_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class LineTolerance:
    """How far a straight motion may leave its line: position [m] and angle [rad]."""

    position: float = 1e-3
    angle: float = float(np.deg2rad(1.0))

    def __post_init__(self) -> None:
        if not (0.0 < self.position < np.inf and 0.0 < self.angle < np.inf):
            raise InputError("line tolerance", f"{self.position} m and {self.angle} rad", "give numbers above 0")


_LINE_STEP = LineTolerance(10e-3, float(np.deg2rad(3.0)))  # between waypoints at first
INSERTION = LineTolerance(0.2e-3, float(np.deg2rad(0.2)))


def plan_linear(
    scene: Scene,
    state: SceneState,
    arm: str,
    world_from_hand: Array,
    *,
    tolerance: LineTolerance | None = None,
    working: Collection[str] = (),
) -> Array:
    """A straight motion of one hand from where the state has it to ``world_from_hand`` (4, 4), keeping the branch.

    Args:
        scene: The scene.
        state: Where everything is; everything but the arm stays there.
        arm: The arm that moves; what it holds moves with it.
        world_from_hand: Pose of the hand at the end, at the hand's opening in ``state``.
        tolerance: How far the motion may leave the line; 1 mm and 1 degree unless given.
        working: Arms whose hands need keep no margins, besides ``arm``.

    Returns:
        Waypoints (k, nq), the first of them the state's configuration.

    Raises:
        InputError: The pose is not rigid, the arm has no hand, or the state's configuration is outside the limits.
        UnreachableLineError: Inverse kinematics does not follow the line to its end.
        OffLineError: It does not follow it closely enough.
        BlockedError: Something touches on the way.
    """
    allowed = tolerance or LineTolerance()
    mounted = scene.robot.arm(arm)
    tip_from_hand = mounted.flange_from_hand(state.openings.get(arm, 0.0))[0]
    q = scene.robot.checked_configuration(state.q, "start")
    start = mounted.chain.forward(q[None, mounted.indices])[0]
    ends = np.stack([start @ tip_from_hand, checked_pose(world_from_hand, "end of the line")])
    length, angle = (float(value) for value in pose_distance(*ends))
    count = int(np.ceil(max(length / _LINE_STEP.position, angle / _LINE_STEP.angle, 1.0)))
    for _ in range(_ROUNDS):
        joints, reached = mounted.track(
            q[mounted.indices],
            poses_on_line(ends, np.linspace(0.0, 1.0, count + 1)),
            state.openings.get(arm, 0.0),
        )
        if reached <= count:
            raise UnreachableLineError(arm, max(reached - 1, 0) / count, length, angle)
        between = mounted.chain.forward((joints[1:] + joints[:-1]) / 2.0) @ tip_from_hand
        if on_line(between, ends, allowed, _PATH_SHARE):
            path = scene.robot.with_joints(q, arm, joints)
            PathCheck(scene, state, [arm], LINEAR_STEP, {arm, *working}).require_free(path)
            return path
        count *= 2
    raise OffLineError(arm, allowed.position, allowed.angle)


def poses_on_line(ends: Array, shares: Array) -> Array:
    """Poses (n, 4, 4) on the straight line between the two poses ``ends`` (2, 4, 4), at ``shares`` (n,) of it."""
    turn = Rotation.from_matrix(ends[0, :3, :3].T @ ends[1, :3, :3]).as_rotvec()
    turned = ends[0, :3, :3] @ Rotation.from_rotvec(shares[:, None] * turn).as_matrix()
    return compose(turned, ends[0, :3, 3] + shares[:, None] * (ends[1, :3, 3] - ends[0, :3, 3]))


def on_line(hands: Array, ends: Array, allowed: LineTolerance, share: float) -> bool:
    """Whether poses (n, 4, 4) lie on the line between ``ends`` (2, 4, 4), but for a ``share`` of what is allowed."""
    way, turn = ends[1, :3, 3] - ends[0, :3, 3], float(pose_distance(*ends)[1])
    if np.linalg.norm(way) > allowed.position:
        shares = (hands[:, :3, 3] - ends[0, :3, 3]) @ way / (way @ way)
    else:
        shares = rotation_angle(ends[0, :3, :3].T @ hands[:, :3, :3]) / max(turn, allowed.angle)
    shifts, turns = pose_distance(hands, poses_on_line(ends, np.clip(shares, 0.0, 1.0)))
    return bool((shifts <= share * allowed.position).all() and (turns <= share * allowed.angle).all())
