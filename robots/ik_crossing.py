"""Search over the last joint for six-axis arms with two parallel and two crossing joints, such as the Nextage's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..transforms import Array, invert
from .chain import Chain
from .ik_geometry import Plane, Rows, Screws, cross, rotated, turn
from .ik_newton import newton

_SPACING = 0.05  # between samples of the last joint [rad]
_FINER = 12  # samples in an interval that is looked at again
_NEAR_FOLD = 0.3  # beside a fold the residual may fall by this within an interval
_NEAR_REACH = 0.05  # what is out of reach by so little at a sample may be in reach beside it
_SLACK = 0.2  # a start may lie this far outside the limits [rad]
_ROOM = 0.4  # so far outside may Newton take it, to come back or to go on on the other side of a whole turn [rad]
_STEPS = 10
_CHUNK = 32  # targets sampled at once, so that the arrays stay in the processor's cache
_SIGNS = np.array([1.0, -1.0])


class _Branch(NamedTuple):
    """Joints 0 to 2 for a value of joint 5, as turns in the complex plane, all of one shape."""

    shoulder: npt.NDArray[np.complex128]
    upper: npt.NDArray[np.complex128]
    elbow: npt.NDArray[np.complex128]
    residual: Array  # angle condition between joints 3 and 4 [1]: zero is a solution
    margin: Array  # how far the crossing is in reach [1]; below zero it has been clamped to the boundary of reach


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
        roomy = replace(self.chain, lower=self.chain.lower - _ROOM, upper=self.chain.upper + _ROOM)
        return newton(roomy, starts, world_from_tip[target], _STEPS), target

    def _starts(self, moved: Array) -> tuple[Array, Rows]:
        """Configurations (m, 6) close to solutions, and their targets (m,)."""
        wrist, pitch = self._seen(moved)
        coarse = self._branch(wrist, pitch, self.samples, _SIGNS[:, None, None, None], _SIGNS[:, None, None])
        change, _, doubtful = _scan(coarse.residual, coarse.margin)
        *sides, target, k = np.nonzero(change | doubtful)

        # Look closer there: what is still in doubt gets a start as well.
        elbow, shoulder = _SIGNS[sides]
        step = (self.samples[1] - self.samples[0]) / _FINER
        near = self.samples[k][:, None] + step * np.arange(_FINER + 1)
        fine = self._branch(wrist[target], pitch[target], near, elbow[:, None], shoulder[:, None])
        change, place, doubtful = _scan(fine.residual, fine.margin)
        row, k = np.nonzero(change | doubtful)
        q5 = near[row, k] + step * place[row, k]

        target, elbow, shoulder = target[row], elbow[row, None], shoulder[row, None]
        branch = self._branch(wrist[target], pitch[target], q5[:, None], elbow, shoulder)
        return self._closed(moved[target], branch, q5), target

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

    def _branch(self, wrist: Array, pitch: Array, q5: Array, elbow: Array, shoulder: Array) -> _Branch:
        """Joints 0 to 2 on the given sides (+-1) for values of joint 5, (k,) or (n, k), and what is left to solve."""
        plane, axes = self.plane, self.screws.axes
        circle = np.stack([np.ones_like(q5), np.cos(q5), np.sin(q5)], axis=-2)
        wrist, pitch = (wrist @ circle).transpose(1, 0, 2), (pitch @ circle).transpose(1, 0, 2)
        height = plane.normal @ (self.wrist - self.screws.points[0]) - wrist[6]
        size = np.maximum(np.hypot(wrist[7], wrist[8]), 1e-300)
        rise = np.clip(height / size, -1.0, 1.0)
        run = shoulder * np.sqrt(1.0 - rise**2)
        c, s = (wrist[7] * rise - wrist[8] * run) / size, (wrist[8] * rise + wrist[7] * run) / size

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
        margin = 1.0 - np.maximum(np.abs(height / size), np.abs(cosine))
        return _Branch(c + 1.0j * s, upper, bend, residual, np.broadcast_to(margin, residual.shape))

    def _closed(self, moved: Array, branch: _Branch, q5: Array) -> Array:
        """Configurations (n, 6): joints 3 and 4 turn the axes of joints 4 and 5 to where the target has them."""
        axes = self.screws.axes
        q0, q1, q2 = (np.broadcast_to(np.angle(joint), (len(q5), 1))[:, 0] for joint in branch[:3])
        q2 = self.plane.sense * q2
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


def _scan(residual: Array, margin: Array) -> tuple[npt.NDArray[np.bool_], Array, npt.NDArray[np.bool_]]:
    """Where the residual (..., k), sampled along its last axis, is or may be zero.

    The first sample past a fold, where two branches join at the boundary of reach, counts as lying on it.

    Returns:
        For each interval (..., k - 1): whether the residual changes sign; the place between its ends, from 0 to 1,
        where it does (else 0.5); and whether two roots may hide that leave no change of sign.
    """
    real = margin >= 0.0
    usable = real.copy()
    usable[..., 1:] |= real[..., :-1]
    usable[..., :-1] |= real[..., 1:]
    left, right = residual[..., :-1], residual[..., 1:]
    change = (left * right <= 0.0) & usable[..., :-1] & usable[..., 1:]
    place = np.where(change & (left != right), left / np.where(left == right, 1.0, left - right), 0.5)

    size, jump = np.abs(residual), np.abs(right - left)
    dip = (size[..., 1:-1] <= size[..., :-2]) & (size[..., 1:-1] <= size[..., 2:])
    dip &= usable[..., :-2] & usable[..., 1:-1] & usable[..., 2:]
    dip &= size[..., 1:-1] <= 0.5 * np.maximum(jump[..., :-1], jump[..., 1:])
    peak = (margin[..., 1:-1] >= np.maximum(margin[..., :-2], margin[..., 2:])) & ~real[..., 1:-1]
    beside = dip | (peak & (margin[..., 1:-1] > -_NEAR_REACH))
    doubtful = (real[..., :-1] != real[..., 1:]) & (np.minimum(size[..., :-1], size[..., 1:]) < _NEAR_FOLD)
    doubtful[..., 1:] |= beside
    doubtful[..., :-1] |= beside
    return change, place, doubtful
