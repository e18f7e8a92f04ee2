"""Collision shapes: exact ones (primitives, hulls, triangle meshes) and the convex pieces that cover them.

Checks between bodies take two steps. Convex pieces decide most states in microseconds; where pieces of a body that is
not convex touch, the exact shapes decide. The pieces cover the surface they stand for, so a state whose pieces are apart
is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from ..transforms import Array

_CYLINDER_SECTIONS = 48
_CONVEX_SLACK = 1e-6  # share of the hull's volume
_SPLIT_GAIN = 0.05  # share of the hull's volume that a cut must save
_CUTS = (0.25, 0.5, 0.75)
_FLAT = 1e-6  # m


@dataclass(frozen=True, eq=False)
class Shape:
    """One rigid collision shape.

    Attributes:
        geometry: The exact shape.
        mesh: Its triangles in the same frame [m]; curved primitives are tessellated.
        solid: True for a primitive or a convex hull, whose inside is filled; false for a surface of triangles.
    """

    geometry: coal.CollisionGeometry
    mesh: trimesh.Trimesh
    solid: bool

    @cached_property
    def pieces(self) -> tuple[coal.CollisionGeometry, ...]:
        """Convex shapes that together cover this one."""
        if self.solid:
            return (self.geometry,)
        return tuple(convex_hull(points) for points in convex_cover(self.mesh))


def box(size: Sequence[float] | Array) -> Shape:
    """A box of ``size`` (3,) [m] centred at the origin."""
    return Shape(coal.Box(*(float(side) for side in size)), trimesh.creation.box(size), solid=True)


def cylinder(radius: float, length: float) -> Shape:
    """A cylinder about z [m], centred at the origin."""
    mesh = trimesh.creation.cylinder(radius, length, sections=_CYLINDER_SECTIONS)
    return Shape(coal.Cylinder(radius, length), mesh, solid=True)


def sphere(radius: float) -> Shape:
    """A sphere [m] centred at the origin."""
    return Shape(coal.Sphere(radius), trimesh.creation.icosphere(3, radius), solid=True)


def from_mesh(mesh: trimesh.Trimesh) -> Shape:
    """The exact shape of a triangle mesh [m]: its filled hull where the mesh is convex, its surface otherwise."""
    volume = _hull_volume(mesh.vertices)
    if mesh.is_watertight and mesh.volume >= (1.0 - _CONVEX_SLACK) * volume > 0.0:
        return Shape(convex_hull(mesh.vertices), mesh, solid=True)
    return Shape(triangles(mesh), mesh, solid=False)


def from_coal(geometry: coal.CollisionGeometry) -> Shape:
    """The shape of a geometry that pinocchio has read from a URDF.

    Raises:
        TypeError: A kind of geometry that URDF does not have.
    """
    match geometry:
        case coal.Box():
            return box(2.0 * np.ravel(geometry.halfSide))
        case coal.Cylinder():
            return cylinder(geometry.radius, 2.0 * geometry.halfLength)
        case coal.Sphere():
            return sphere(geometry.radius)
        case coal.Capsule():
            mesh = trimesh.creation.capsule(2.0 * geometry.halfLength, geometry.radius)
            mesh.apply_translation([0.0, 0.0, -mesh.bounds.mean(axis=0)[2]])
            return Shape(geometry, mesh, solid=True)
        case coal.BVHModelOBBRSS():
            faces = np.array([[*geometry.tri_indices(i)] for i in range(geometry.num_tris)])
            return from_mesh(trimesh.Trimesh(geometry.vertices(), faces))
    raise TypeError(f"no shape for {type(geometry).__name__}")


def triangles(mesh: trimesh.Trimesh) -> coal.CollisionGeometry:
    """A bounding volume hierarchy over the triangles of ``mesh``."""
    bvh = coal.BVHModelOBBRSS()
    bvh.beginModel(len(mesh.faces), len(mesh.vertices))
    bvh.addVertices(np.asarray(mesh.vertices, dtype=float))
    bvh.addTriangles(np.asarray(mesh.faces, dtype=np.int64))
    bvh.endModel()
    return bvh


def convex_hull(points: Array) -> coal.CollisionGeometry:
    """The hull of ``points`` (n, 3) [m] as a filled shape; flat point sets get a thickness of 2 micrometres."""
    corners = coal.StdVec_Vec3s()
    solid = _thickened(np.asarray(points, dtype=float))
    for corner in solid[ConvexHull(solid).vertices]:
        corners.append(corner)
    return coal.Convex.convexHull(corners, True, "Qt")


def convex_cover(mesh: trimesh.Trimesh, most: int = 6) -> list[Array]:
    """Point sets (k, 3) whose hulls together cover the surface of ``mesh``.

    The hull that gains most is cut in two by a plane across an axis, until there are ``most`` of them or no cut saves a
    twentieth of the volume of the whole hull.
    """
    frame = mesh.principal_inertia_transform if mesh.is_watertight else np.eye(4)
    local = trimesh.transform_points(mesh.vertices, frame)
    parts = [local[mesh.faces]]
    worth = _SPLIT_GAIN * _hull_volume(local)
    cuts = [_best_cut(parts[0])]
    while len(parts) < most:
        i = int(np.argmax([gain for gain, _ in cuts]))
        if cuts[i][0] <= worth:
            break
        halves = cuts[i][1]
        parts[i : i + 1] = halves
        cuts[i : i + 1] = [_best_cut(half) for half in halves]
    back = np.linalg.inv(frame)
    return [trimesh.transform_points(np.unique(part.reshape(-1, 3), axis=0), back) for part in parts]


def _best_cut(soup: Array) -> tuple[float, list[Array]]:
    """The axis-aligned cut of triangles (n, 3, 3) that saves most hull volume, and the two halves."""
    low, high = soup.min(axis=(0, 1)), soup.max(axis=(0, 1))
    whole = _hull_volume(soup.reshape(-1, 3))
    best: tuple[float, list[Array]] = (0.0, [])
    for axis in range(3):
        for share in _CUTS:
            halves = _cut(soup, axis, low[axis] + share * (high[axis] - low[axis]))
            gain = whole - sum(_hull_volume(half.reshape(-1, 3)) for half in halves)
            if gain > best[0]:
                best = gain, halves
    return best


def _cut(soup: Array, axis: int, at: float) -> list[Array]:
    """Triangles (n, 3, 3) cut by a plane across ``axis``: those below and those above."""
    normal, origin = np.eye(3)[axis], np.eye(3)[axis] * at
    flat, faces = soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3)
    halves = []
    for side in (-normal, normal):
        vertices, kept, _ = trimesh.intersections.slice_faces_plane(flat, faces, side, origin)
        halves.append(np.asarray(vertices)[kept])
    return halves


def _hull_volume(points: Array) -> float:
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0


def _thickened(points: Array) -> Array:
    """``points``, doubled and moved apart by 2 micrometres where they lie in a plane or on a line."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    extent = np.ptp((points - points.mean(axis=0)) @ axes.T, axis=0)
    for axis in axes[extent < _FLAT]:
        points = np.concatenate([points - _FLAT * axis, points + _FLAT * axis])
    return points
