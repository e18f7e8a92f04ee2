"""The serial chain of one arm, and its kinematics over whole arrays of configurations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from ..errors import InputError, UnknownNameError
from ..transforms import Array, invert

_Z = np.array([0.0, 0.0, 1.0])
_RIGID_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Chain:
    """Joints in a row from the world to a tip; everything else of the robot stands still.

    Attributes:
        names: Names of the joints, from the base to the tip.
        placements: (dof + 1, 4, 4) poses: the first joint frame in the world, each next one, before its motion, in the
            frame of the joint before it, and the tip in the frame of the last joint.
        axes: (dof, 3) unit axes in the joint frames; a joint turns about its axis, or slides along it.
        prismatic: (dof,) whether the joint slides.
        lower: (dof,) lower limits [rad or m].
        upper: (dof,) upper limits [rad or m].

    Raises:
        InputError: Arrays that do not fit together, axes of another length than one, or limits that are not finite.
    """

    names: tuple[str, ...]
    placements: Array
    axes: Array
    prismatic: npt.NDArray[np.bool_]
    lower: Array
    upper: Array
    _links: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        dof = len(self.names)
        shapes = (self.placements.shape, self.axes.shape, self.prismatic.shape, self.lower.shape, self.upper.shape)
        if dof == 0 or shapes != ((dof + 1, 4, 4), (dof, 3), (dof,), (dof,), (dof,)):
            raise InputError("chain", f"shapes {shapes} do not fit {dof} joints", "give one entry for each joint")
        if not np.allclose(np.linalg.norm(self.axes, axis=1), 1.0, atol=_RIGID_TOLERANCE):
            raise InputError("chain", "a joint axis is no unit vector", "divide the axes by their length")
        bounded = np.isfinite(self.lower) & np.isfinite(self.upper) & (self.lower <= self.upper)
        if not bounded.all():
            joint = self.names[int(np.argmin(bounded))]
            raise InputError("chain", f"joint {joint!r} has no finite range", "give lower <= upper, both finite")
        # With each joint frame turned so that its axis is z, a joint's motion mixes two columns of a pose, no more.
        turned = np.tile(np.eye(4), (dof + 1, 1, 1))
        turned[:dof, :3, :3] = [_turn(_Z, axis) for axis in self.axes]
        before = np.concatenate([np.eye(4)[None], invert(turned[:dof])])
        object.__setattr__(self, "_links", before @ self.placements @ turned)
        for array in (self.placements, self.axes, self.prismatic, self.lower, self.upper, self._links):
            array.setflags(write=False)

    @classmethod
    def from_model(
        cls, model: pin.Model, joint_names: Sequence[str], tip_frame: str, q_fixed: npt.ArrayLike | None = None
    ) -> Chain:
        """The chain of ``joint_names`` up to ``tip_frame``, with every other joint of the model held.

        Args:
            model: Model of the whole robot.
            joint_names: Joints of the arm, from the base to the tip, each with one degree of freedom.
            tip_frame: Frame of the model that the chain carries.
            q_fixed: (nq,) configuration of the model that holds the other joints; the neutral one when not given.

        Raises:
            InputError: A name that the model lacks, joints that do not lie in this order between the world and the
                tip, or a joint without limits or with more than one degree of freedom.
        """
        held = pin.neutral(model) if q_fixed is None else np.asarray(q_fixed, dtype=float)
        if held.shape != (model.nq,):
            raise InputError("chain q_fixed", f"shape {held.shape}", f"give the {model.nq} coordinates of the model")
        if not model.existFrame(tip_frame):
            raise UnknownNameError("chain", "frame", tip_frame, sorted({frame.name for frame in model.frames}))
        for name in joint_names:
            if not model.existJointName(name):
                raise UnknownNameError("chain", "joint", name, list(model.names)[1:])
        data = model.createData()
        pin.framesForwardKinematics(model, data, held)

        indices = [model.getJointId(name) for name in joint_names]
        frame = model.getFrameId(tip_frame)
        support = list(model.supports[model.frames[frame].parentJoint])
        if [index for index in support if index in indices] != indices:
            message = f"joints {list(joint_names)} are not in a row from the world to {tip_frame!r}"
            raise InputError("chain", message, "list them from the base to the tip")
        subspaces = np.array([_motion_subspace(model, index, held) for index in indices])
        prismatic = np.linalg.norm(subspaces[:, 3:], axis=1) < 0.5
        before = [data.oMi[model.parents[i]] * model.jointPlacements[i] for i in indices] + [data.oMf[frame]]
        after = [pin.SE3.Identity()] + [data.oMi[index] for index in indices]
        coordinates = [model.joints[index].idx_q for index in indices]
        return cls(
            names=tuple(joint_names),
            placements=np.array([a.actInv(b).homogeneous for a, b in zip(after, before, strict=True)]),
            axes=np.where(prismatic[:, None], subspaces[:, :3], subspaces[:, 3:]),
            prismatic=prismatic,
            lower=model.lowerPositionLimit[coordinates],
            upper=model.upperPositionLimit[coordinates],
        )

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.names)

    def within_limits(self, q: Array, slack: float = 0.0) -> npt.NDArray[np.bool_]:
        """(n,) whether configurations ``q`` (n, dof) keep the limits, but for ``slack`` [rad or m]."""
        return np.asarray(((q >= self.lower - slack) & (q <= self.upper + slack)).all(axis=1))

    def wrapped(self, q: Array) -> Array:
        """``q`` (n, dof) with whole turns of revolute joints added: within the limits, or as near as turns allow."""
        below = q - 2.0 * np.pi * np.where(self.prismatic, 0.0, np.ceil((q - self.upper) / (2.0 * np.pi)))
        above = below + 2.0 * np.pi
        nearer = ~self.prismatic & (self.lower - below > np.maximum(above - self.upper, 0.0))
        return np.where(nearer, above, below)

    def random(self, rng: np.random.Generator, n: int) -> Array:
        """(n, dof) configurations, evenly distributed within the limits."""
        return rng.uniform(self.lower, self.upper, (n, self.dof))

    def forward(self, q: Array) -> Array:
        """Poses world_from_tip (n, 4, 4) of configurations ``q`` (n, dof)."""
        return _poses(self.sweep(q)[-1])

    def joint_poses(self, q: Array) -> Array:
        """Poses (n, dof, 4, 4) in the world of the joint frames, after their motion, at ``q`` (n, dof)."""
        back = np.array([_turn(axis, _Z) for axis in self.axes])
        poses = np.stack([_poses(columns) for columns in self.sweep(q)[:-1]], axis=1)
        poses[..., :3, :3] = poses[..., :3, :3] @ back
        return poses

    def jacobian(self, q: Array) -> Array:
        """Jacobians (n, 6, dof): linear velocity of the tip's origin above angular velocity, along the world's axes."""
        return self.jacobian_of(self.sweep(q)).transpose(2, 0, 1)

    def sweep(self, q: Array) -> Array:
        """Frames along the chain (dof + 1, 4, 3, n): columns x, y, z, origin of each joint (z its axis), then the tip.

        The layout keeps each number of all configurations in one row, which NumPy runs over fastest; `forward` and
        `jacobian` give the usual one.
        """
        n = len(q)
        angles = np.ascontiguousarray(q.T)
        cosines, sines = np.cos(angles), np.sin(angles)
        frames = np.zeros((self.dof + 1, 4, 3, n))
        frames[0] = self._links[0].T[:, :3, None]
        for i in range(self.dof):
            x, y, z, origin = frames[i]
            if self.prismatic[i]:
                origin += z * angles[i]
            else:
                frames[i, :2] = x * cosines[i] + y * sines[i], y * cosines[i] - x * sines[i]
            np.matmul(self._links[i + 1].T, frames[i].reshape(4, -1), out=frames[i + 1].reshape(4, -1))
        return frames

    def jacobian_of(self, frames: Array) -> Array:
        """Jacobians (6, dof, n) from the ``frames`` of `sweep`."""
        jacobian = np.zeros((6, self.dof, frames.shape[-1]))
        tip = frames[-1, 3]
        for i in range(self.dof):
            _, _, axis, origin = frames[i]
            if self.prismatic[i]:
                jacobian[:3, i] = axis
            else:
                (ax, ay, az), (dx, dy, dz) = axis, tip - origin
                jacobian[:3, i] = ay * dz - az * dy, az * dx - ax * dz, ax * dy - ay * dx
                jacobian[3:, i] = axis
        return jacobian


def _turn(a: Array, b: Array) -> Array:
    """A rotation (3, 3) that takes unit vector ``a`` to ``b``."""
    return np.array(pin.Quaternion.FromTwoVectors(a, b).matrix())


def _motion_subspace(model: pin.Model, index: int, q: Array) -> Array:
    """(6,) motion of a one-degree joint in its own frame, linear above angular."""
    joint = model.joints[index]
    if (joint.nq, joint.nv) != (1, 1):
        message = f"{model.names[index]!r} is a {joint.shortname()} with {joint.nq} coordinates"
        raise InputError(
            "chain", message, "use revolute and prismatic joints with limits; give a continuous one limits"
        )
    data = joint.createData()
    joint.calc(data, q)
    return np.array(data.S, dtype=float).reshape(6)


def _poses(columns: Array) -> Array:
    """Poses (n, 4, 4) from columns (4, 3, n)."""
    poses = np.zeros((columns.shape[-1], 4, 4))
    poses[:, :3] = columns.transpose(2, 1, 0)
    poses[:, 3, 3] = 1.0
    return poses
