"""Which hands are clear of bodies and of each other: boxes around their pieces first, exact shapes where boxes meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from ..robots.hand import Hand
from ..robots.rigid import Rigid
from ..transforms import Array, invert

Mask = npt.NDArray[np.bool_]
_PARALLEL = 1e-9  # keeps cross products of parallel edges from separating anything by rounding


@dataclass(frozen=True, eq=False)
class Boxes:
    """Oriented boxes (...) around rigid bodies.

    Attributes:
        center: (..., 3) [m].
        axes: (..., 3, 3) unit axes, in columns.
        half: (..., 3) half sides [m].
    """

    center: Array
    axes: Array
    half: Array

    @classmethod
    def around(cls, bodies: Sequence[Rigid], poses: Array) -> Boxes:
        """Boxes (n, b) around ``bodies`` (b) at ``poses`` (n, b, 4, 4)."""
        low = np.array([body.corners.min(axis=0) for body in bodies])
        high = np.array([body.corners.max(axis=0) for body in bodies])
        return cls.of(low, high, poses)

    @classmethod
    def of(cls, low: Array, high: Array, poses: Array) -> Boxes:
        """Boxes (n, b) from lowest and highest corners (b, 3) in frames at ``poses`` (n, b, 4, 4)."""
        axes = poses[..., :3, :3]
        center = (axes @ ((low + high) / 2.0)[..., None])[..., 0] + poses[..., :3, 3]
        return cls(center, axes, np.broadcast_to((high - low) / 2.0, center.shape))

    def __getitem__(self, chosen: Any) -> Boxes:
        """The boxes that an index of NumPy chooses."""
        return Boxes(self.center[chosen], self.axes[chosen], self.half[chosen])

    def apart(self, other: Boxes) -> Mask:
        """Whether the boxes (...) lie apart, by the separating axes of two boxes (Gottschalk et al., 1996)."""
        turn = np.swapaxes(self.axes, -1, -2) @ other.axes
        gap = (np.swapaxes(self.axes, -1, -2) @ (other.center - self.center)[..., None])[..., 0]
        size = np.abs(turn) + _PARALLEL
        a, b = self.half, other.half
        apart: Mask = np.asarray((np.abs(gap) > a + (size @ b[..., None])[..., 0]).any(axis=-1))
        there = np.abs((np.swapaxes(turn, -1, -2) @ gap[..., None])[..., 0])
        apart |= (there > b + (np.swapaxes(size, -1, -2) @ a[..., None])[..., 0]).any(axis=-1)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            distance = np.abs(gap[..., None, k] * turn[..., j, :] - gap[..., None, j] * turn[..., k, :])
            reach = a[..., None, j] * size[..., k, :] + a[..., None, k] * size[..., j, :]
            u, v = [1, 2, 0], [2, 0, 1]
            reach = reach + b[..., u] * size[..., i, v] + b[..., v] * size[..., i, u]
            apart |= (distance > reach).any(axis=-1)
        return apart


@dataclass(frozen=True, eq=False)
class Hands:
    """n hands, each at one pose and opening.

    Attributes:
        pieces: The p pieces of a hand.
        poses: (n, p, 4, 4) their poses.
        boxes: (n, p) boxes around them.
    """

    pieces: tuple[Rigid, ...]
    poses: Array
    boxes: Boxes

    @classmethod
    def of(cls, hand: Hand, from_base: Array, openings: Array) -> Hands:
        """The hands with their bases at ``from_base`` (n, 4, 4) and openings (n,) [m]."""
        poses = from_base[:, None] @ hand.base_from_piece(openings)
        return cls(hand.pieces, poses, Boxes.around(hand.pieces, poses))

    def hit(
        self,
        chosen: npt.NDArray[np.intp],
        body: Rigid,
        pose: Array,
        *,
        without: Sequence[int] = (),
        margin: float = 0.0,
    ) -> Mask:
        """Which of the ``chosen`` hands (k,) touch ``body`` at ``pose`` (4, 4), or come nearer than ``margin`` [m].

        The pieces ``without`` are left out.
        """
        hits = np.zeros(len(chosen), dtype=bool)
        around = Boxes.around([body], pose[None, None])
        near = ~self.boxes[chosen].apart(replace(around, half=around.half + margin))
        near[:, list(without)] = False
        body_from_world = invert(pose)
        for piece in np.argsort(-near.sum(axis=0)):
            for i in np.flatnonzero(near[:, piece] & ~hits):
                hits[i] = body.touches(self.pieces[piece], body_from_world @ self.poses[chosen[i], piece], margin)
        return hits


def hands_hit(hand: Hand, from_base: Array, openings: Array, body: Rigid, pose: Array) -> Mask:
    """Which hands (n,) touch ``body``.

    Args:
        hand: The hand.
        from_base: Poses (n, 4, 4) of its base, in the frame in which ``pose`` is told.
        openings: Their openings (n,) [m].
        body: The body.
        pose: The body's pose (4, 4).
    """
    return Hands.of(hand, from_base, openings).hit(np.arange(len(from_base)), body, pose)


@dataclass(frozen=True, eq=False)
class HandPoses:
    """n hands, each at one pose and opening, as the convex pieces that cover them.

    Attributes:
        geometries: The p convex pieces of a hand.
        poses: (n, p, 4, 4) their poses.
        boxes: (n, p) boxes around them.
    """

    geometries: tuple[coal.CollisionGeometry, ...]
    poses: Array
    boxes: Boxes

    @classmethod
    def of(cls, hand: Hand, from_base: Array, openings: Array) -> HandPoses:
        """The hands with their bases at ``from_base`` (n, 4, 4) and openings (n,) [m]."""
        covers = [(i, cover) for i, piece in enumerate(hand.pieces) for cover in piece.cover]
        pieces = from_base[:, None] @ hand.base_from_piece(openings)
        poses = pieces[:, [i for i, _ in covers]] @ np.array([cover.placement for _, cover in covers])
        for _, cover in covers:
            cover.geometry.computeLocalAABB()
        low = np.array([np.ravel(cover.geometry.aabb_local.min_) for _, cover in covers])
        high = np.array([np.ravel(cover.geometry.aabb_local.max_) for _, cover in covers])
        return cls(tuple(cover.geometry for _, cover in covers), poses, Boxes.of(low, high, poses))

    def hit(self, other: HandPoses, pairs: npt.NDArray[np.intp]) -> Mask:
        """Which ``pairs`` (k, 2) of one of these hands and one of the other's touch (k,), by their convex covers."""
        hits = np.zeros(len(pairs), dtype=bool)
        near = self._balls_meet(other, pairs)  # (m, 3): rows of pairs, pieces of either
        rows, a, b = near.T
        i, j = pairs[rows].T
        met = near[~self.boxes[i, a].apart(other.boxes[j, b])]
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        for row, mine, theirs in met:
            if not hits[row]:
                i, j = pairs[row]
                placed = (_transform(self.poses[i, mine]), _transform(other.poses[j, theirs]))
                result.clear()
                hits[row] = coal.collide(
                    self.geometries[mine], placed[0], other.geometries[theirs], placed[1], request, result
                )
        return hits

    def _balls_meet(self, other: HandPoses, pairs: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
        """Rows of ``pairs`` with the pieces of either hand whose balls meet (m, 3)."""
        i, j = pairs.T
        apart = np.linalg.norm(self.boxes.center[i][:, :, None] - other.boxes.center[j][:, None], axis=-1)
        mine, theirs = (np.linalg.norm(hands.boxes.half[0], axis=-1) for hands in (self, other))
        return np.argwhere(apart <= mine[:, None] + theirs)


def _transform(pose: Array) -> coal.Transform3s:
    return coal.Transform3s(pose[:3, :3], pose[:3, 3])
