"""Steps that closed-form inverse kinematics are made of, over arrays: vectors are (3, n), angles (n,)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..transforms import Array
from .chain import Chain

Rows = npt.NDArray[np.intp]

_EXACT = 1e-9  # how far geometry may be off and still count as exact [1 or m]
_ROUNDING = 1e-6  # how far past a stretched arm rounding may take us; the answer is checked afterwards


@dataclass(frozen=True, eq=False)
class Screws:
    """The chain as a product of exponentials: tip = e(q_0) ... e(q_5) tip_at_zero, each e(q) a turn about a fixed line.

    Attributes:
        axes: (dof, 3) unit directions of the joints at zero.
        points: (dof, 3) a point on each [m].
        tip: (4, 4) world_from_tip at zero.
    """

    axes: Array
    points: Array
    tip: Array

    @classmethod
    def of(cls, chain: Chain) -> Screws:
        """The joint lines of ``chain`` at zero."""
        zero = np.zeros((1, chain.dof))
        frames = chain.sweep(zero)[:-1, :, :, 0]
        return cls(axes=frames[:, 2], points=frames[:, 3], tip=chain.forward(zero)[0])

    def parallel(self, i: int, j: int) -> bool:
        """Whether joints ``i`` and ``j`` are parallel or opposed."""
        return bool(np.linalg.norm(np.cross(self.axes[i], self.axes[j])) < _EXACT)

    def crossing(self, i: int, j: int) -> Array | None:
        """The point (3,) where the lines of joints ``i`` and ``j`` cross, or None."""
        if self.parallel(i, j):
            return None
        between = self.points[j] - self.points[i]
        directions = np.column_stack([self.axes[i], -self.axes[j]])
        along, _ = np.linalg.lstsq(directions, between, rcond=None)[0]
        point = self.points[i] + along * self.axes[i]
        off = np.linalg.norm(np.cross(point - self.points[j], self.axes[j]))
        return point if off < _EXACT else None


def cross(a: Array, b: Array) -> Array:
    """Cross product (3, n) of ``a`` (3,) with ``b`` (3, n)."""
    return np.cross(a, np.eye(3)).T @ b


def rotated(axis: Array, angle: Array, vectors: Array) -> Array:
    """``vectors`` (3, n) or (3, 1) turned about the unit ``axis`` (3,) by ``angle`` (n,) (Rodrigues)."""
    along = np.outer(axis, axis) @ vectors
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * cross(axis, vectors)


def turn(axis: Array, a: Array, b: Array) -> Array:
    """Angle (n,) about ``axis`` (3,) from vectors ``a`` to ``b`` (3, n), both seen along the axis."""
    sine, cosine = (cross(axis, a) * b).sum(axis=0), (a * b).sum(axis=0) - (axis @ a) * (axis @ b)
    return np.asarray(np.arctan2(sine, cosine))


def circle_roots(cosine: Array, sine: Array, value: Array) -> tuple[Array, Rows]:
    """Angles (m,) with ``cosine`` cos q + ``sine`` sin q = ``value`` (each (n,) or (1,)), and the rows (m,) they solve.

    A row has two roots or none; just past a double root it has that one twice, and where every angle serves, any two.
    """
    cosine, sine, value = np.broadcast_arrays(cosine, sine, value)
    size = np.hypot(cosine, sine)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(np.maximum(size, np.abs(value)) < _EXACT, 0.0, value / size)
    middle, half = np.arctan2(sine, cosine), np.arccos(np.clip(ratio, -1.0, 1.0))
    (rows,) = np.nonzero(np.abs(ratio) <= 1.0 + _ROUNDING)
    return np.concatenate([(middle - half)[rows], (middle + half)[rows]]), np.tile(rows, 2)


def projection_roots(axis: Array, a: Array, b: Array, value: Array) -> tuple[Array, Rows]:
    """Angles (m,) of ``a`` about ``axis`` that give it the scalar product ``value`` (n,) with ``b``, and their rows."""
    along = (axis @ a) * (axis @ b)
    return circle_roots((a * b).sum(axis=0) - along, (cross(axis, a) * b).sum(axis=0), value - along)


@dataclass(frozen=True, eq=False)
class Plane:
    """Two parallel joints as a planar two-link arm in complex numbers, seen against their common direction.

    Attributes:
        normal: (3,) direction of the first joint.
        sense: 1.0, or -1.0 where the second joint points the other way.
        basis: (2, 3) axes of the plane.
        origin: (3,) point on the first joint.
        upper: First link, from the first joint to the second.
        fore: Second link, from the second joint to the carried point.
    """

    normal: Array
    sense: float
    basis: Array
    origin: Array
    upper: complex
    fore: complex

    @classmethod
    def of(cls, screws: Screws, i: int, carried: Array) -> Plane:
        """The plane of joints ``i`` and ``i`` + 1, where the second carries the point ``carried`` (3,) at zero."""
        normal = screws.axes[i]
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        basis = np.array([first, np.cross(normal, first)])
        points = np.array([screws.points[i], screws.points[i + 1], carried]) @ basis.T @ [1.0, 1.0j]
        sense = float(np.sign(normal @ screws.axes[i + 1]))
        return cls(
            normal, sense, basis, screws.points[i], complex(points[1] - points[0]), complex(points[2] - points[1])
        )

    def project(self, vectors: Array) -> npt.NDArray[np.complex128]:
        """``vectors`` (3, ...) seen in the plane."""
        x, y = np.tensordot(self.basis, vectors, 1)
        return np.asarray(x + 1.0j * y)

    def elbows(self, goal: npt.NDArray[np.complex128]) -> tuple[Array, Array, Rows]:
        """Angles (m,) of both joints that put the carried point at ``goal`` (n,) seen in the plane, and their rows."""
        product = np.conj(self.upper) * self.fore
        value = 0.5 * (np.abs(goal) ** 2 - abs(self.upper) ** 2 - abs(self.fore) ** 2)
        second, rows = circle_roots(np.array([product.real]), np.array([-product.imag]), value)
        first = np.angle(goal[rows] * np.conj(self.upper + np.exp(1.0j * second) * self.fore))
        return first, self.sense * second, rows
