"""Where a pad first touches: its whole face moved along the closing axis until it meets the part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from ..transforms import Array

Indices = npt.NDArray[np.int64]
_TINY = 1e-30
_CHUNK = 256  # anchors checked against all triangles at once
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def first_touch(
    mesh: trimesh.Trimesh,
    anchor: Array,
    outward: Array,
    row: Indices,
    part_from_pad: Array,
    size: tuple[float, float],
    floor: float,
    reach: Array,
) -> Array:
    """How far faces must stand back from where they are put so as to just touch the part (n,) [m]; -inf where nothing is met.

    Exact: each triangle is clipped to the prism that the face sweeps. Negative where the part begins only behind the face.

    Args:
        mesh: Triangles of the part [m].
        anchor: (g, 3) points that the faces lie around, one for all rotations of a pad about one contact.
        outward: (g, 3) unit directions away from the part in which the faces stand back.
        row: (n,) the anchor of each face.
        part_from_pad: (n, 4, 4) where the faces are put; their x axes point towards the part.
        size: Sides of the face along its y and z [m].
        floor: What lies farther than this behind the face (a negative height) need not be found [m].
        reach: (g,) what lies farther outward than this is behind the opened finger and not met [m].
    """
    half = np.array(size) / 2.0
    corners = part_from_pad[:, None, :3, 3] + (_CORNERS * half) @ np.swapaxes(part_from_pad[:, :3, 1:3], -1, -2)
    spread = corners - anchor[row][:, None]
    radius = float(np.linalg.norm(spread, axis=-1).max(initial=0.0))
    tilt = float(np.abs(np.sum(spread * outward[row][:, None], axis=-1)).max(initial=0.0))
    owner, triangle = _triangles_around(mesh, anchor, outward, radius, floor - tilt, reach + tilt)

    # Every face against every triangle around its anchor, in coordinates of the face: y, z, and t along the closing axis.
    first, last = np.searchsorted(owner, row, "left"), np.searchsorted(owner, row, "right")
    count = last - first
    face = np.repeat(np.arange(len(row)), count)
    triangle = triangle[np.repeat(first - np.cumsum(count) + count, count) + np.arange(len(face))]
    axes = np.concatenate([part_from_pad[:, :3, 1:3], outward[row][:, :, None]], axis=-1)
    from_part = np.linalg.inv(axes)
    origin = (from_part @ part_from_pad[:, :3, 3:])[..., 0]
    local = mesh.triangles[triangle] @ np.swapaxes(from_part, -1, -2)[face] - origin[face][:, None]
    over = (local[..., :2].min(axis=1) <= half).all(axis=-1) & (local[..., :2].max(axis=1) >= -half).all(axis=-1)
    over &= local[..., 2].max(axis=1) >= floor
    face, local = face[over], local[over]
    low, high = _heights_in_rectangle(local, half)
    met = (high >= floor) & (low <= reach[row[face]])
    touch = np.full(len(row), -np.inf)
    np.maximum.at(touch, face[met], high[met])
    return touch


def _triangles_around(
    mesh: trimesh.Trimesh, anchor: Array, outward: Array, radius: float, floor: float, reach: Array
) -> tuple[Indices, Indices]:
    """Pairs (anchor, triangle), by anchor, of the triangles that may reach the cylinder about each anchor's outward line."""
    center = mesh.triangles_center
    extent = np.linalg.norm(mesh.triangles - center[:, None], axis=-1).max(axis=-1)
    found = []
    for start in range(0, len(anchor), _CHUNK):
        part = slice(start, start + _CHUNK)
        height = outward[part] @ center.T - np.sum(outward[part] * anchor[part], axis=-1)[:, None]
        apart = np.sum(anchor[part] ** 2, axis=-1)[:, None] - 2.0 * anchor[part] @ center.T + np.sum(center**2, axis=-1)
        near = (height >= floor - extent) & (height <= reach[part, None] + extent)
        near &= apart - height**2 <= (radius + extent) ** 2
        found.append(np.argwhere(near) + [start, 0])
    owner, triangle = np.concatenate(found).T if found else np.zeros((2, 0), dtype=int)
    height = np.sum((mesh.triangles[triangle] - anchor[owner][:, None]) * outward[owner][:, None], axis=-1)
    high = height.max(axis=-1) >= floor
    return owner[high], triangle[high]


def _heights_in_rectangle(triangles: Array, half: Array) -> tuple[Array, Array]:
    """Least and greatest third coordinate (n,) of ``triangles`` (n, 3, 3) within |first| <= half[0], |second| <= half[1].

    Extremes lie where an edge enters or leaves the rectangle, or on a corner of it that the triangle covers. Plus and minus
    infinity where they do not overlap.
    """
    edge = np.roll(triangles, -1, axis=1) - triangles
    along = np.where(np.abs(edge[..., :2]) < _TINY, _TINY, edge[..., :2])
    one, other = (-half - triangles[..., :2]) / along, (half - triangles[..., :2]) / along
    enter = np.clip(np.minimum(one, other).max(axis=-1), 0.0, None)
    leave = np.clip(np.maximum(one, other).min(axis=-1), None, 1.0)
    crosses = enter <= leave
    ends = triangles[..., 2, None] + np.stack([enter, leave], axis=-1) * edge[..., 2, None]
    low = np.where(crosses[..., None], ends, np.inf).min(axis=(1, 2))
    high = np.where(crosses[..., None], ends, -np.inf).max(axis=(1, 2))

    normal = np.cross(edge[:, 0], edge[:, 1])
    steep = np.abs(normal[:, 2]) < _TINY
    for corner in _CORNERS * half:
        to = corner - triangles[..., :2]
        side = edge[..., 0] * to[..., 1] - edge[..., 1] * to[..., 0]
        covered = ((side >= 0.0).all(axis=-1) | (side <= 0.0).all(axis=-1)) & ~steep
        climb = normal[:, 0] * to[:, 0, 0] + normal[:, 1] * to[:, 0, 1]
        height = triangles[:, 0, 2] - climb / np.where(steep, 1.0, normal[:, 2])
        low = np.where(covered, np.minimum(low, height), low)
        high = np.where(covered, np.maximum(high, height), high)
    return low, high
