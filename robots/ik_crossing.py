"""Search over the last joint for six-axis arms with two parallel and two crossing joints, such as the Nextage's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..transforms import Array, invert
from .chain import Chain
from .ik_geometry import Plane, Rows, Screws, cross, rotated, turn
from .ik_newton import newton

_SPACING = 0.05  # between samples of the last joint [rad]
_NEAR_ZERO = 0.02  # a dip of the residual to this may touch zero between samples
_NEAR_FOLD = 0.3  # beside a fold the residual may still fall by this
_SLACK = 0.2  # a start may lie this far outside the limits; Newton brings it in [rad]
_STEPS = 10
_CHUNK = 32  # targets sampled at once, so that the arrays stay in the processor's cache
_SIGNS = np.array([1.0, -1.0])


class _Branch(NamedTuple):
    """Joints 0 to 2 for a value of joint 5, as turns in the complex plane, all of one shape."""

    shoulder: npt.NDArray[np.complex128]
    upper: npt.NDArray[np.complex128]
    elbow: npt.NDArray[np.complex128]
    residual: Array  # angle condition between joints 3 and 4 [1]: zero is a solution
    real: npt.NDArray[np.bool_]  # False where it had to be clamped on a fold


@dataclass(frozen=True, eq=False)
class CrossingArm:
    """Joints 1 and 2 parallel, joints 3 and 4 crossing in a point, counted from 0.

    For a given joint 5 the crossing is a known point. Its height along the direction of joints 1 and 2 gives joint 0
    (two answers), joints 1 and 2 reach it as a planar arm of two links (two answers), and the angle between the axes of
    joints 3 and 4 remains, one scalar condition: its roots over samples of joint 5, polished by Newton steps of the
    whole arm, are the configurations.

    Attributes:
        chain: The arm.
        screws: Its joint lines at zero.
        plane: Joints 1 and 2, carrying the crossing.
        wrist: (3,) the crossing of joints 3 and 4 at zero.
        samples: (k,) values of joint 5 [rad].
    """

    chain: Chain
    screws: Screws
    plane: Plane
    wrist: Array
    samples: Array

    @classmethod
    def of(cls, chain: Chain) -> CrossingArm | None:
        """The arm of ``chain``, or None where its geometry is another."""
        if chain.dof != 6 or chain.prismatic.any():
            return None
        screws = Screws.of(chain)
        wrist = screws.crossing(3, 4)
        if wrist is None or not screws.parallel(1, 2) or screws.parallel(0, 1) or screws.parallel(4, 5):
            return None
        first, last = chain.lower[5] - _SPACING, min(chain.upper[5], chain.lower[5] + 2.0 * np.pi) + _SPACING
        samples = np.linspace(first, last, int(np.ceil((last - first) / _SPACING)) + 1)
        return cls(chain, screws, Plane.of(screws, 1, carried=wrist), wrist, samples)

    def __call__(self, world_from_tip: Array) -> tuple[Array, Rows]:
        """Configurations (m, 6) and the targets (m,) they belong to, not yet checked."""
        moved = world_from_tip @ invert(self.screws.tip)  # what the six joints together do to the world
        found = [self._starts(moved[i : i + _CHUNK]) for i in range(0, len(moved), _CHUNK)]
        starts = self.chain.wrapped(np.concatenate([q for q, _ in found]))
        target = np.concatenate([rows + i * _CHUNK for i, (_, rows) in enumerate(found)])
        near = self.chain.within_limits(starts, _SLACK)
        starts, target = starts[near], target[near]
        return newton(self.chain, starts, world_from_tip[target], _STEPS), target

    def _starts(self, moved: Array) -> tuple[Array, Rows]:
        """Configurations (m, 6) close to solutions, and their targets (m,)."""
        circle = np.array([np.ones_like(self.samples), np.cos(self.samples), np.sin(self.samples)])
        wrist, pitch = self._seen(moved)
        sides = _SIGNS[:, None, None, None], _SIGNS[:, None, None]
        grid = self._branch((wrist @ circle).transpose(1, 0, 2), (pitch @ circle).transpose(1, 0, 2), *sides)
        elbow, shoulder, target, place = _crossings(grid.residual, np.broadcast_to(grid.real, grid.residual.shape))

        k = np.interp(place, np.arange(len(self.samples)), self.samples)
        circle = np.array([np.ones_like(k), np.cos(k), np.sin(k)])
        at = np.einsum("nih,hn->in", wrist[target], circle), np.einsum("nih,hn->in", pitch[target], circle)
        branch = self._branch(*at, _SIGNS[elbow], _SIGNS[shoulder])
        return self._closed(moved[target], branch, k), target

    def _seen(self, moved: Array) -> tuple[Array, Array]:
        """The crossing and the axis of joint 4 before joint 0, each as harmonics (n, 9, 3) in joints 0 and 5.

        Row 3 i + h is the coordinate along axis i of the plane and its normal, the part of it that goes with harmonic h
        (1, cos, sin) of joint 0; the columns are the harmonics of joint 5.
        """
        axes, points = self.screws.axes, self.screws.points
        frame = _harmonics(axes[0], np.vstack([self.plane.basis, self.plane.normal])).reshape(9, 3)
        arm, pitch = _harmonics(-axes[5], np.array([self.wrist - points[5], axes[4]])).transpose(0, 2, 1)
        arm = arm + np.outer(points[5], [1.0, 0.0, 0.0])
        rotation, shift = moved[:, :3, :3], moved[:, :3, 3] - points[0]
        seen = rotation @ arm
        seen[:, :, 0] += shift
        return frame @ seen, frame @ (rotation @ pitch)

    def _branch(self, wrist: Array, pitch: Array, elbow: Array, shoulder: Array) -> _Branch:
        """Joints 0 to 2 on the given sides (+-1), and what is left to solve; ``wrist`` and ``pitch`` are (9, ...)."""
        plane, axes = self.plane, self.screws.axes
        height = plane.normal @ (self.wrist - self.screws.points[0]) - wrist[6]
        size = np.maximum(wrist[7] ** 2 + wrist[8] ** 2, 1e-300)
        rest = size - height**2
        root = shoulder * np.sqrt(np.maximum(rest, 0.0))
        c = (wrist[7] * height - wrist[8] * root) / size
        s = (wrist[8] * height + wrist[7] * root) / size

        offset = plane.project(self.screws.points[0] - plane.origin)
        goal = wrist[0] + c * wrist[1] + s * wrist[2] + 1.0j * (wrist[3] + c * wrist[4] + s * wrist[5]) + offset
        reach, ratio = abs(plane.upper) * abs(plane.fore), abs(plane.fore) / abs(plane.upper)
        cosine = (np.abs(goal) ** 2 - abs(plane.upper) ** 2 - abs(plane.fore) ** 2) / (2.0 * reach)
        clipped = np.clip(cosine, -1.0, 1.0)
        angle = clipped + 1.0j * elbow * np.sqrt(1.0 - clipped**2)
        upper = _unit(goal * np.conj(plane.upper * (1.0 + ratio * angle)))
        bend = angle * np.conj(plane.fore / plane.upper) / ratio

        side = pitch[6] + c * pitch[7] + s * pitch[8]
        front = pitch[0] + c * pitch[1] + s * pitch[2] + 1.0j * (pitch[3] + c * pitch[4] + s * pitch[5])
        turned = upper * bend * plane.project(axes[3])
        residual = (plane.normal @ axes[3]) * side + (np.conj(turned) * front).real - axes[3] @ axes[4]
        return _Branch(c + 1.0j * s, upper, bend, residual, (rest >= 0.0) & (np.abs(cosine) <= 1.0))

    def _closed(self, moved: Array, branch: _Branch, q5: Array) -> Array:
        """Configurations (n, 6): joints 3 and 4 turn the axes of joints 4 and 5 to where the target has them."""
        axes = self.screws.axes
        q0, q1, q2 = np.angle(branch.shoulder), np.angle(branch.upper), self.plane.sense * np.angle(branch.elbow)
        pitch, roll = rotated(axes[5], -q5, axes[4][:, None]), np.broadcast_to(axes[5][:, None], (3, len(q5)))
        for_wrist = []
        for vector in (pitch, roll):
            seen = rotated(axes[0], -q0, np.einsum("nij,jn->in", moved[:, :3, :3], vector))
            for_wrist.append(rotated(axes[2], -q2, rotated(axes[1], -q1, seen)))
        q3 = turn(axes[3], axes[4][:, None], for_wrist[0])
        q4 = turn(axes[4], axes[5][:, None], rotated(axes[3], -q3, for_wrist[1]))
        return np.column_stack([q0, q1, q2, q3, q4, q5])


def _harmonics(axis: Array, vectors: Array) -> Array:
    """(k, 3, 3): row h of each is the vector's part that goes with 1, cos q, sin q as it turns about ``axis`` by q."""
    along = np.outer(vectors @ axis, axis)
    return np.stack([along, vectors - along, cross(axis, vectors.T).T], axis=1)


def _unit(numbers: npt.NDArray[np.complex128]) -> npt.NDArray[np.complex128]:
    """Complex ``numbers`` scaled to length one; zero stays zero."""
    return np.asarray(numbers / np.maximum(np.abs(numbers), 1e-300))


def _crossings(residual: Array, real: npt.NDArray[np.bool_]) -> tuple[Rows, Rows, Rows, Array]:
    """Elbow, shoulder, target and place along the samples where the residual (2, 2, n, k) is, or may be, zero.

    The first sample past a fold, where two branches join, has been clamped and counts as lying on it.
    """
    usable = real.copy()
    usable[..., 1:] |= real[..., :-1]
    usable[..., :-1] |= real[..., 1:]
    left, right = residual[..., :-1], residual[..., 1:]

    *change, k = np.nonzero((left * right <= 0.0) & usable[..., :-1] & usable[..., 1:])
    a, b = left[*change, k], right[*change, k]
    found = [(*change, k + a / np.where(a == b, 1.0, a - b))]

    # Two roots between samples leave no change of sign, but a dip: a parabola through three samples finds them.
    size = np.abs(residual)
    lowest = (size[..., 1:-1] <= size[..., :-2]) & (size[..., 1:-1] < size[..., 2:])
    *dip, k = np.nonzero(lowest & usable[..., :-2] & usable[..., 1:-1] & usable[..., 2:])
    before, here, after = (residual[*dip, k + i] for i in range(3))
    curve, slope = 0.5 * (before + after) - here, 0.5 * (after - before)
    below = slope**2 - 4.0 * curve * here
    same_sign = (before * here > 0.0) & (here * after > 0.0) & (here * curve > 0.0)
    hidden = same_sign & (below > -4.0 * np.abs(curve) * _NEAR_ZERO)
    dip, k, curve, slope = [side[hidden] for side in dip], k[hidden], curve[hidden], slope[hidden]
    half = np.sqrt(np.maximum(below[hidden], 0.0))
    found += [(*dip, k + 1 + (-slope + sign * half) / (2.0 * curve)) for sign in _SIGNS]

    # Beside a fold the residual falls like a square root, too steeply for its samples to tell.
    *fold, k = np.nonzero((real[..., :-1] != real[..., 1:]) & (np.minimum(size[..., :-1], size[..., 1:]) < _NEAR_FOLD))
    found += [(*fold, k + part) for part in (0.0, 0.5, 1.0)]
    elbow, shoulder, target, place = (np.concatenate(column) for column in zip(*found, strict=True))
    return elbow, shoulder, target, place
