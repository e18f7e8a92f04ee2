"""Repair of triangle meshes, array in, array out, with a sentence for each thing repaired."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ..transforms import Array

Indices = npt.NDArray[np.int64]

MERGE = 1e-6  # m: vertices nearer than this are one, triangles lower than this have no normal to speak of
_SMALL_HOLE = 0.1  # perimeter of a hole that is filled, over the diagonal of the mesh
_PROBES, _PROBE_OFFSET = 32, 1e-4  # points that look for overlaps, and how far off the surface, over the diagonal


@dataclass(frozen=True)
class Repaired:
    """A mesh after repair, in an order that depends on the shape alone.

    Attributes:
        vertices: (v, 3) [m], sorted.
        faces: (n, 3) wound outwards, each from its lowest vertex, sorted.
        closed: Whether the mesh bounds a volume.
        volume: Enclosed volume [m3], zero where not closed.
        center: (3,) centroid of the enclosed volume [m], zeros where not closed.
        repairs: What was repaired.
        warnings: What could not be.
    """

    vertices: Array
    faces: Indices
    closed: bool
    volume: float
    center: Array
    repairs: tuple[str, ...]
    warnings: tuple[str, ...]


def repair(vertices: Array, faces: Indices) -> Repaired:
    """Merge vertices, drop degenerate and duplicate faces, fill small holes, wind all faces outwards.

    Args:
        vertices: (v, 3) finite [m].
        faces: (n, 3) indices into them.
    """
    repairs: list[str] = []
    warnings: list[str] = []

    def note(count: int, what: str) -> None:
        if count:
            repairs.append(f"{what}: {count}")

    given = len(faces)
    used, faces = np.unique(faces, return_inverse=True)
    vertices, merged = merge_vertices(vertices[used])
    faces = merged[faces.reshape(-1, 3)]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    note(given - len(faces), "degenerate faces dropped")
    if len(faces) == 0:
        return Repaired(np.zeros((0, 3)), faces, False, 0.0, np.zeros(3), tuple(repairs), ())
    unique = _single_layer(faces)
    note(len(faces) - len(unique), "duplicate faces dropped")
    flip, twisted = _inconsistent(unique)
    faces = np.where(flip[:, None], unique[:, ::-1], unique)
    note(int(flip.sum()), "faces wound against their neighbours turned")
    if twisted:
        warnings.append("the surface has one side only (like a Moebius strip): some normals point inwards")
    patches = small_holes(vertices, faces)
    faces = np.vstack([faces, *patches]) if patches else faces
    note(len(patches), "small holes filled")
    flip, closed = _inverted(vertices, faces)
    faces = np.where(flip[:, None], faces[:, ::-1], faces)
    note(int(flip.sum()), "inside-out faces turned")
    volume, center = volume_and_centroid(vertices[faces]) if closed else (0.0, np.zeros(3))
    faces, flat = without_flat_faces(vertices, faces)
    note(flat, "faces without area dropped")
    faces = _canonical(faces)
    if closed and len(faces) and overlaps(vertices[faces]):
        warnings.append("the surface overlaps itself: the centre of mass counts the overlap more than once")
    used, faces = np.unique(faces, return_inverse=True)
    return Repaired(vertices[used], faces.reshape(-1, 3), closed, volume, center, tuple(repairs), tuple(warnings))


def merge_vertices(vertices: Array) -> tuple[Array, Indices]:
    """One vertex for those nearer than ``MERGE``, sorted by x, y, z; and where each given one went."""
    order = np.lexsort(vertices.T[::-1])
    _, first, cell = np.unique(np.round(vertices[order] / MERGE), axis=0, return_index=True, return_inverse=True)
    kept = vertices[order][first]
    pairs = cKDTree(kept).query_pairs(MERGE, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(kept), len(kept)))
    _, cluster = connected_components(graph, directed=False)
    _, representative, cluster = np.unique(cluster, return_index=True, return_inverse=True)
    sorted_first = np.argsort(representative)
    rank = np.argsort(sorted_first)
    merged = np.zeros(len(vertices), dtype=np.int64)
    merged[order] = rank[cluster][cell.ravel()]
    return kept[representative[sorted_first]], merged


def winding_number(points: Array, triangles: Array) -> Array:
    """How often (m,) a closed surface (n, 3, 3) goes around each point (m, 3): 1 inside, 0 outside (van Oosterom)."""
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
    dot_ab, dot_bc, dot_ca = (np.einsum("mni,mni->mn", x, y) for x, y in ((a, b), (b, c), (c, a)))
    numerator = np.einsum("mni,mni->mn", a, np.cross(b, c))
    denominator = la * lb * lc + dot_ab * lc + dot_bc * la + dot_ca * lb
    return np.asarray(np.arctan2(numerator, denominator).sum(axis=1) / (2.0 * np.pi))


def heights(triangles: Array) -> Array:
    """Lowest altitude (n,) [m] of triangles (n, 3, 3), zero for a point."""
    sides = triangles - np.roll(triangles, 1, axis=1)
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    double_area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(double_area / np.maximum(longest, np.finfo(float).tiny))


def volume_and_centroid(triangles: Array) -> tuple[float, Array]:
    """Signed volume [m3] and centroid (3,) [m] that a closed surface (n, 3, 3) encloses (divergence theorem)."""
    origin = triangles.reshape(-1, 3).mean(axis=0)
    corners = triangles - origin
    volumes = np.linalg.det(corners) / 6.0
    volume = float(volumes.sum())
    if volume == 0.0:
        return 0.0, origin
    return volume, origin + volumes @ corners.sum(axis=1) / (4.0 * volume)


def without_flat_faces(vertices: Array, faces: Indices) -> tuple[Indices, int]:
    """The surface without its faces of no area, and how many those were.

    A flat face lies along its longest edge. Turning that edge inside the two triangles that share it gives the
    neighbour beyond a vertex there, where plain removal would leave a crack.
    """
    dropped = 0
    while (flat := np.flatnonzero(heights(vertices[faces]) < MERGE)).size:
        edge, count = edges_of(faces)
        sides = np.linalg.norm(vertices[faces[flat]] - vertices[np.roll(faces[flat], -1, axis=1)], axis=2)
        longest = 3 * flat + np.argmax(sides, axis=1)
        by_edge = np.argsort(edge, kind="stable")
        first = np.searchsorted(edge[by_edge], edge[longest])
        faces, used = faces.copy(), set[int]()
        for half, start in zip(longest.tolist(), first.tolist(), strict=True):
            pair = by_edge[start : start + 2]
            mate = int(pair[0] if pair[1] == half else pair[1]) if count[edge[half]] == 2 else half
            (face, i), (neighbour, j) = divmod(half, 3), divmod(mate, 3)
            if face == neighbour or {face, neighbour} & used:
                continue
            used |= {face, neighbour}
            a, b, apex = np.roll(faces[face], -i)
            beyond = faces[neighbour, j - 1]
            faces[face], faces[neighbour] = (a, beyond, apex), (beyond, b, apex)
        left = heights(vertices[faces]) < MERGE
        if left.sum() >= len(flat):  # no progress: what is left goes
            return faces[~left], dropped + int(left.sum())
        dropped += len(flat) - int(left.sum())
    return faces, dropped


def small_holes(vertices: Array, faces: Indices) -> list[Indices]:
    """Triangle fans over the holes that are one missing triangle or of small perimeter."""
    halves = _half_edges(faces)
    edge, count = edges_of(faces)
    boundary = halves[count[edge] == 1]
    starts, uses = np.unique(boundary[:, 1], return_counts=True)
    plain = set(starts[uses == 1].tolist())
    after = {int(b): int(a) for a, b in boundary if int(b) in plain}  # a hole runs against the faces around it
    limit = _SMALL_HOLE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    present = {tuple(face) for face in np.sort(faces[np.isin(faces, starts).all(axis=1)], axis=1).tolist()}
    fans = []
    while after:
        start, vertex = after.popitem()
        loop = [start]
        while vertex != start and vertex in after:
            loop.append(vertex)
            vertex = after.pop(vertex)
        corners = vertices[loop]
        perimeter = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
        small = len(loop) == 3 or (len(loop) > 3 and perimeter <= limit)
        if vertex == start and small and tuple(sorted(loop)) not in present:
            fans.append(np.array([(loop[0], b, c) for b, c in pairwise(loop[1:])]))
    return fans


def overlaps(triangles: Array) -> bool:
    """Whether probes just inside and outside a closed surface (n, 3, 3) find more or less of it than one layer."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.cumsum(np.linalg.norm(normals, axis=1))
    probed = np.searchsorted(areas, (np.arange(_PROBES) + 0.5) / _PROBES * areas[-1])
    unit = normals[probed] / np.linalg.norm(normals[probed], axis=1, keepdims=True)
    offset = _PROBE_OFFSET * np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)) * unit
    at = triangles[probed].mean(axis=1)
    for points, layers in ((at - offset, 1.0), (at + offset, 0.0)):
        found = np.concatenate([winding_number(chunk, triangles) for chunk in np.array_split(points, _PROBES // 2)])
        if (np.abs(found - layers) > 0.5).mean() > 0.05:
            return True
    return False


def edges_of(faces: Indices) -> tuple[Indices, Indices]:
    """The undirected edge of each half-edge (3 n,), those of face i from 3 i on; and each edge's number of faces."""
    low, high = np.sort(_half_edges(faces), axis=1).T
    _, edge, count = np.unique(low * (high.max(initial=0) + 1) + high, return_inverse=True, return_counts=True)
    return edge, count


def _half_edges(faces: Indices) -> Indices:
    """Directed edges (3 n, 2), those of face i at 3 i, 3 i + 1, 3 i + 2."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)


def _canonical(faces: Indices) -> Indices:
    """The same faces, each from its lowest vertex on, in ascending order."""
    lowest = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (lowest[:, None] + np.arange(3)) % 3, axis=1)
    return np.asarray(faces[np.lexsort(faces.T[::-1])])


def _single_layer(faces: Indices) -> Indices:
    """One face of each set of three vertices, in canonical order.

    Two equal faces wound against each other are a layer without thickness (a wall between two joined bodies): both go,
    unless the whole mesh is such a layer, drawn from both sides.
    """
    faces = _canonical(faces)
    _, first, group = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    even = faces[:, 1] < faces[:, 2]
    net = np.bincount(group.ravel(), weights=np.where(even, 1.0, -1.0), minlength=len(first))
    return _canonical(faces[first[net != 0.0] if net.any() else first])


def _inconsistent(faces: Indices) -> tuple[npt.NDArray[np.bool_], bool]:
    """Which faces (n,) to turn so that neighbours agree, as few as possible; and whether that is impossible somewhere.

    Every face stands twice in a graph, as it is and turned; what must agree is joined. Each orientable piece then falls
    into two components, one the turned copy of the other, and the faces of one of them are the answer.
    """
    n, halves = len(faces), _half_edges(faces)
    edge, count = edges_of(faces)
    manifold = np.flatnonzero(count[edge] == 2)
    one, other = manifold[np.argsort(edge[manifold], kind="stable")].reshape(-1, 2).T
    against = (halves[one, 0] == halves[other, 0]).astype(np.int64)
    f, g = one // 3, other // 3
    rows, columns = np.concatenate([f, f + n]), np.concatenate([g + n * against, g + n * (1 - against)])
    graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(2 * n, 2 * n))
    _, label = connected_components(graph, directed=False)
    flip = label[:n] > label[n:]
    piece = np.minimum(label[:n], label[n:])
    turned, size = np.bincount(piece, weights=flip), np.bincount(piece)
    return flip ^ (2 * turned > size)[piece] & (label[:n] != label[n:]), bool((label[:n] == label[n:]).any())


def _inverted(vertices: Array, faces: Indices) -> tuple[npt.NDArray[np.bool_], bool]:
    """Which faces (n,) lie on bodies that are inside out, cavities excepted; and whether every body is closed."""
    n, owner = len(faces), np.repeat(np.arange(len(faces)), 3)
    edge, count = edges_of(faces)
    incidence = coo_array((np.ones(3 * n), (owner, n + edge)), shape=(n + len(count), n + len(count)))
    body = connected_components(incidence, directed=False)[1][:n]
    triangles = vertices[faces]
    volumes = np.linalg.det(triangles - triangles.reshape(-1, 3).mean(axis=0)) / 6.0
    sign = -1.0 if volumes.sum() < 0.0 else 1.0
    flip = np.full(n, sign < 0.0)
    open_bodies = np.unique(body[owner[count[edge] % 2 == 1]])
    closed_volume = np.bincount(body, weights=sign * volumes)
    members = np.split(np.argsort(body, kind="stable"), np.cumsum(np.bincount(body))[:-1])
    low, high = (np.array([limit(triangles[faces], axis=(0, 1)) for faces in members]) for limit in (np.min, np.max))
    for inverted in np.setdiff1d(np.flatnonzero(closed_volume < 0.0), open_bodies):
        corner = triangles[members[inverted][0], :1]
        around = np.flatnonzero(((low <= corner) & (corner <= high)).all(axis=1))
        rest = [members[other] for other in around if other != inverted]
        if not rest or abs(winding_number(corner, triangles[np.concatenate(rest)])[0]) < 0.5:  # no cavity
            flip[members[inverted]] ^= True
    return flip, len(open_bodies) == 0
