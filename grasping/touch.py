"""Where a pad first touches: its whole face moved along the closing axis until it meets the part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from ..transforms import Array

Indices = npt.NDArray[np.int64]
_TINY = 1e-30
_CHUNK = 100_000  # faces or anchors times triangles looked at in one go
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def first_touch(
    mesh: trimesh.Trimesh,
    place: Indices,
    outward: Array,
    part_from_pad: Array,
    size: tuple[float, float],
    *,
    floor: float,
    reach: Array,
) -> Array:
    """How far faces must stand back to just touch the part (n,) [m]; -inf where they meet nothing.

    Exact: each triangle is clipped to the prism that the face sweeps. Negative where the part begins only behind the
    face.

    Args:
        mesh: Triangles of the part [m].
        place: (n,) faces of one place (the rotations of a pad about one contact) share ``outward``, ``reach`` and the
            search for triangles around them.
        outward: (n, 3) unit directions away from the part, in which the faces stand back.
        part_from_pad: (n, 4, 4) where the faces are put; their y and z axes span them.
        size: Sides of the faces along y and z [m].
        floor: A surface farther than this behind a face (a negative height) need not be found [m].
        reach: (n,) a surface farther outward than this lies behind the opened finger and is not met [m].
    """
    if len(place) == 0:
        return np.zeros(0)
    _, first_row, row = np.unique(place, return_index=True, return_inverse=True)
    outward_of, reach_of = outward[first_row], reach[first_row]
    anchor = np.zeros((len(first_row), 3))
    np.add.at(anchor, row, part_from_pad[:, :3, 3])
    anchor /= np.bincount(row, minlength=len(anchor))[:, None]
    half = np.array(size) / 2.0
    corners = part_from_pad[:, None, :3, 3] + (_CORNERS * half) @ np.swapaxes(part_from_pad[:, :3, 1:3], -1, -2)
    spread = corners - anchor[row][:, None]
    radius = float(np.linalg.norm(spread, axis=-1).max(initial=0.0))
    tilt = float(np.abs(np.sum(spread * outward[:, None], axis=-1)).max(initial=0.0))
    first, around = _triangles_around(mesh, anchor, outward_of, radius, floor - tilt, reach_of + tilt)
    face_from_part = np.linalg.inv(np.concatenate([part_from_pad[:, :3, 1:3], outward[:, :, None]], axis=-1))
    origin = (face_from_part @ part_from_pad[:, :3, 3:])[..., 0]
    count = np.diff(first)[row]
    touch = np.full(len(row), -np.inf)
    for some in np.split(np.arange(len(row)), np.flatnonzero(np.diff(np.cumsum(count) // _CHUNK)) + 1):
        face = np.repeat(some, count[some])
        turn = np.arange(len(face)) - np.repeat(np.cumsum(count[some]) - count[some], count[some])
        triangle = around[first[row[face]] + turn]
        local = _in_face(mesh.triangles.view(np.ndarray), triangle, face_from_part, origin, face)
        least, most = local.min(axis=0), local.max(axis=0)
        over = np.abs(least[:2] + most[:2]) <= 2.0 * half[:, None] + most[:2] - least[:2]
        over = over.all(axis=0) & (most[2] >= floor)
        face, low, high = face[over], least[2, over], most[2, over]
        within = (np.maximum(-least[:2, over], most[:2, over]) <= half[:, None]).all(axis=0)
        low[~within], high[~within] = _heights_in_rectangle(np.take(local, np.flatnonzero(over)[~within], axis=2), half)
        met = (high >= floor) & (low <= reach[face])
        np.maximum.at(touch, face[met], high[met])
    return touch


def _in_face(triangles: Array, triangle: Indices, face_from_part: Array, origin: Array, face: Indices) -> Array:
    """Corners of each ``triangle`` (m,) in the oblique coordinates of its ``face`` (m,): (3 corners, 3 coordinates, m).

    The coordinates are y and z of the face and the distance along the closing axis. The long axis is last, which keeps
    the arithmetic quick.
    """
    corners = np.take(triangles.transpose(1, 2, 0), triangle, axis=2)
    turns = np.take(face_from_part.transpose(1, 2, 0), face, axis=2)
    local = np.zeros_like(corners)
    for k in range(3):
        local[:, k] = turns[k, 0] * corners[:, 0] + turns[k, 1] * corners[:, 1] + turns[k, 2] * corners[:, 2]
    return local - np.take(origin.T, face, axis=1)


def _triangles_around(
    mesh: trimesh.Trimesh, anchor: Array, outward: Array, radius: float, floor: float, reach: Array
) -> tuple[Indices, Indices]:
    """The triangles that may reach the cylinder about each anchor's outward line.

    Returns:
        Where each anchor's triangles start (g + 1,), and the triangles, anchor by anchor.
    """
    center = mesh.triangles_center.view(np.ndarray)
    extent = np.linalg.norm(mesh.triangles - center[:, None], axis=-1).max(axis=-1)
    square = np.einsum("ti,ti->t", center, center)
    corners = np.ascontiguousarray(np.swapaxes(mesh.triangles.view(np.ndarray), 0, 1))
    anchor_height = np.einsum("gi,gi->g", anchor, outward)
    found = []
    step = max(1, _CHUNK // max(len(center), 1))
    for start in range(0, len(anchor), step):
        some = slice(start, start + step)
        height = np.einsum("gi,ti->gt", outward[some], center) - anchor_height[some, None]
        near = (height >= floor - extent) & (height <= reach[some, None] + extent)
        apart = square - 2.0 * np.einsum("gi,ti->gt", anchor[some], center) - height**2 - (radius + extent) ** 2
        near &= apart <= -np.einsum("gi,gi->g", anchor[some], anchor[some])[:, None]
        owner, triangle = np.nonzero(near)
        top = np.einsum("vti,ti->vt", corners[:, triangle], outward[some][owner]).max(axis=0)
        high = top - anchor_height[some][owner] >= floor
        found.append((start + owner[high], triangle[high]))
    owner, triangle = (np.concatenate(column) for column in zip(*found, strict=True))
    return np.searchsorted(owner, np.arange(len(anchor) + 1)), triangle


def _heights_in_rectangle(triangles: Array, half: Array) -> tuple[Array, Array]:
    """Least and greatest third coordinate (m,) of triangles within |first| <= half[0] and |second| <= half[1].

    Extremes lie where an edge enters or leaves the rectangle, or on a corner of it that the triangle covers.

    Args:
        triangles: (3, 3, m) corners, coordinates, triangles.
        half: (2,) half sides of the rectangle.

    Returns:
        The extremes; plus and minus infinity where triangle and rectangle do not overlap.
    """
    low, high = np.full(triangles.shape[2], np.inf), np.full(triangles.shape[2], -np.inf)
    sides = half[:, None]
    for start, end in ((0, 1), (1, 2), (2, 0)):
        edge = triangles[end] - triangles[start]
        along = np.where(np.abs(edge[:2]) < _TINY, _TINY, edge[:2])
        one, other = (-sides - triangles[start, :2]) / along, (sides - triangles[start, :2]) / along
        enter = np.maximum(np.minimum(one, other).max(axis=0), 0.0)
        leave = np.minimum(np.maximum(one, other).min(axis=0), 1.0)
        for share in (enter, leave):
            height = triangles[start, 2] + share * edge[2]
            low = np.where(enter <= leave, np.minimum(low, height), low)
            high = np.where(enter <= leave, np.maximum(high, height), high)

    least, most = triangles[:, :2].min(axis=0), triangles[:, :2].max(axis=0)
    for corner in _CORNERS * sides[:, 0]:
        around = np.flatnonzero(((least <= corner[:, None]) & (corner[:, None] <= most)).all(axis=0))
        near = np.take(triangles, around, axis=2)
        x, y = np.moveaxis(corner[:, None] - near[:, :2], 1, 0)
        weight = np.roll(x, -1, axis=0) * np.roll(y, -2, axis=0) - np.roll(y, -1, axis=0) * np.roll(x, -2, axis=0)
        area = weight.sum(axis=0)
        covered = (np.abs(area) > _TINY) & ((weight.min(axis=0) >= 0.0) | (weight.max(axis=0) <= 0.0))
        height = (weight * near[:, 2]).sum(axis=0)[covered] / area[covered]
        low[around[covered]] = np.minimum(low[around[covered]], height)
        high[around[covered]] = np.maximum(high[around[covered]], height)
    return low, high
