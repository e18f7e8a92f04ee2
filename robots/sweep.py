"""How far bodies really move along a joint path, so that collision checks can be spaced by millimetres of motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..transforms import Array, transform_points
from .chain import Chain
from .scene import Scene
from .state import SceneState

_SAFETY = 0.9


@dataclass(frozen=True, eq=False)
class _ArmPoints:
    """Points that an arm moves: ``points[i]`` (k, 3) in the frame of its joint i; bounds on |d2p / dqi dqj| of any."""

    arm: str
    points: tuple[Array, ...]
    curvature: Array


class Sweep:
    """Motion of the links, hands and carried bodies of some arms, told by the corners of their bounding boxes.

    Between two configurations a rigid body moves no point farther than the farthest of the corners of a box around it;
    along the way a point leaves the chord of its motion by at most an eighth of its second derivative.
    """

    def __init__(self, scene: Scene, state: SceneState, arms: Sequence[str]) -> None:
        self._robot = scene.robot
        self._arms = [_arm_points(scene, state, name) for name in arms]

    def positions(self, q: Array) -> Array:
        """Positions (n, points, 3) of the corners at configurations ``q`` (n, nq) [m]."""
        moved = []
        for entry in self._arms:
            arm = self._robot.arms[entry.arm]
            poses = arm.chain.joint_poses(q[:, arm.indices])
            moved += [transform_points(poses[:, i], points) for i, points in enumerate(entry.points)]
        return np.concatenate(moved, axis=1)

    def bounds(self, path: Array) -> Array:
        """For each step of ``path`` (k, nq), a bound (k - 1,) on the way of any point of any body [m]."""
        corners = self.positions(path)
        chords: Array = np.linalg.norm(np.diff(corners, axis=0), axis=-1).max(axis=1, initial=0.0)
        return chords + self._deviations(np.abs(np.diff(path, axis=0)))

    def refined(self, path: Array, shares: Array, step: float) -> tuple[Array, Array]:
        """``path`` (k, nq) with configurations put between until no point moves farther than ``step`` [m] at once.

        Also ``shares`` (k,), any numbers that go with the path, put between likewise.
        """
        both = np.concatenate([path, shares[:, None]], axis=1)
        while True:
            bounds = self.bounds(both[:, :-1])
            if (bounds <= step).all():
                return both[:, :-1], both[:, -1]
            parts = np.maximum(np.ceil(bounds / (_SAFETY * step)), 1).astype(int)
            both = split(both, np.where(bounds <= step, 1, parts))

    def _deviations(self, steps: Array) -> Array:
        """How far (k,) a point may leave its chord for joint motions ``steps`` (k, nq)."""
        worst = np.zeros(len(steps))
        for entry in self._arms:
            turns = steps[:, self._robot.arms[entry.arm].indices]
            worst = np.maximum(worst, np.einsum("ki,ij,kj->k", turns, entry.curvature, turns) / 8.0)
        return worst


def _arm_points(scene: Scene, state: SceneState, name: str) -> _ArmPoints:
    robot, arm = scene.robot, scene.robot.arms[name]
    chain_joints = [robot.model.getJointId(joint) for joint in arm.chain.names]
    carried: dict[int, list[Array]] = {joint: [] for joint in chain_joints}
    for link in robot.links:
        if link.joint in carried:
            carried[link.joint].append(link.corners)
    if arm.hand is not None:
        base = arm.joint_from_flange @ arm.flange_from_base
        for piece, pose in zip(arm.hand.pieces, arm.hand.base_from_piece(state.openings[name])[0], strict=True):
            carried[arm.flange_joint].append(transform_points(base @ pose, piece.corners))
    for body in scene.bodies.values():
        carrier, pose = state.carrier(body.name)
        if carrier == name:
            carried[arm.flange_joint].append(transform_points(arm.joint_from_flange @ pose, body.corners))
    points = tuple(np.concatenate(carried[joint] or [np.zeros((1, 3))]) for joint in chain_joints)
    return _ArmPoints(name, points, _curvature(arm.chain, points))


def _curvature(chain: Chain, points: Sequence[Array]) -> Array:
    """Bounds (dof, dof) on the length of d2p / dqi dqj of any point p, for joints i up to j.

    It is the motion of p by joint j, a slide of 1 or a turn at the distance of p, turned by joint i; 0 if that slides.
    """
    reach, beyond = np.zeros(chain.dof), 0.0
    slides = np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
    for i in range(chain.dof - 1, -1, -1):
        beyond = max(float(np.linalg.norm(points[i], axis=1).max()), beyond)
        reach[i] = beyond
        beyond += float(np.linalg.norm(chain.placements[i, :3, 3])) + float(slides[i])
    order = np.arange(chain.dof)
    earlier, later = np.minimum.outer(order, order), np.maximum.outer(order, order)
    bounds: Array = np.where(chain.prismatic[earlier], 0.0, np.where(chain.prismatic, 1.0, reach)[later])
    return bounds


def split(path: Array, parts: np.ndarray) -> Array:
    """``path`` (k, nq) with step i cut into ``parts[i]`` equal ones."""
    step = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(step)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[step]
    inner = path[step] + share[:, None] * (path[step + 1] - path[step])
    return np.concatenate([inner, path[-1:]])
