"""Superimposed segmentation: a mesh peeled into facets that overlap (paper, section III.A)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import cos, pi

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array

from ..errors import InputError
from ..transforms import Array
from .part import Part
from .repair import edges_of
from .softfinger import curvature_radius

Indices = npt.NDArray[np.int64]

ANGLE_SLACK = np.radians(0.1)  # float32 noise of normals
_MOST_ENTRIES = 20_000_000  # triangles of all facets together


@dataclass(frozen=True, eq=False)
class Facets:
    """k facets; facet i holds the triangles ``faces[offsets[i]:offsets[i + 1]]`` of the mesh, in ascending order.

    Attributes:
        faces: (total,) triangles, facet by facet; a triangle may lie in several facets.
        offsets: (k + 1,) where each facet starts in ``faces``.
        seed: (k,) the triangle each facet grew from.
        normal: (k, 3) area-weighted mean of the triangles' unit normals, of unit length.
        radius: (k,) radius of curvature [m], infinite where the facet is flat (section III.B.3).
    """

    faces: Indices
    offsets: Indices
    seed: Indices
    normal: Array
    radius: Array

    def __len__(self) -> int:
        """Number of facets k."""
        return len(self.seed)

    def __getitem__(self, facet: int) -> Indices:
        """Triangles of one facet."""
        return self.faces[self.offsets[facet] : self.offsets[facet + 1]]

    @property
    def owner(self) -> Indices:
        """(total,) the facet of each entry of ``faces``."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))


def segment(part: Part, theta_pln: float, theta_fct: float) -> Facets:
    """Peel the part's mesh into superimposed facets (section III.A).

    Seeds are tried from the largest triangle to the smallest, equal ones by their centres. A triangle that some facet
    holds already, with a seed no farther than ``theta_fct`` from its own normal, is no seed. Angles compare with
    0.1 deg of slack.

    Args:
        part: The part.
        theta_pln: Largest angle between a triangle of a facet and its seed [rad].
        theta_fct: Largest angle between a triangle and the nearest seed of its facets [rad].

    Raises:
        InputError: ``theta_fct`` is so small that the facets would overlap without bound.
    """
    normals, areas, centers = part.mesh.face_normals, part.mesh.area_faces, part.mesh.triangles_center
    neighbours = _neighbours(np.asarray(part.mesh.faces))
    unit, grow = normals.tolist(), cos(min(theta_pln + ANGLE_SLACK, pi))
    serve = cos(min(theta_fct + ANGLE_SLACK, pi))
    served = np.zeros(len(normals), dtype=bool)
    found: dict[bytes, tuple[int, Indices]] = {}
    entries = 0
    for seed in np.lexsort((*centers.T[::-1], -np.round(areas / areas.max(), 6))).tolist():
        if served[seed]:
            continue
        facet = _grow(seed, neighbours, unit, grow)
        entries += len(facet)
        if entries > _MOST_ENTRIES:
            problem = f"the facets would hold more than {_MOST_ENTRIES} triangles together"
            raise InputError("theta_fct", problem, "give a larger theta_fct or a smaller theta_pln")
        served[seed] = True
        if found.setdefault(facet.tobytes(), (seed, facet))[0] == seed:
            served[facet[normals[facet] @ normals[seed] >= serve]] = True
    return _gather(part, [seed for seed, _ in found.values()], [facet for _, facet in found.values()], theta_pln)


def _grow(seed: int, neighbours: list[list[int]], unit: list[list[float]], cosine: float) -> Indices:
    """Triangles connected to the seed through triangles whose normals are near its own, in ascending order."""
    x, y, z = unit[seed]
    facet, frontier, triangles = {seed}, [seed], len(unit)
    while frontier:
        for node in neighbours[frontier.pop()]:
            if node in facet:
                continue
            if node < triangles:
                nx, ny, nz = unit[node]
                if x * nx + y * ny + z * nz < cosine:
                    continue
            facet.add(node)
            frontier.append(node)
    members = np.sort(np.fromiter(facet, dtype=np.int64, count=len(facet)))
    return members[: np.searchsorted(members, triangles)]


def _neighbours(faces: Indices) -> list[list[int]]:
    """The triangles across the edges of each of the n triangles.

    An edge of more than two triangles is a node of its own, n or above, with all of them for neighbours.
    """
    n = len(faces)
    edge, count = edges_of(faces)
    by_edge = np.argsort(edge, kind="stable")
    shared = count[edge[by_edge]]
    one, other = by_edge[shared == 2].reshape(-1, 2).T // 3
    crowded = by_edge[shared > 2]
    hubs, hub = np.unique(edge[crowded], return_inverse=True)
    one, other = np.concatenate([one, crowded // 3]), np.concatenate([other, n + hub])
    size = n + len(hubs)
    rows, columns = np.concatenate([one, other]), np.concatenate([other, one])
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(size, size)).tocsr()
    indices = graph.indices.tolist()
    return [indices[start:end] for start, end in pairwise(graph.indptr.tolist())]


def _gather(part: Part, seeds: list[int], members: list[Indices], theta_pln: float) -> Facets:
    """The facets as arrays, with their normals and radii of curvature."""
    normals, faces, seed = part.mesh.face_normals, np.concatenate(members), np.array(seeds, dtype=np.int64)
    offsets = np.concatenate([[0], np.cumsum([len(facet) for facet in members])])
    mean = np.add.reduceat(normals[faces] * part.mesh.area_faces[faces, None], offsets[:-1])
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    return Facets(
        faces=faces,
        offsets=offsets,
        seed=seed,
        normal=np.divide(mean, length, out=normals[seed].copy(), where=length > 0.0),
        radius=curvature_radius(part.mesh, faces, offsets, seed, theta_pln),
    )
