"""Closed form for six-axis arms with three parallel joints in the middle, such as those of Universal Robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..transforms import Array, invert
from .chain import Chain
from .ik_geometry import Plane, Rows, Screws, cross, projection_roots, rotated, turn

_ALIGNED = 1e-7  # below this sine between joint 5 and the three, their angles trade freely
_FREE_TURNS = np.linspace(-np.pi, np.pi, 16, endpoint=False)


@dataclass(frozen=True, eq=False)
class ParallelArm:
    """Joints 1, 2 and 3 parallel, joints 4 and 5 crossing in a point, counted from 0: at most eight branches.

    Attributes:
        chain: The arm.
        screws: Its joint lines at zero.
        plane: Joints 1 and 2, carrying a point of joint 3.
        wrist: (3,) the point where joints 4 and 5 cross, at zero.
    """

    chain: Chain
    screws: Screws
    plane: Plane
    wrist: Array

    @classmethod
    def of(cls, chain: Chain) -> ParallelArm | None:
        """The arm of ``chain``, or None where its geometry is another."""
        if chain.dof != 6 or chain.prismatic.any():
            return None
        screws = Screws.of(chain)
        wrist = screws.crossing(4, 5)
        middle = screws.parallel(1, 2) and screws.parallel(1, 3)
        if wrist is None or not middle or screws.parallel(0, 1) or screws.parallel(3, 4):
            return None
        return cls(chain, screws, Plane.of(screws, 1, carried=screws.points[3]), wrist)

    def __call__(self, world_from_tip: Array) -> tuple[Array, Rows]:
        """Configurations (m, 6) and the targets (m,) they belong to, not yet checked, joint limits aside."""
        axes, plane = self.screws.axes, self.plane
        shoulder, wrist = self.screws.points[0][:, None], self.wrist[:, None]
        normal, across = plane.normal[:, None], plane.basis[0][:, None]
        moved = world_from_tip @ invert(self.screws.tip)  # what the six joints together do to the world
        rotation, shift = np.ascontiguousarray(moved[:, :3, :3].transpose(1, 2, 0)), moved[:, :3, 3].T

        # Joints 1 to 3 keep the wrist's height along their common direction: that leaves joint 0.
        reached = _turned(rotation, wrist) + shift - shoulder
        q0, target = projection_roots(axes[0], normal, reached, (normal.T @ (wrist - shoulder))[0])

        # Seen from the tip, their common direction depends on joints 4 and 5 alone.
        seen = _turned(rotation.transpose(1, 0, 2)[..., target], rotated(axes[0], q0, normal))
        q4, row = projection_roots(axes[4], axes[5][:, None], normal, axes[5] @ seen)
        seen = seen[:, row]
        q5 = turn(axes[5], seen, rotated(axes[4], -q4, normal))
        free = np.linalg.norm(cross(axes[5], seen), axis=0) < _ALIGNED
        branch = np.repeat(np.arange(len(row)), np.where(free, len(_FREE_TURNS), 1))
        q5 = q5[branch]
        q5[free[branch]] = np.tile(_FREE_TURNS, free.sum())
        q4, row = q4[branch], row[branch]
        q0, target = q0[row], target[row]

        # Without joint 0 and the wrist, a planar arm of two links and a direction are left.
        rotation, shift = rotation[..., target], shift[:, target]
        point = rotated(axes[5], -q5, rotated(axes[4], -q4, self.screws.points[3][:, None] - wrist)) + wrist
        elbow = rotated(axes[0], -q0, _turned(rotation, point) + shift - shoulder) + shoulder
        heading = rotated(axes[5], -q5, rotated(axes[4], -q4, across))
        heading = rotated(axes[0], -q0, _turned(rotation, heading))
        q1, q2, row = plane.elbows(plane.project(elbow - plane.origin[:, None]))
        bend = turn(plane.normal, across, heading)[row] - q1 - plane.sense * q2
        q3 = np.sign(plane.normal @ axes[3]) * bend
        q = np.column_stack([q0[row], q1, q2, q3, q4[row], q5[row]])
        if free.any():
            branch = 2 * branch[row] + np.repeat([0, 1], len(row) // 2)  # the elbow makes two of each
            order = np.lexsort((~self.chain.within_limits(self.chain.wrapped(q)), branch))
            _, first = np.unique(branch[order], return_index=True)
            q, row = q[order[first]], row[order[first]]
        return q, target[row]


def _turned(rotation: Array, vectors: Array) -> Array:
    """``vectors`` (3, n) or (3, 1) turned by ``rotation`` (3, 3, n)."""
    return np.asarray(np.einsum("ijn,jn->in", rotation, np.broadcast_to(vectors, (3, rotation.shape[-1]))))
