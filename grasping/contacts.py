"""Contact points: the surface sampled once, handed to the facets and refined twice (paper, section III.B)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from time import process_time

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.spatial import cKDTree

from ..errors import InputError
from ..transforms import Array
from .facets import Facets, Indices
from .parameters import GraspParameters
from .part import Part
from .record import Stage
from .repair import edges_of

_SAMPLES_PER_REGION = 8  # samples of the surface on a square of side t_rnn, before thinning
_MOST_SAMPLES = 1_000_000
_SWEEP = np.array([0.6, 0.48, 0.64])  # a direction along no edge that a part is likely to have
_PLASTIC = np.array([0.7548776662466927, 0.5698402909980532])  # the same in two dimensions
_CHUNK = 4096  # points whose distances are computed at once


@dataclass(frozen=True, eq=False)
class Contacts:
    """n contact points in the part's frame, in ascending order of their facets.

    A sample of the surface that lies in several facets may be a contact of each of them: ``sample`` tells.

    Attributes:
        points: (n, 3) [m], on the surface.
        normals: (n, 3) outward unit normals of the triangles the points lie on.
        smooth_normals: (n, 3) outward unit normals of the contact regions: the mean over the facet's surface within
            ``t_rnn`` of the point.
        face: (n,) triangle of the mesh each point lies on.
        facet: (n,) facet each contact belongs to.
        sample: (n,) sample of the surface each contact is.
    """

    points: Array
    normals: Array
    smooth_normals: Array
    face: Indices
    facet: Indices
    sample: Indices

    def __len__(self) -> int:
        """Number of contacts n."""
        return len(self.points)

    def take(self, chosen: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Contacts:
        """The chosen contacts: indices or a mask."""
        return Contacts(**{item.name: getattr(self, item.name)[chosen] for item in fields(self)})


def sample_contacts(part: Part, facets: Facets, parameters: GraspParameters) -> tuple[Contacts, tuple[Stage, ...]]:
    """Sample the surface once, hand each sample to its facets, and refine twice (section III.B.1 and 2).

    Returns:
        The contacts, and the stages ``"sampling"``, ``"refinement 1"`` and ``"refinement 2"``. Sampling takes in the
        samples of the surface and keeps them once for each facet they lie in.

    Raises:
        InputError: ``t_rnn`` asks for too many samples of so large a part.
    """
    started = process_time()
    points, faces = sample_surface(part, parameters.t_rnn)
    sample, facet = _distribute(facets, faces, len(part.mesh.faces))
    sampled = process_time()
    inner = np.flatnonzero(
        boundary_distance(part, facets, points[sample], facet, parameters.t_bdry) >= parameters.t_bdry
    )
    refined = process_time()
    kept = inner[thin(points[sample[inner]], facet[inner], _priority(points[sample[inner]]), parameters.t_rnn)]
    contacts = Contacts(
        points=points[sample[kept]],
        normals=part.mesh.face_normals[faces[sample[kept]]],
        smooth_normals=_smooth_normals(
            points[sample], part.mesh.face_normals[faces[sample]], facet, kept, parameters.t_rnn
        ),
        face=faces[sample[kept]],
        facet=facet[kept],
        sample=sample[kept],
    )
    near = {"near the facet's boundary": len(sample) - len(inner)}
    close = {"near another contact": len(inner) - len(kept)}
    return contacts, (
        Stage("sampling", len(points), len(sample), {}, sampled - started),
        Stage("refinement 1", len(sample), len(inner), near, refined - sampled),
        Stage("refinement 2", len(inner), len(kept), close, process_time() - refined),
    )


def sample_surface(part: Part, t_rnn: float) -> tuple[Array, Indices]:
    """Points (n, 3) [m] spread evenly over the whole surface, about t_rnn / 3 apart, and their triangles (n,).

    The triangles are strung on a space-filling curve and cut into n shares of equal area, a point each; where in its
    triangle a point lies follows a low-discrepancy sequence. Equal meshes have equal samples.

    Raises:
        InputError: More than a million samples.
    """
    areas, triangles = part.mesh.area_faces, part.mesh.triangles
    n = int(np.ceil(areas.sum() * _SAMPLES_PER_REGION / t_rnn**2))
    if n > _MOST_SAMPLES:
        least = np.sqrt(areas.sum() * _SAMPLES_PER_REGION / _MOST_SAMPLES) * 1e3
        raise InputError(
            "t_rnn", f"{t_rnn * 1e3:g} mm asks for {n} samples of this part", f"give {least:.1f} mm or more"
        )
    curve = np.argsort(_place_on_curve(part.mesh.triangles_center), kind="stable")
    filled = np.cumsum(areas[curve])
    faces = curve[np.searchsorted(filled, (np.arange(n) + 0.5) / n * filled[-1])]
    u, v = ((np.arange(n)[:, None] * _PLASTIC) % 1.0).T
    beyond = u + v > 1.0
    u, v = np.where(beyond, 1.0 - u, u), np.where(beyond, 1.0 - v, v)
    a, b, c = np.swapaxes(triangles[faces], 0, 1)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), faces


def boundary_distance(part: Part, facets: Facets, points: Array, facet: Indices, reach: float) -> Array:
    """Distance (n,) [m] of each point (n, 3) to the boundary of its facet (n,), infinite where it is ``reach`` or more.

    The boundary of a facet is the edges that exactly one of its triangles has: its rim and those of its holes. The
    distance is the straight one in space.
    """
    distance = np.full(len(points), np.inf)
    if reach <= 0.0:
        return distance
    start, end, owner = _pieces(*facet_boundary(part, facets), longest=reach)
    radius = reach + np.linalg.norm(end - start, axis=1).max(initial=0.0) / 2.0
    pieces = cKDTree(_by_facet((start + end) / 2.0, owner, radius))
    placed = _by_facet(points, facet, radius)
    for first in range(0, len(points), _CHUNK):
        chunk = cKDTree(placed[first : first + _CHUNK])
        pairs = chunk.sparse_distance_matrix(pieces, radius, output_type="ndarray")
        point, piece = first + pairs["i"], pairs["j"]
        np.minimum.at(distance, point, _to_segment(points[point], start[piece], end[piece]))
    return np.where(distance < reach, distance, np.inf)


def facet_boundary(part: Part, facets: Facets) -> tuple[Array, Array, Indices]:
    """Starts (b, 3) and ends (b, 3) [m] of the edges that one triangle of a facet has alone, and the facets (b,)."""
    faces = np.asarray(part.mesh.faces)
    edge, count = edges_of(faces)
    halves = (3 * facets.faces[:, None] + np.arange(3)).ravel()
    owner = np.repeat(facets.owner, 3)
    _, first, uses = np.unique(owner * len(count) + edge[halves], return_index=True, return_counts=True)
    lone = first[uses == 1]
    face, side = np.divmod(halves[lone], 3)
    return (
        part.mesh.vertices.view(np.ndarray)[faces[face, side]],
        part.mesh.vertices.view(np.ndarray)[faces[face, (side + 1) % 3]],
        owner[lone],
    )


def thin(points: Array, group: Indices, priority: Array, radius: float) -> Indices:
    """Indices of points (n, 3) that stay when, in each group (n,), none may lie within ``radius`` of another [m].

    The point of highest priority (n,) stays first, and so on: those that stay are more than ``radius`` apart, and each
    that goes lies within it of one that stays.
    """
    pairs = cKDTree(_by_facet(points, group, radius)).query_pairs(radius, output_type="ndarray")
    outranked = priority[pairs[:, 0]] < priority[pairs[:, 1]]
    low, high = np.where(outranked, *pairs.T), np.where(outranked, *pairs.T[::-1])
    below = coo_matrix((np.ones(len(low), dtype=bool), (high, low)), shape=(len(points), len(points))).tocsr()
    stays = np.ones(len(points), dtype=bool)
    for i in np.argsort(-priority, kind="stable"):
        if stays[i]:
            stays[below.indices[below.indptr[i] : below.indptr[i + 1]]] = False
    return np.flatnonzero(stays)


def at_most(contacts: Contacts, most: int, t_rnn: float) -> Contacts:
    """Contacts that are ``t_rnn`` [m] apart; of more than ``most`` those that a larger ``t_rnn`` would leave.

    Where these are still too many, as on a great number of small facets, only some of them, evenly in their order.
    """
    if len(contacts) <= most:
        return contacts
    radius = t_rnn * np.sqrt(len(contacts) / most)
    kept = thin(contacts.points, contacts.facet, _priority(contacts.points), radius)
    return contacts.take(kept[np.linspace(0, len(kept) - 1, min(most, len(kept))).astype(np.int64)])


def _distribute(facets: Facets, face: Indices, n_faces: int) -> tuple[Indices, Indices]:
    """Every sample, by its triangle (n,), handed to every facet that holds the triangle: samples and facets (m,)."""
    by_face = np.argsort(face, kind="stable")
    start = np.searchsorted(face[by_face], np.arange(n_faces + 1))
    lengths = np.diff(start)[facets.faces]
    within = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return by_face[np.repeat(start[facets.faces], lengths) + within], np.repeat(facets.owner, lengths)


def _smooth_normals(points: Array, normals: Array, facet: Indices, kept: Indices, radius: float) -> Array:
    """Mean normal (k, 3) of the facet's evenly spread samples within ``radius`` of each kept one."""
    placed = _by_facet(points, facet, radius)
    pairs = cKDTree(placed[kept]).sparse_distance_matrix(cKDTree(placed), radius, output_type="ndarray")
    total = np.zeros((len(kept), 3))
    np.add.at(total, pairs["i"], normals[pairs["j"]])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=normals[kept], where=length > 0.0))


def _by_facet(points: Array, facet: Indices, radius: float) -> Array:
    """Points (n, 4) whose fourth coordinate keeps those of different facets farther apart than ``radius``."""
    return np.column_stack([points, 2.0 * radius * facet])


def _priority(points: Array) -> Array:
    """Priority (n,) in thinning: a sweep across the part, which packs contacts closer than an order without order does.

    It is one for all facets, so that they keep the same samples.
    """
    return np.asarray(-points @ _SWEEP)


def _pieces(start: Array, end: Array, owner: Indices, longest: float) -> tuple[Array, Array, Indices]:
    """Segments cut into equal pieces no longer than ``longest``."""
    count = np.maximum(np.ceil(np.linalg.norm(end - start, axis=1) / longest).astype(np.int64), 1)
    which = np.repeat(np.arange(len(count)), count)
    index = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step = ((end - start) / count[:, None])[which]
    piece = start[which] + index[:, None] * step
    return piece, piece + step, owner[which]


def _to_segment(points: Array, start: Array, end: Array) -> Array:
    """Distance (n,) of points (n, 3) to segments."""
    along = end - start
    share = np.einsum("ni,ni->n", points - start, along) / np.einsum("ni,ni->n", along, along)
    return np.asarray(np.linalg.norm(points - start - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1))


def _place_on_curve(points: Array) -> Indices:
    """Place (n,) of points (n, 3) on a Morton curve through a grid of 1024 cells a side."""
    low = points.min(axis=0)
    cells = ((points - low) / max(float((points.max(axis=0) - low).max()), 1e-12) * 1023.0).astype(np.int64)
    bits = (cells[:, :, None] >> np.arange(10)) & 1
    return np.asarray((bits << (3 * np.arange(10) + np.arange(3)[:, None])).sum(axis=(1, 2)))
