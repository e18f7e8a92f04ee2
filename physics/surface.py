"""The surface of a part as convex pieces: exact to 0.01 mm, outlines of holes to 0.05 mm, however hollow it is.

MuJoCo knows convex shapes only, and a decomposition of the volume fills what is hollow by a millimetre or so. Hands
touch surfaces: so flat regions are cut into convex polygons, each the outer face of a thin wedge that tapers into the
part.
"""

from __future__ import annotations

import manifold3d
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from ..transforms import Array

_EXACT = 1e-5  # m: the surface may be simplified by so much
_THICKEST = 2e-3  # m
_SHARE = 0.4  # of the wall behind a polygon
_TAPER = 0.5  # of the outline that is left at the wedge's bottom
_FLAT = np.radians(0.1)  # triangles whose normals differ by less are one plane
_STRAIGHT = 1e-6  # rad by which a corner may be reflex
_POCKET = 5e-5  # m: a polygon's hull may reach over its outline by so much, or finely cut holes give fans of slivers
_SMALLEST = 1e-6  # m, half the width below which a polygon is a sliver that nothing can stand on


def wedges(mesh: trimesh.Trimesh) -> list[Array]:
    """Corners (2k, 3) of convex wedges under the k-sided convex polygons of a surface [m], outer corners first."""
    mesh = simplified(mesh)
    rings = convex_polygons(mesh)
    corners = [mesh.vertices[ring] for ring, _ in rings]
    normals = mesh.face_normals[[face for _, face in rings]]
    middle = np.array([points.mean(axis=0) for points in corners])
    width = np.array([_half_width(points) for points in corners])
    wall = _behind(mesh, middle, normals)
    depth = np.minimum.reduce([np.full(len(rings), _THICKEST), _SHARE * wall, width])
    found = []
    for points, normal, center, down, broad in zip(corners, normals, middle, depth, width, strict=True):
        if broad > _SMALLEST:
            found.append(np.concatenate([points, center + _TAPER * (points - center) - down * normal]))
    return found


def simplified(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh without what moves its surface by 0.01 mm at most: meshers put many vertices into flat faces.

    As it is if it leaks.
    """
    solid = manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices, mesh.faces.astype(np.uint64)))
    if solid.is_empty():
        return mesh
    found = solid.as_original().simplify(_EXACT).to_mesh64()
    return trimesh.Trimesh(found.vert_properties[:, :3], found.tri_verts.astype(np.int64), process=False)


def convex_polygons(mesh: trimesh.Trimesh) -> list[tuple[list[int], int]]:
    """Convex polygons that the triangles of flat regions make: vertices in order, and a triangle of each.

    Greedy merging across the longest edge first (Hertel and Mehlhorn).
    """
    rings = {i: list(face) for i, face in enumerate(mesh.faces.tolist())}
    owner = list(range(len(mesh.faces)))
    flat = np.flatnonzero(mesh.face_adjacency_angles < _FLAT)
    ends = mesh.face_adjacency_edges[flat]
    longest_first = np.argsort(-np.linalg.norm(np.diff(mesh.vertices[ends], axis=1)[:, 0], axis=1), kind="stable")
    pairs, edges = mesh.face_adjacency[flat][longest_first], ends[longest_first]
    for pair, edge in zip(pairs.tolist(), edges.tolist(), strict=True):
        one, other = (_root(owner, face) for face in pair)
        if one == other:
            continue
        ring = _spliced(rings[one], rings[other], edge)
        if ring and _nearly_convex(mesh.vertices[ring], mesh.face_normals[one]):
            rings[one] = ring
            del rings[other]
            owner[other] = one
    return [(ring, face) for face, ring in rings.items()]


def _root(owner: list[int], face: int) -> int:
    """The triangle that stands for the polygon of ``face``; the way there is shortened (union-find)."""
    while owner[face] != face:
        owner[face] = owner[owner[face]]
        face = owner[face]
    return face


def _spliced(one: list[int], other: list[int], edge: list[int]) -> list[int]:
    """Two rings that run along an edge in opposite directions as one; empty if they do not."""
    for u, v in (edge, edge[::-1]):
        i, j = one.index(u), other.index(v)
        if one[(i + 1) % len(one)] == v and other[(j + 1) % len(other)] == u:
            before = one[i + 1 :] + one[: i + 1]  # from v round to u
            after = other[j + 1 :] + other[: j + 1]  # from u round to v
            return before + after[1:-1]
    return []


def _nearly_convex(points: Array, normal: Array) -> bool:
    """Whether a ring (k, 3) goes round once, seen against ``normal``, and no pocket of it is deeper than _POCKET."""
    sides = np.roll(points, -1, axis=0) - points
    ahead = np.roll(sides, -1, axis=0)
    turned = np.cross(sides, ahead) @ normal
    turns = np.arctan2(turned, (sides * ahead).sum(axis=1))
    depth = -turned / np.maximum(np.linalg.norm(sides + ahead, axis=1), 1e-12)  # of a corner under its neighbours' line
    if turns.sum() > 3.0 * np.pi or depth.max() > _POCKET:
        return False
    if turns.min() >= -_STRAIGHT or _half_width(points) <= _SMALLEST:
        return True
    along = sides[0] / np.linalg.norm(sides[0])
    flat = (points - points[0]) @ np.stack([along, np.cross(normal, along)], axis=1)
    outline = ConvexHull(flat).equations  # of unit normals outwards
    return bool((flat @ outline[:, :2].T + outline[:, 2]).max(axis=1).min() >= -_POCKET)


def _half_width(points: Array) -> float:
    """Area over half the perimeter of a polygon (k, 3) [m]: the radius of its inscribed circle, or a little less."""
    spokes = points - points.mean(axis=0)
    area = np.linalg.norm(np.cross(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)) / 2.0
    return float(2.0 * area / np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).sum())


def _behind(mesh: trimesh.Trimesh, points: Array, normals: Array) -> Array:
    """How thick (n,) the wall is behind points of the surface [m]; infinite where nothing is."""
    clear = 1e-6  # m: leaves the surface that the ray starts from
    hits, rays, _ = mesh.ray.intersects_location(points - clear * normals, -normals, multiple_hits=False)
    wall = np.full(len(points), np.inf)
    wall[rays] = np.linalg.norm(hits - points[rays], axis=1)
    return wall
