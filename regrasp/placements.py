"""Stable placements: the poses in which a part rests on a plane, and how far it must be tilted to topple."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from ..errors import InputError
from ..grasping.part import Part
from ..transforms import Array, compose, transform_points
from .polygons import Polygons, outline

Indices = npt.NDArray[np.int64]

SMALLEST_MARGIN = np.radians(5.0)
_MERGE = np.radians(1.0)  # hull triangles within this of the largest one around are one face with it
_NEAR = np.radians(20.0)  # the part rolls on to a stable face nearer than this, unless it lies higher
_ROUND = np.radians(45.5)  # two stable neighbours nearer than this and as high: round, tessellated in 8 steps or more
_LEVEL = 0.01  # heights of the centre of mass that differ by less than this share are the same


@dataclass(frozen=True, eq=False)
class Placements:
    """n poses in which a part rests on the plane z = 0 of a surface, the hardest to topple first.

    The surface's origin lies below the centre of mass; its x axis points along the part's x axis seen from above, or
    along the part's y axis where x is steep.

    Attributes:
        surface_from_part: (n, 4, 4).
        margin: (n,) smallest tilt that topples the part [rad].
        height: (n,) of the centre of mass above the surface [m].
        share: (n,) of all directions; let go with one of them down, the part rolls to this placement.
        support: Support polygons, on the surface [m].
        outline: Convex outlines of the whole part seen from above, on the surface [m].
    """

    surface_from_part: Array
    margin: Array
    height: Array
    share: Array
    support: Polygons
    outline: Polygons

    def __len__(self) -> int:
        """Number of placements n."""
        return len(self.margin)

    def take(self, chosen: Indices) -> Placements:
        """The chosen placements, by index."""
        return Placements(
            self.surface_from_part[chosen],
            self.margin[chosen],
            self.height[chosen],
            self.share[chosen],
            self.support.take(chosen),
            self.outline.take(chosen),
        )


def find_placements(part: Part) -> Placements:
    """The stable placements of ``part`` on a horizontal plane.

    A face of the convex hull is stable where the centre of mass lies above it; its margin is the smallest tilt, over
    the edges of the face, that brings the centre of mass above the edge. Faces that topple below 5 deg are not used,
    nor are rolling surfaces, such as the side of a cylinder in any number of sections.

    Raises:
        InputError: The centre of mass lies outside the convex hull.
    """
    faces = _hull_faces(part)
    tilt = _tilts(faces)
    margin = np.full(len(faces.height), np.inf)
    np.minimum.at(margin, faces.edge[:, 0], tilt)
    rest = _resting_face(faces, tilt, margin)
    used = np.flatnonzero((margin >= SMALLEST_MARGIN) & ~_rolling(faces, margin, rest))
    used = used[np.lexsort((*np.round(faces.normal[used].T, 6), -np.round(margin[used], 6)))]
    share = np.bincount(rest, faces.solid_angle, len(margin)) / (4.0 * np.pi)

    surface_from_part = _on_surface(faces, used, part.center_of_mass)
    corners = [faces.points[np.unique(faces.triangles[faces.owner == face])] for face in used]
    seen = surface_from_part[:, :2, :3]
    return Placements(
        surface_from_part=surface_from_part,
        margin=margin[used],
        height=transform_points(surface_from_part, part.center_of_mass[None])[:, 0, 2],
        share=share[used],
        support=Polygons.of([outline(points @ axes.T) for points, axes in zip(corners, seen, strict=True)]),
        outline=Polygons.of([outline(faces.points @ axes.T) for axes in seen]),
    )


@dataclass(frozen=True, eq=False)
class _Faces:
    """The k faces of a convex hull of t triangles, seen from the centre of mass.

    Attributes:
        points: (v, 3) from the centre of mass [m].
        triangles: (t, 3) of the hull.
        owner: (t,) the face of each triangle.
        normal: (k, 3) outward, of the triangle on which the centre of mass lies lowest: the one that carries the part.
        height: (k,) of the centre of mass above that triangle [m].
        solid_angle: (k,) under which the centre of mass sees the face.
        edge: (e, 2) a face and the one across an edge of it; each edge appears from both sides.
        ends: (e, 2) the points of the edge.
        inner: (e,) a point of the first face off the edge.
    """

    points: Array
    triangles: Indices
    owner: Indices
    normal: Array
    height: Array
    solid_angle: Array
    edge: Indices
    ends: Indices
    inner: Indices


def _hull_faces(part: Part) -> _Faces:
    hull = ConvexHull(part.mesh.vertices - part.center_of_mass)
    normal, height = hull.equations[:, :3], -hull.equations[:, 3]
    if height.min() <= 0.0:
        cure = "give one inside the part, in the frame of its mesh"
        raise InputError(part.name, f"centre of mass {part.center_of_mass} m is outside the convex hull", cure)
    triangles = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(hull.points[triangles], 1, 0)
    owner = _merged(hull.neighbors, normal, np.linalg.norm(np.cross(b - a, c - a), axis=1))
    by_height = np.lexsort((height, owner))
    lowest = by_height[np.searchsorted(owner[by_height], np.arange(owner.max() + 1))]

    inside, across = np.repeat(np.arange(len(triangles)), 3), hull.neighbors.ravel()
    border = owner[inside] != owner[across]
    ends = triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2)  # across from the k-th corner lies the k-th neighbour
    return _Faces(
        points=hull.points,
        triangles=triangles,
        owner=owner,
        normal=normal[lowest],
        height=height[lowest],
        solid_angle=np.bincount(owner, _solid_angles(a, b, c)).astype(np.float64),
        edge=np.stack([owner[inside], owner[across]], axis=1)[border],
        ends=ends[border],
        inner=triangles.ravel()[border],
    )


def _merged(neighbors: Indices, normal: Array, area: Array) -> Indices:
    """The face (t,) of each triangle: from the largest on, each takes in what is connected and within 1 deg of it."""
    owner = [-1] * len(area)
    across, unit, cosine = neighbors.tolist(), normal.tolist(), cos(_MERGE)
    count = 0
    for seed in np.argsort(-area, kind="stable").tolist():
        if owner[seed] >= 0:
            continue
        owner[seed], frontier = count, [seed]
        x, y, z = unit[seed]
        while frontier:
            for triangle in across[frontier.pop()]:
                nx, ny, nz = unit[triangle]
                if owner[triangle] < 0 and x * nx + y * ny + z * nz >= cosine:
                    owner[triangle] = count
                    frontier.append(triangle)
        count += 1
    return np.array(owner, dtype=np.int64)


def _solid_angles(a: Array, b: Array, c: Array) -> Array:
    """Solid angle (t,) of triangles seen from the origin, which lies inside the hull (van Oosterom and Strackee)."""
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", p, q) for p, q in ((a, b), (b, c), (c, a)))
    volume = np.abs(np.einsum("ti,ti->t", a, np.cross(b, c)))
    angles: Array = 2.0 * np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angles


def _tilts(faces: _Faces) -> Array:
    """The tilt (e,) about each edge that brings the centre of mass above it [rad]; negative where it lies beyond.

    Faces count as flat: what their triangles differ by is less than the merging angle.
    """
    start, end = np.moveaxis(faces.points[faces.ends], 1, 0)
    down = faces.normal[faces.edge[:, 0]]
    inward = np.cross(end - start, down)
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    inward *= np.sign(np.einsum("ei,ei->e", faces.points[faces.inner] - start, inward))[:, None]
    tilt: Array = np.arctan2(-np.einsum("ei,ei->e", start, inward), faces.height[faces.edge[:, 0]])
    return tilt


def _resting_face(faces: _Faces, tilt: Array, margin: Array) -> Indices:
    """The face (k,) on which the part comes to rest when let go on each face: it tips over the edge of least tilt."""
    weakest = np.lexsort((tilt, faces.edge[:, 0]))
    over = faces.edge[weakest[np.searchsorted(faces.edge[weakest, 0], np.arange(len(margin)))], 1]
    falls = (margin < 0.0) & (faces.height[over] < faces.height)  # with every step, so that no way leads back
    rest = np.where(falls, over, np.arange(len(margin)))
    while (rest[rest] != rest).any():
        rest = rest[rest]
    return rest


def _rolling(faces: _Faces, margin: Array, rest: Indices) -> npt.NDArray[np.bool_]:
    """Which faces (k,) the part rolls on: tipped over an edge it comes to rest nearby, and no higher.

    Nearby is less than 20 deg away. A round side in 8 to 18 steps has wider ones; there the part can roll both ways at
    the same height.
    """
    pairs = np.unique(np.stack([faces.edge[:, 0], rest[faces.edge[:, 1]]], axis=1), axis=0)
    pairs = pairs[(margin[pairs[:, 0]] >= 0.0) & (pairs[:, 0] != pairs[:, 1])]
    here, there = pairs.T
    angle = np.arccos(np.clip(np.einsum("pi,pi->p", faces.normal[here], faces.normal[there]), -1.0, 1.0))
    rise = faces.height[there] / faces.height[here] - 1.0
    onto = (angle < _NEAR) & (rise < _LEVEL)
    level = (angle < _ROUND) & (np.abs(rise) < _LEVEL)
    count = len(margin)
    return (np.bincount(here, onto, count) > 0) | (np.bincount(here, level, count) > 1)


def _on_surface(faces: _Faces, used: Indices, center_of_mass: Array) -> Array:
    """Poses surface_from_part (n, 4, 4) of the part resting on its faces ``used`` (n,)."""
    z = -faces.normal[used]
    x = np.where(np.abs(z[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    x -= np.einsum("ni,ni->n", x, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    height = -(faces.points @ z.T).min(axis=0)
    below = np.stack([np.zeros_like(height), np.zeros_like(height), height], axis=1)
    return compose(rotation, below - rotation @ center_of_mass)
