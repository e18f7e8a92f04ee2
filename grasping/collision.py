"""Hand against part, mesh against mesh: the exact answer, one bounding-volume hierarchy per rigid piece of the hand."""

from __future__ import annotations

from collections.abc import Set

import fcl
import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import cKDTree

from ..robots.hand import Hand
from ..transforms import Array, rotation_about, transform_points
from .part import Part

Mask = npt.NDArray[np.bool_]
_SAME_SHAPE = 1e-6  # m


class HandCollision:
    """Exact collision checks of one hand against one part.

    Every piece of the hand is checked against every triangle of the part: no pair is switched off.

    Attributes:
        moving: Indices of the pieces that move with the fingers.
        behind_pads: Those of them that carry no pad.
    """

    def __init__(self, part: Part, hand: Hand) -> None:
        """Build the hierarchies once."""
        self._hand = hand
        self._part = fcl.CollisionObject(_hierarchy(part.mesh))
        self._pieces = [fcl.CollisionObject(_hierarchy(piece.mesh)) for piece in hand.pieces]
        self._part_box = _box(part.mesh)
        # Small pieces away from the part answer quickest; pads, close to the part everywhere, take longest and
        # hit least.
        pads, base = {pad.joint for pad in hand.pads}, 0
        self._order = sorted(
            range(len(hand.pieces)), key=lambda k: (hand.pieces[k].joint in pads, hand.pieces[k].joint == base)
        )
        self.moving = frozenset(k for k in self._order if hand.pieces[k].joint != base)
        self.behind_pads = frozenset(k for k in self.moving if hand.pieces[k].joint not in pads)
        boxes = [_box(piece.mesh) for piece in hand.pieces]
        self._centers = np.array([center for center, _ in boxes])
        self._halves = np.array([half for _, half in boxes])

    def hand_hits(self, part_from_base: Array, openings: Array, pieces: Set[int] | None = None) -> Mask:
        """Whether the hand touches the part (n,).

        Args:
            part_from_base: (n, 4, 4) poses of the hand's base.
            openings: (n,) [m].
            pieces: Indices of the pieces to check; all unless given.
        """
        poses = part_from_base[:, None] @ self._hand.base_from_piece(openings)
        near = self._near(poses)
        hits = np.zeros(len(poses), dtype=bool)
        for k in self._order:
            if pieces is not None and k not in pieces:
                continue
            for i in np.flatnonzero(near[:, k] & ~hits):
                hits[i] = self._touches(self._pieces[k], poses[i, k, :3, :3], poses[i, k, :3, 3])
        return hits

    def cylinders_hit(self, start: Array, direction: Array, length: Array, radius: float) -> Mask:
        """Whether cylinders touch the part (n,).

        Args:
            start: (n, 3) centres of their bases [m].
            direction: (n, 3) unit axes.
            length: (n,) [m]; one that is not positive touches nothing.
            radius: [m].
        """
        hits = np.zeros(len(start), dtype=bool)
        frames = _frames_along(direction)
        centers = start + 0.5 * length[:, None] * direction
        for i in np.flatnonzero(length > 0.0):
            cylinder = fcl.CollisionObject(fcl.Cylinder(radius, length[i]))
            hits[i] = self._touches(cylinder, frames[i], centers[i])
        return hits

    def _touches(self, body: fcl.CollisionObject, rotation: Array, translation: Array) -> bool:
        body.setTransform(fcl.Transform(rotation, translation))
        return bool(fcl.collide(body, self._part, fcl.CollisionRequest(), fcl.CollisionResult()))

    def _near(self, poses: Array) -> Mask:
        """Whether the boxes of piece and part overlap along the axes of both (n, pieces)."""
        rotation, turn = poses[..., :3, :3], np.abs(poses[..., :3, :3])
        center, half = self._part_box
        gap = (rotation @ self._centers[..., None])[..., 0] + poses[..., :3, 3] - center
        along_part = half + (turn @ self._halves[..., None])[..., 0]
        along_piece = self._halves + (half @ turn)
        gap_in_piece = (np.swapaxes(rotation, -1, -2) @ gap[..., None])[..., 0]
        return np.asarray((np.abs(gap) <= along_part).all(-1) & (np.abs(gap_in_piece) <= along_piece).all(-1))


def looks_the_same_turned(hand: Hand) -> bool:
    """Whether half a turn about the approach direction maps the hand's solids onto each other, at every opening tried.

    Swapping the fingers of such a hand changes the wrist, but nothing between hand and part.
    """
    shapes = [
        (k, shape, at) for k, p in enumerate(hand.pieces) for shape, at in zip(p.shapes, p.placements, strict=True)
    ]
    if not all(shape.solid for _, shape, _ in shapes):
        return False
    half_turn = rotation_about([0.0, 0.0, 1.0], np.pi)
    for poses in hand.hand_from_piece(np.linspace(*hand.stroke, 3)):
        solids = [transform_points(poses[k] @ at, shape.mesh.vertices) for k, shape, at in shapes]
        turned = [points @ half_turn.T for points in solids]
        _, match = cKDTree([_bounds(points) for points in solids]).query([_bounds(points) for points in turned])
        for points, partner in zip(turned, match, strict=True):
            distance, _ = cKDTree(solids[partner]).query(points)
            if len(points) != len(solids[partner]) or distance.max() > _SAME_SHAPE:
                return False
    return True


def _bounds(points: Array) -> Array:
    return np.concatenate([points.min(axis=0), points.max(axis=0)])


def _hierarchy(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces))
    model.endModel()
    return model


def _box(mesh: trimesh.Trimesh) -> tuple[Array, Array]:
    """Centre (3,) and half sides (3,) of the box around a mesh, along the axes of its frame."""
    low, high = mesh.bounds
    return (low + high) / 2.0, (high - low) / 2.0


def _frames_along(direction: Array) -> Array:
    """Rotations (n, 3, 3) whose z axes are the unit ``direction`` (n, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(direction), axis=-1)]
    x = np.cross(helper, direction)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(direction, x), direction], axis=-1)
