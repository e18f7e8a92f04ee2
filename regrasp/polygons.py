"""Sets of convex polygons in a plane, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from ..transforms import Array


@dataclass(frozen=True, eq=False)
class Polygons:
    """n convex polygons; polygon i has the corners ``points[offsets[i]:offsets[i + 1]]``, counterclockwise.

    Attributes:
        points: (total, 2) corners, polygon by polygon [m].
        offsets: (n + 1,) where each polygon starts in ``points``.
    """

    points: Array
    offsets: npt.NDArray[np.int64]

    @classmethod
    def of(cls, polygons: Sequence[Array]) -> Polygons:
        """The set of ``polygons``, each (k, 2) and counterclockwise."""
        sizes = [len(polygon) for polygon in polygons]
        points = np.concatenate([np.zeros((0, 2)), *polygons])
        return cls(points, np.cumsum([0, *sizes], dtype=np.int64))

    def __len__(self) -> int:
        """Number of polygons n."""
        return len(self.offsets) - 1

    def __getitem__(self, index: int) -> Array:
        """Corners (k, 2) of one polygon [m]."""
        return self.points[self.offsets[index] : self.offsets[index + 1]]

    def take(self, chosen: npt.NDArray[np.int64]) -> Polygons:
        """The chosen polygons, by index."""
        return Polygons.of([self[int(i)] for i in chosen])

    @property
    def area(self) -> Array:
        """Area (n,) [m2]."""
        after = self.points[self._next]
        twice: Array = np.add.reduceat(_cross(self.points, after), self.offsets[:-1])
        return twice / 2.0

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest corner (n, 2) of the rectangles around the polygons along the axes [m]."""
        starts = self.offsets[:-1]
        return np.minimum.reduceat(self.points, starts), np.maximum.reduceat(self.points, starts)

    def turned(self, angles: Array) -> Polygons:
        """All polygons turned about the origin by each of ``angles`` (t,) [rad]: t n polygons, angle by angle."""
        cosine, sine = np.cos(angles), np.sin(angles)
        rotations = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
        points = self.points @ np.swapaxes(rotations, -1, -2)
        starts = self.offsets[:-1] + len(self.points) * np.arange(len(angles))[:, None]
        return Polygons(points.reshape(-1, 2), np.append(starts.ravel(), len(angles) * len(self.points)))

    def apart(self, other: Array, shifts: Array) -> npt.NDArray[np.bool_]:
        """Which polygons (n, p), moved by each of ``shifts`` (p, 2) [m], do not overlap the convex ``other`` (k, 2).

        Two convex polygons are apart if an edge of either has the other wholly on its outer side (separating axes).
        """
        starts = self.offsets[:-1]
        mine = _outward(self.points, self.points[self._next])
        theirs = _outward(other, np.roll(other, -1, axis=0))
        beyond_mine = (other @ mine.T).min(axis=0) - (self.points * mine).sum(axis=1)
        beyond_theirs = np.minimum.reduceat(self.points @ theirs.T, starts) - (other * theirs).sum(axis=1)
        gap = np.maximum.reduceat(beyond_mine[:, None] - mine @ shifts.T, starts)
        apart: npt.NDArray[np.bool_] = gap >= 0.0
        for edge, distance in zip(theirs, beyond_theirs.T, strict=True):
            apart |= distance[:, None] + shifts @ edge >= 0.0
        return apart

    @property
    def _next(self) -> npt.NDArray[np.int64]:
        """(total,) the corner after each corner."""
        following = np.arange(1, len(self.points) + 1)
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return following


def outline(points: Array) -> Array:
    """The convex outline (k, 2) of ``points`` (n, 2 or 3) seen along z, counterclockwise [m]."""
    flat = np.asarray(points)[:, :2]
    corners: Array = flat[ConvexHull(flat).vertices]
    return corners


def _outward(start: Array, end: Array) -> Array:
    """Outward directions (n, 2), as long as the edges, of counterclockwise edges."""
    along = end - start
    return np.stack([along[:, 1], -along[:, 0]], axis=1)


def _cross(a: Array, b: Array) -> Array:
    crossed: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return crossed
