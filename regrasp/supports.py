"""Supports: horizontal rectangles of a cell, and the free spots and turns at which a part rests on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..robots.state import Body
from ..transforms import Array, checked_poses, compose, invert, rotation_about, transform_points
from .placements import Placements
from .polygons import outline

_TOP = 1e-6  # m; corners within this of the highest one lie on the top
_LEVEL = 1e-6  # rad
_FILLED = 1e-6  # share of the top's area by which it may differ from a rectangle's


@dataclass(frozen=True, eq=False)
class Support:
    """A horizontal rectangle that parts may stand on.

    Attributes:
        name: Name of the body it belongs to.
        world_from_support: Pose (4, 4) of the rectangle's centre; x and y along its sides, z up.
        size: (2,) lengths along x and y [m].
    """

    name: str
    world_from_support: Array
    size: Array

    def __post_init__(self) -> None:
        place = f"support {self.name}"
        pose, size = checked_poses(self.world_from_support, place), np.asarray(self.size, dtype=float)
        if pose.shape != (4, 4) or not pose[2, 2] > 0.0 or np.linalg.norm(pose[:2, 2]) > _LEVEL:
            raise InputError(place, "its pose is not level", "give one pose (4, 4) whose z axis points up")
        if size.shape != (2,) or not (np.isfinite(size) & (size > 0.0)).all():
            raise InputError(place, f"its size is {size}", "give two lengths above 0 m")
        object.__setattr__(self, "world_from_support", pose)
        object.__setattr__(self, "size", size)

    @classmethod
    def top_of(cls, body: Body, world_from_body: Array) -> Support:
        """The top of ``body`` at pose (4, 4): of a box, or of a fixture whose highest face is a level rectangle.

        Its x axis is the side nearer to the world's x axis.

        Raises:
            InputError: The body's top is no level rectangle.
        """
        place = f"support {body.name}"
        corners = transform_points(checked_poses(world_from_body, place), body.mesh.vertices)
        highest = corners[:, 2].max()
        on_top = corners[:, 2] > highest - _TOP
        flat = corners[body.mesh.faces[on_top[body.mesh.faces].all(axis=1)], :2]
        area = np.abs(np.linalg.det(flat[:, 1:] - flat[:, :1])).sum() / 2.0
        if area > 0.0:
            around = outline(corners[on_top])
            sides = np.roll(around, -1, axis=0) - around
            x, y = sides[np.linalg.norm(sides, axis=1).argmax()]
            turn = (np.arctan2(y, x) + np.pi / 4.0) % (np.pi / 2.0) - np.pi / 4.0
            rotation = rotation_about([0.0, 0.0, 1.0], turn)
            spread = around @ rotation[:2, :2]
            size, middle = np.ptp(spread, axis=0), (spread.min(axis=0) + spread.max(axis=0)) / 2.0
            if abs(area / size.prod() - 1.0) < _FILLED:
                center = np.append(rotation[:2, :2] @ middle, highest)
                return cls(body.name, compose(rotation, center), size)
        raise InputError(place, "its top is no level rectangle", "turn it level, or give the rectangle as a Support")


@dataclass(frozen=True, eq=False)
class Spots:
    """m poses of a part on a support, by placement, then turn, then place.

    Attributes:
        placement: (m,) the placement of the part.
        turn: (m,) about the vertical, from the placement's own x axis along the support's [rad].
        world_from_part: (m, 4, 4).
    """

    placement: npt.NDArray[np.int64]
    turn: Array
    world_from_part: Array

    def __len__(self) -> int:
        """Number of poses m."""
        return len(self.turn)


def find_spots(
    placements: Placements,
    support: Support,
    *,
    turns: int = 4,
    spacing: float = 0.05,
    inset: float = 0.005,
    occupied: Sequence[Array] = (),
) -> Spots:
    """The free spots and turns of a part on a support.

    The centre of mass stands above the points of a grid about the support's middle, where the whole support polygon
    lies on the rectangle and the part's outline overlaps none of those that are there already.

    Args:
        placements: How the part may rest.
        support: Where.
        turns: How many turns about the vertical, evenly over a full one.
        spacing: Of the grid [m].
        inset: Distance of support polygons from the rectangle's sides [m].
        occupied: Convex outlines (k, 2) in the world, counterclockwise, of what stands on the support.

    Raises:
        InputError: No turn, or a spacing or inset that is no such length.
    """
    if turns < 1:
        raise InputError("turns", f"{turns} is no number of turns", "give 1 or more; 4 is usual")
    if not (np.isfinite(spacing) and spacing > 0.0):
        raise InputError("spacing", f"{spacing} m is no grid", "give a length above 0 m")
    if not (np.isfinite(inset) and inset >= 0.0):
        raise InputError("inset", f"{inset} m is no distance", "give 0 m or more")
    angles = 2.0 * np.pi * np.arange(turns) / turns
    grid = _grid(support.size, spacing)
    low, high = placements.support.turned(angles).bounds  # (turns n, 2)
    room = support.size / 2.0 - inset
    free = ((grid + low[:, None] >= -room) & (grid + high[:, None] <= room)).all(axis=2)  # (turns n, points)
    outlines, support_from_world = placements.outline.turned(angles), invert(support.world_from_support)
    for other in occupied:
        there = other @ support_from_world[:2, :2].T + support_from_world[:2, 3]
        free &= outlines.apart(there, grid)

    turn, placement, point = np.nonzero(free.reshape(turns, len(placements), len(grid)))
    order = np.lexsort((point, turn, placement))
    turn, placement, point = turn[order], placement[order], point[order]
    height = np.zeros((len(point), 1))
    support_from_surface = compose(rotation_about([0.0, 0.0, 1.0], angles[turn]), np.hstack([grid[point], height]))
    world_from_part = support.world_from_support @ support_from_surface @ placements.surface_from_part[placement]
    return Spots(placement, angles[turn], world_from_part)


def _grid(size: Array, spacing: float) -> Array:
    """Points (p, 2) ``spacing`` apart on a rectangle of ``size`` about the origin, row by row [m]."""
    x, y = (spacing * (np.arange(n) - (n - 1) / 2.0) for n in (size // spacing).astype(int) + 1)
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
