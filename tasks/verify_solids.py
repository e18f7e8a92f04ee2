"""The verifier's eyes: python-fcl on full triangle meshes."""

from __future__ import annotations

from collections.abc import Sequence

import fcl
import numpy as np
import trimesh

from ..transforms import Array, invert, transform_points

_MOST_CONTACTS = 200_000
_ON_EDGE = 1e-9  # barycentric slack, so that no crossing is lost between two triangles


class Solids:
    """Bodies by number; each question is asked with the poses at which they stand.

    Attributes:
        meshes: Triangles of the bodies, each in its own frame [m].
        centers: (bodies, 3) middle of the box around each body, along the axes of its frame [m].
        halves: (bodies, 3) half sides of that box [m].
        count: Distances measured so far.
    """

    def __init__(self, meshes: Sequence[trimesh.Trimesh]) -> None:
        self.meshes = tuple(meshes)
        bounds = np.array([mesh.bounds for mesh in meshes])
        self.centers, self.halves = bounds.mean(axis=1), np.diff(bounds, axis=1)[:, 0] / 2.0
        self.count = 0
        self._objects = [fcl.CollisionObject(_hierarchy(mesh), fcl.Transform()) for mesh in meshes]

    def touch(self, i: int, world_from_i: Array, j: int, world_from_j: Array) -> bool:
        """Whether the surfaces of bodies i and j meet."""
        pair = self._placed(i, world_from_i), self._placed(j, world_from_j)
        return bool(fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult()))

    def distance(self, i: int, world_from_i: Array, j: int, world_from_j: Array) -> float:
        """Distance between the surfaces of bodies i and j [m]; 0 where they meet."""
        self.count += 1
        pair = self._placed(i, world_from_i), self._placed(j, world_from_j)
        return max(float(fcl.distance(*pair, fcl.DistanceRequest(), fcl.DistanceResult())), 0.0)

    def touches_box(self, i: int, world_from_i: Array, sides: Array, world_from_box: Array) -> bool:
        """Whether the surface of body i meets a solid box of ``sides`` (3,) [m], or goes around its middle."""
        box = fcl.CollisionObject(fcl.Box(*sides), fcl.Transform(world_from_box[:3, :3], world_from_box[:3, 3]))
        pair = self._placed(i, world_from_i), box
        if fcl.collide(*pair, fcl.CollisionRequest(), fcl.CollisionResult()):
            return True
        return inside((invert(world_from_i) @ world_from_box)[:3, 3], self.meshes[i])

    def distance_to_triangles(self, corners: Array, i: int, world_from_i: Array) -> float:
        """Distance between triangles (t, 3, 3) in the world and the surface of body i [m]."""
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        item = fcl.CollisionObject(_hierarchy(trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)))
        pair = item, self._placed(i, world_from_i)
        return max(float(fcl.distance(*pair, fcl.DistanceRequest(), fcl.DistanceResult())), 0.0)

    def crossings(self, i: int, world_from_i: Array, j: int, world_from_j: Array) -> Array:
        """Points (k, 3) in the world where an edge of either body goes through a triangle of the other [m]."""
        request = fcl.CollisionRequest(num_max_contacts=_MOST_CONTACTS, enable_contact=True)
        result = fcl.CollisionResult()
        fcl.collide(self._placed(i, world_from_i), self._placed(j, world_from_j), request, result)
        pairs = np.array([(contact.b1, contact.b2) for contact in result.contacts], dtype=np.intp).reshape(-1, 2)
        first = transform_points(world_from_i, self.meshes[i].vertices)[self.meshes[i].faces[pairs[:, 0]]]
        second = transform_points(world_from_j, self.meshes[j].vertices)[self.meshes[j].faces[pairs[:, 1]]]
        return np.concatenate([_pierced(first, second), _pierced(second, first)])

    def _placed(self, i: int, pose: Array) -> fcl.CollisionObject:
        self._objects[i].setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
        return self._objects[i]


def inside(point: Array, mesh: trimesh.Trimesh) -> bool:
    """Whether the surface of ``mesh`` goes once or more around ``point`` (3,), both in the mesh's frame.

    The solid angles of the triangles, seen from the point, add up to full turns (van Oosterom and Strackee).
    """
    a, b, c = np.moveaxis(mesh.triangles.view(np.ndarray) - point, 1, 0)
    la, lb, lc = (np.linalg.norm(corner, axis=1) for corner in (a, b, c))
    ab, bc, ca = (np.einsum("ti,ti->t", u, v) for u, v in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ti,ti->t", a, np.cross(b, c))
    turns = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum() / (2.0 * np.pi)
    return bool(abs(turns) > 0.5)


def _pierced(edged: Array, flat: Array) -> Array:
    """Where the edges of triangles ``edged`` (n, 3, 3) go through the triangle ``flat`` of the same row (n, 3, 3)."""
    start, way = edged, np.roll(edged, -1, axis=1) - edged
    origin, u, v = flat[:, 0], flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    normal = np.cross(u, v)
    along = np.einsum("nei,ni->ne", way, normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.einsum("nei,ni->ne", origin[:, None] - start, normal) / along
        points = start + share[..., None] * way
        offset, size = points - origin[:, None], np.einsum("ni,ni->n", normal, normal)[:, None]
        second = np.einsum("nei,ni->ne", np.cross(u[:, None], offset), normal) / size
        first = np.einsum("nei,ni->ne", np.cross(offset, v[:, None]), normal) / size
        within = (share >= 0.0) & (share <= 1.0) & (np.minimum(first, second) >= -_ON_EDGE)
        within &= first + second <= 1.0 + _ON_EDGE
    pierced: Array = points[within & np.isfinite(points).all(axis=-1)]
    return pierced


def _hierarchy(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64))
    model.endModel()
    return model
