"""Contact pairs: two points of the surface that a gripper can press against each other (paper, section IV.B)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from time import process_time

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree
from trimesh.ray.ray_pyembree import RayMeshIntersector

from ..transforms import Array
from .contacts import Contacts
from .facets import Facets, Indices
from .parameters import GraspParameters
from .part import Part
from .record import Stage

ANGLE_SLACK = np.radians(0.1)  # the noise of float32 meshes
_THINNEST = 1e-5  # m; closer points are one point of the surface


@dataclass(frozen=True, eq=False)
class ContactPairs:
    """n contact pairs in the part's frame, the most parallel first.

    Attributes:
        points: (n, 2, 3) the two points on the surface [m].
        normals: (n, 2, 3) outward unit normals of the surface at the points.
        facets: (n, 2) facets the points belong to.
        parallelness: (n,) the smallest of four angles [rad], pi at best: between the two facets' normals, between the
            surface normals at the two points, and between each of these and the closing axis as it enters there.
    """

    points: Array
    normals: Array
    facets: Indices
    parallelness: Array

    def __len__(self) -> int:
        """Number of pairs n."""
        return len(self.points)

    @property
    def width(self) -> Array:
        """(n,) distance between the two points [m]."""
        return np.asarray(np.linalg.norm(self.points[:, 1] - self.points[:, 0], axis=-1))

    @property
    def axis(self) -> Array:
        """(n, 3) unit closing axis, from the first point to the second."""
        return (self.points[:, 1] - self.points[:, 0]) / self.width[:, None]

    def take(self, chosen: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> ContactPairs:
        """The chosen pairs: indices or a mask."""
        return ContactPairs(*(getattr(self, item.name)[chosen] for item in fields(self)))


def find_pairs(
    part: Part, facets: Facets, contacts: Contacts, parameters: GraspParameters
) -> tuple[ContactPairs, tuple[Stage, ...]]:
    """Send a line from each contact into the part and pair it with every opposing facet it meets (IV.B, lines 1 to 8).

    Two pairs whose points lie within ``t_rnn`` of each other's, either way round, are one: the more parallel stays. So
    the pairs at a larger ``theta_parl`` are among those at a smaller one.

    Returns:
        The pairs, and the stage ``"contact pairs"``.
    """
    started = process_time()
    inward = -contacts.smooth_normals
    hits, ray, face = RayMeshIntersector(part.mesh).intersects_location(contacts.points, inward)
    points = np.stack([contacts.points[ray], hits], axis=1)
    normals = np.stack([contacts.normals[ray], part.mesh.face_normals[face]], axis=1)
    axis = points[:, 1] - points[:, 0]
    width = np.linalg.norm(axis, axis=-1)
    axis /= np.maximum(width, _THINNEST)[:, None]
    opposing, opposite = _most_opposing_facet(facets, contacts.facet[ray], face)
    parallelness = np.min(
        [
            opposing,
            _angle(normals[:, 0], normals[:, 1]),
            _angle(normals[:, 0], axis),
            _angle(normals[:, 1], -axis),
        ],
        axis=0,
    )
    good = np.flatnonzero((parallelness >= parameters.theta_parl - ANGLE_SLACK) & (width > _THINNEST))
    good = good[np.argsort(-parallelness[good], kind="stable")]
    good = good[_distinct(points[good], parameters.t_rnn)]
    both = np.stack([contacts.facet[ray], opposite], axis=1)
    pairs = ContactPairs(points[good], normals[good], both[good], parallelness[good])
    return pairs, (Stage("contact pairs", len(contacts), len(pairs), {}, process_time() - started),)


def _angle(a: Array, b: Array) -> Array:
    return np.asarray(np.arccos(np.clip(np.sum(a * b, axis=-1), -1.0, 1.0)))


def _most_opposing_facet(facets: Facets, facet: Indices, face: Indices) -> tuple[Array, Indices]:
    """Of the facets that hold ``face`` (n,), the one most opposed to ``facet`` (n,): its angle [rad] and its index."""
    by_face = np.argsort(facets.faces, kind="stable")
    owner, sorted_faces = facets.owner[by_face], facets.faces[by_face]
    first, last = np.searchsorted(sorted_faces, face, "left"), np.searchsorted(sorted_faces, face, "right")
    angle, best = np.zeros(len(face)), np.full(len(face), -1)
    for turn in range(int((last - first).max(initial=0))):
        (left,) = np.nonzero(first + turn < last)
        candidate = owner[first[left] + turn]
        opposing = _angle(facets.normal[facet[left]], facets.normal[candidate])
        better = opposing > angle[left]
        angle[left[better]], best[left[better]] = opposing[better], candidate[better]
    return angle, best


def _distinct(points: Array, radius: float) -> Indices:
    """Indices of the pairs ``points`` (n, 2, 3) that no earlier kept pair matches within ``radius`` at both ends."""
    n = len(points)
    there, back = cKDTree(points.reshape(n, 6)), cKDTree(points[:, ::-1].reshape(n, 6))
    straight = there.query_pairs(np.sqrt(2.0) * radius, output_type="ndarray")
    crossed = there.sparse_distance_matrix(back, np.sqrt(2.0) * radius, output_type="ndarray")
    crossed = np.stack([crossed["i"], crossed["j"]], axis=1)[crossed["i"] < crossed["j"]]
    close = [
        near[
            np.linalg.norm(points[near[:, 0]] - points[near[:, 1]][:, turn], axis=-1).max(axis=-1, initial=0.0)
            <= radius
        ]
        for near, turn in ((straight, slice(None)), (crossed, slice(None, None, -1)))
    ]
    before, after = np.concatenate(close).T
    earlier = coo_matrix((np.ones(len(after), dtype=int), (after, before)), shape=(n, n)).tocsr()
    open_, kept = np.ones(n, dtype=bool), np.zeros(n, dtype=bool)
    while open_.any():
        chosen = open_ & (earlier @ open_ == 0)
        kept |= chosen
        open_ &= ~chosen & (earlier @ chosen == 0)
    return np.flatnonzero(kept)
