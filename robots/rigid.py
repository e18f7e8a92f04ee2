"""Rigid bodies made of shapes: links of robots, pieces of hands, parts and obstacles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import numpy.typing as npt
import trimesh

from ..transforms import Array, invert, transform_points
from .shapes import Piece, Shape, cover

# Boxes around triangles that are this much farther apart than the distance to keep [m] are not opened: near contact
# coal's own millimetre opens many more.
BREAK_DISTANCE = 1e-4


@dataclass(frozen=True, eq=False)
class Rigid:
    """Shapes that move as one.

    Attributes:
        name: Its name.
        shapes: Its collision shapes.
        placements: Pose (k, 4, 4) of each shape in the body's frame.
        color: RGBA.
    """

    name: str
    shapes: tuple[Shape, ...]
    placements: Array
    color: Array

    @cached_property
    def cover(self) -> tuple[Piece, ...]:
        """Few convex pieces that together cover all shapes, and what their surfaces enclose."""
        return cover(self.shapes, self.placements)

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """All shapes as one triangle mesh in the body's frame [m]."""
        moved = [s.mesh.copy().apply_transform(p) for s, p in zip(self.shapes, self.placements, strict=True)]
        return trimesh.util.concatenate(moved)

    @cached_property
    def room(self) -> Array:
        """Longest side [m] and volume [m3] (2,) that nothing inside one of the unfilled surfaces exceeds."""
        volume = sum(piece.volume for piece in self.cover)
        return np.array([2.0 * self.balls[self._hollow, 3].max(), volume]) if len(self._hollow) else np.zeros(2)

    @cached_property
    def corners(self) -> Array:
        """Corners (8, 3) of a box around the body, along the axes of its frame [m]."""
        pairs = zip(self.shapes, self.placements, strict=True)
        points = np.concatenate([transform_points(p, _corners(s)) for s, p in pairs])
        corners: Array = trimesh.bounds.corners([points.min(axis=0), points.max(axis=0)])
        return corners

    @cached_property
    def ball(self) -> Array:
        """Centre and radius (4,) of a ball around the body, in its frame [m]."""
        return _ball(self.corners)

    @cached_property
    def balls(self) -> Array:
        """Centre and radius (k, 4) of a ball around each shape, in the body's frame [m]."""
        pairs = zip(self.shapes, self.placements, strict=True)
        return np.array([_ball(transform_points(p, _corners(s))) for s, p in pairs])

    def touches(self, other: Rigid, self_from_other: Array, margin: float = 0.0) -> bool:
        """Whether the exact shapes of two bodies touch, or come nearer than ``margin`` [m].

        Args:
            other: The other body.
            self_from_other: Its pose (4, 4) in the frame of this one.
            margin: Distance to keep [m].
        """
        gaps = self._distances(other, self_from_other) - self.balls[:, None, 3] - other.balls[:, 3]
        for i, j in np.argwhere(gaps <= margin):
            mine, theirs = self.shapes[i], other.shapes[j]
            if _collide(mine, self.placements[i], theirs, self_from_other @ other.placements[j], margin):
                return True
        return self.encloses(other, self_from_other) or other.encloses(self, invert(self_from_other))

    def encloses(self, other: Rigid, self_from_other: Array) -> bool:
        """Whether something of ``other`` lies wholly inside one of the surfaces that are not filled, touching nothing.

        A component can only be inside a surface if its middle is inside the surface's ball and its longest side fits.
        """
        if not len(self._hollow):
            return False
        radii, (sides, spread) = self.balls[self._hollow, None, 3], other._components
        near = (self._distances(other, self_from_other)[self._hollow] < radii + spread) & (sides < 2.0 * radii)
        for i, j in np.argwhere(near):
            surface = self._hollow[i]
            pose = invert(self.placements[surface]) @ self_from_other @ other.placements[j]
            if self.shapes[surface].contains(other.shapes[j], pose):
                return True
        return False

    @cached_property
    def _hollow(self) -> npt.NDArray[np.intp]:
        return np.flatnonzero([not shape.solid for shape in self.shapes])

    @cached_property
    def _components(self) -> tuple[Array, Array]:
        """For each shape the longest side (k,) of its smallest component, and how far (k,) components lie about [m]."""
        sides = [np.ptp(shape.probes, axis=1).max(axis=1).min() for shape in self.shapes]
        several = [len(shape.probes) > 1 for shape in self.shapes]
        return np.array(sides), np.where(several, self.balls[:, 3], 0.0)

    def _distances(self, other: Rigid, self_from_other: Array) -> Array:
        """Distances (k, j) of the centres of the balls [m]."""
        centres = transform_points(self_from_other, other.balls[:, :3])
        distances: Array = np.linalg.norm(self.balls[:, None, :3] - centres, axis=-1)
        return distances


@dataclass(frozen=True, eq=False)
class Nest:
    """A body whose surfaces may enclose something of another one that begins in one of its pieces.

    Attributes:
        outer: The body around.
        inner: The body inside.
        placement: Pose (4, 4) of the inner body in the frame of its piece.
        walls: Half-spaces (m, 4) around a piece of the outer body, in its frame.
        corners: A corner of each component (4, n) that is small enough, in the frame of the inner body's piece.
    """

    outer: Rigid
    inner: Rigid
    placement: Array
    walls: Array
    corners: Array

    @classmethod
    def between(cls, outer: Rigid, around: Piece, inner: Rigid, piece: Piece) -> Nest | None:
        """What of ``piece`` may lie inside ``outer`` and begin in its piece ``around``; None if nothing is so small."""
        corners = piece.components[(piece.components[:, 3:] < outer.room).all(axis=1), :3]
        if not len(corners):
            return None
        homogeneous = np.column_stack([corners, np.ones(len(corners))]).T
        return cls(outer, inner, invert(piece.placement), around.walls, homogeneous)

    def holds(self, outer_from_piece: Array) -> bool:
        """Whether ``outer`` encloses something of ``inner``, whose piece is at ``outer_from_piece`` (4, 4)."""
        if not (self.walls @ (outer_from_piece @ self.corners) <= 0.0).all(axis=0).any():
            return False
        return self.outer.encloses(self.inner, outer_from_piece @ self.placement)


def _collide(a: Shape, pose_a: Array, b: Shape, pose_b: Array, margin: float) -> bool:
    request = coal.CollisionRequest()
    request.security_margin = margin
    request.break_distance = BREAK_DISTANCE
    placed = [coal.Transform3s(pose[:3, :3], pose[:3, 3]) for pose in (pose_a, pose_b)]
    return bool(coal.collide(a.geometry, placed[0], b.geometry, placed[1], request, coal.CollisionResult()))


def _corners(shape: Shape) -> Array:
    corners: Array = trimesh.bounds.corners(shape.bounds)
    return corners


def _ball(corners: Array) -> Array:
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    return np.append(centre, np.linalg.norm(corners - centre, axis=1).max())
