"""Collision shapes: exact ones (primitives, hulls, triangle meshes) and the convex pieces that cover them.

Checks between bodies take two steps. Convex pieces decide most states in microseconds; where pieces touch that are not
the body itself, the exact shapes decide. The pieces cover what they stand for: a state whose pieces are apart is free.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import trimesh
from scipy.spatial import ConvexHull, QhullError

from ..transforms import Array, transform_points

_CYLINDER_SECTIONS = 48
_BALL_GROWTH = 1.01
_CONVEX_SLACK = 1e-6  # share of the hull's volume
_SPLIT_GAIN = 0.01  # share of the hull's volume that a cut must save
_SMALLEST_GAP = 5e-5  # m3, a cube of 37 mm
_CUTS = np.arange(1, 8) / 8.0
_MOST_PARTS = 6
_FLAT = 1e-6  # m
_ROUNDING = 3e-4  # m: fewer corners make checks faster, wider pieces leave more to exact shapes
_THINNING = 3e-3  # m, of corners on which cuts are judged


@dataclass(frozen=True, eq=False)
class Shape:
    """One rigid collision shape.

    Attributes:
        geometry: The exact shape.
        mesh: Its triangles in the same frame [m]; curved primitives are tessellated, from inside.
        solid: True for a primitive or a convex hull, whose inside is filled; false for a surface of triangles.
        growth: Factors (3,) along the axes by which the mesh must grow to hold the shape: above 1 where it is curved.
    """

    geometry: coal.CollisionGeometry
    mesh: trimesh.Trimesh
    solid: bool
    growth: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3) of a box around the shape [m]."""
        bounds: Array = self.mesh.bounds * np.asarray(self.growth)
        return bounds

    @cached_property
    def probes(self) -> Array:
        """The outermost vertices (k, 6, 3) along the axes, both ways, of each connected component of the mesh."""
        parts = trimesh.graph.connected_components(self.mesh.face_adjacency, nodes=np.arange(len(self.mesh.faces)))
        corners = [self.mesh.triangles[part].reshape(-1, 3) for part in parts]
        return np.array([points[np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])] for points in corners])

    def contains(self, other: Shape, self_from_other: Array) -> bool:
        """Whether a whole component of ``other``, which does not cross this surface, lies inside it.

        Filled shapes need no such check: what is inside them touches them.
        """
        points = transform_points(self_from_other, other.probes)
        low, high = self.mesh.bounds
        inside = points[((points > low) & (points < high)).all(axis=(1, 2)), 0]
        return len(inside) > 0 and bool((np.abs(winding_number(self.mesh, inside)) > 0.5).any())


def winding_number(mesh: trimesh.Trimesh, points: Array) -> Array:
    """How often (n,) the surface winds around each of ``points`` (n, 3): 1 inside and 0 outside of a closed mesh.

    The sum of the solid angles of the triangles over a full turn (van Oosterom and Strackee); open meshes give a
    fraction.
    """
    corners = np.ascontiguousarray(mesh.triangles.transpose(1, 2, 0))
    return np.array([_solid_angles(corners - point[:, None]).sum() for point in points]) / (2.0 * np.pi)


def _solid_angles(corners: Array) -> Array:
    """Half the solid angle (t,) of each triangle seen from the origin; ``corners`` are (3, xyz, t)."""
    a, b, c = corners
    la, lb, lc = np.sqrt((corners * corners).sum(axis=1))
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    ab, bc, ca = (a * b).sum(axis=0), (b * c).sum(axis=0), (c * a).sum(axis=0)
    angles: Array = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
    return angles


def box(size: Sequence[float] | Array) -> Shape:
    """A box of ``size`` (3,) [m] centred at the origin."""
    return Shape(coal.Box(*(float(side) for side in size)), trimesh.creation.box(size), solid=True)


def cylinder(radius: float, length: float) -> Shape:
    """A cylinder about z [m], centred at the origin."""
    mesh = trimesh.creation.cylinder(radius, length, sections=_CYLINDER_SECTIONS)
    growth = 1.0 / np.cos(np.pi / _CYLINDER_SECTIONS)
    return Shape(coal.Cylinder(radius, length), mesh, solid=True, growth=(growth, growth, 1.0))


def sphere(radius: float) -> Shape:
    """A sphere [m] centred at the origin."""
    return Shape(coal.Sphere(radius), trimesh.creation.icosphere(3, radius), solid=True, growth=(_BALL_GROWTH,) * 3)


def from_mesh(mesh: trimesh.Trimesh) -> Shape:
    """The exact shape of a triangle mesh [m]: its filled hull where the mesh is convex, its surface otherwise."""
    volume = hull_volume(mesh.vertices)
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
            return Shape(geometry, mesh, solid=True, growth=(_BALL_GROWTH,) * 3)
        case coal.BVHModelOBBRSS():
            corners = (geometry.tri_indices(i) for i in range(geometry.num_tris))
            faces = np.array([[corner[0], corner[1], corner[2]] for corner in corners])
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


@dataclass(frozen=True, eq=False)
class Piece:
    """A convex shape that covers a part of a body.

    Attributes:
        geometry: The convex shape.
        placement: Its pose (4, 4) in the body's frame.
        components: For each connected component of the body with its first corner in this part that corner (3,) in the
            frame of the piece [m], the longest side of a box around it [m] and a volume that it fills [m3]: (n, 5).
        exact: The exact shapes of that part, with their poses (4, 4); none where the convex shape is exact itself.
        volume: Of the hull of that part [m3]; 0 where the convex shape is exact itself.
    """

    geometry: coal.CollisionGeometry
    placement: Array
    components: Array
    exact: tuple[tuple[coal.CollisionGeometry, Array], ...] = ()
    volume: float = 0.0

    @cached_property
    def walls(self) -> Array:
        """Half-spaces (m, 4) whose common part is the hull of this piece."""
        walls: Array = ConvexHull(np.array(self.geometry.points())).equations.copy()
        walls[:, 3] -= self.geometry.getSweptSphereRadius()
        return walls


def cover(shapes: Sequence[Shape], placements: Array) -> tuple[Piece, ...]:
    """Few convex pieces that together cover ``shapes`` at ``placements`` (k, 4, 4), and what their surfaces enclose.

    One hull if that fills no gap worth speaking of, the shapes themselves if they are few and filled, else the hulls of
    parts cut from them.
    """
    grown = [transform_points(p, s.mesh.triangles * s.growth) for s, p in zip(shapes, placements[:, None], strict=True)]
    parts = convex_cover(np.concatenate(grown))
    filled = all(shape.solid for shape in shapes)
    if filled and (len(shapes) == 1 or (len(parts) > 1 and len(shapes) <= _MOST_PARTS)):
        return tuple(Piece(s.geometry, p, _components(s)) for s, p in zip(shapes, placements, strict=True))
    placed = list(zip(shapes, placements, grown, strict=True))
    return tuple(_piece(part, placed) for part in parts)


def _piece(part: Array, placed: list[tuple[Shape, Array, Array]]) -> Piece:
    """The hull of triangles (n, 3, 3), and what is in the box around it of shapes, their poses and grown triangles."""
    low, high = part.min(axis=(0, 1)), part.max(axis=(0, 1))
    exact, components = [], []
    for shape, placement, grown in placed:
        inside = ((grown.max(axis=1) >= low) & (grown.min(axis=1) <= high)).all(axis=1)
        if inside.any():
            whole = shape.solid or inside.all()
            geometry = shape.geometry if whole else triangles(shape.mesh.submesh([inside], append=True, repair=False))
            exact.append((geometry, placement))
            components.append(_components(shape))
            components[-1][:, :3] = transform_points(placement, components[-1][:, :3])
    found = np.concatenate(components)
    here = ((found[:, :3] >= low - _FLAT) & (found[:, :3] <= high + _FLAT)).all(axis=1)
    points = part.reshape(-1, 3)
    return Piece(rounded_hull(points), np.eye(4), found[here], tuple(exact), hull_volume(points))


def _components(shape: Shape) -> Array:
    """A corner, the longest side and a filled volume (n, 5) of each connected component."""
    sides = np.ptp(shape.probes, axis=1).max(axis=1)
    volume = shape.mesh.volume if shape.solid else 0.0
    return np.column_stack([shape.probes[:, 0], sides, np.full(len(sides), volume)])


def rounded_hull(points: Array) -> coal.CollisionGeometry:
    """A filled shape around ``points`` (n, 3) [m]: the hull of few of them, rounded by how far it leaves the others."""
    solid = _thickened(np.asarray(points, dtype=float))
    outer = solid[ConvexHull(solid).vertices]
    hull = convex_hull(solid[ConvexHull(solid, qhull_options=f"Qt W{_ROUNDING}").vertices])
    left = max(_distance(hull, corner) for corner in outer)
    hull.setSweptSphereRadius(max(left, 0.0) + _FLAT)
    return hull


def _distance(hull: coal.CollisionGeometry, point: Array) -> float:
    here, there, request = coal.Transform3s(), coal.Transform3s(np.eye(3), point), coal.DistanceRequest()
    return float(coal.distance(hull, here, coal.Sphere(_FLAT), there, request, coal.DistanceResult())) + _FLAT


def convex_cover(soup: Array) -> list[Array]:
    """Triangles (k, 3, 3) of parts of ``soup`` (n, 3, 3) [m] whose hulls are small and together cover it.

    The part that gains most is cut in two by a plane across one of the two longer axes, until there are six or no cut
    saves a hundredth of the volume of the whole hull and a gap that a finger could enter. With one axis left uncut, a
    line along it leaves every point inside a closed surface for the surface of its own part: hulls cover insides too.
    """
    axes = np.argsort(np.ptp(soup, axis=(0, 1)))[1:]
    worth = max(_SPLIT_GAIN * hull_volume(soup.reshape(-1, 3)), _SMALLEST_GAP)
    parts, cuts = [soup], [_best_cut(soup, axes)]
    while len(parts) < _MOST_PARTS:
        i = int(np.argmax([cut.gain for cut in cuts]))
        if cuts[i].gain <= worth:
            break
        parts[i : i + 1] = _cut(parts[i], cuts[i].axis, cuts[i].at)
        cuts[i : i + 1] = [_best_cut(half, axes) for half in parts[i : i + 2]]
    return parts


class _Cut(NamedTuple):
    """A plane across an axis, and about the hull volume that a cut there saves [m3]."""

    gain: float
    axis: int
    at: float


def _best_cut(soup: Array, axes: npt.NDArray[np.intp]) -> _Cut:
    """The cut of triangles (n, 3, 3) across one of ``axes`` that saves most hull volume, judged on few corners."""
    corners, starts, ends = soup.reshape(-1, 3), soup, np.roll(soup, 1, axis=1)
    _, kept = np.unique(np.round(corners / _THINNING).astype(np.int64) @ (1, 1 << 20, 1 << 40), return_index=True)
    thin, low, high = corners[kept], corners.min(axis=0), corners.max(axis=0)
    whole = hull_volume(thin, _THINNING)
    best = _Cut(0.0, 0, 0.0)
    if whole <= _SMALLEST_GAP:
        return best
    for axis, share in itertools.product(axes, _CUTS):
        at = low[axis] + share * (high[axis] - low[axis])
        crossing = (starts[..., axis] < at) & (ends[..., axis] >= at)
        start, end = starts[crossing], ends[crossing]
        section = start + (end - start) * ((at - start[:, axis]) / (end - start)[:, axis])[:, None]
        sides = (thin[thin[:, axis] < at], thin[thin[:, axis] >= at])
        gain = whole - sum(hull_volume(np.concatenate([side, section]), _THINNING) for side in sides)
        if gain > best.gain:
            best = _Cut(gain, int(axis), float(at))
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


def hull_volume(points: Array, slack: float = 0.0) -> float:
    """Volume of the hull of ``points`` (n, 3) [m3], 0 where they are flat; points may stay outside by ``slack`` [m]."""
    try:
        return float(ConvexHull(points, qhull_options=f"Qt W{slack}" if slack else "Qt").volume)
    except (QhullError, ValueError):
        return 0.0


def _thickened(points: Array) -> Array:
    """``points``, doubled and moved apart by 2 micrometres where they lie in a plane, on a line or in a point."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    extent = np.ptp(centred @ axes, axis=0)
    for axis in axes.T[extent < _FLAT]:
        points = np.concatenate([points - _FLAT * axis, points + _FLAT * axis])
    return points
