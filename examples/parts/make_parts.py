"""Make the parts of the examples: a toy wheel, and the support with the axles that it goes on.

They take their proportions from the toy of the paper. Run this to write the STL files (in millimetres) anew; it needs
manifold3d, which comes with the development tools.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from trimesh.transformations import rotation_matrix

WHEEL_PROFILE = [  # radius and y, round the section
    (8, 0),  # hub
    (10, 0),
    (10, 7),  # disc
    (28, 7),
    (28, 0),  # rim
    (30, 0),
    (30, 30),
    (20, 30),
    (20, 10),
    (8, 10),
]
SECTIONS = 72  # of everything round


def wheel() -> trimesh.Trimesh:
    """A wheel about the y axis from y = 0, where its hub is, to y = 30 mm; its bore is 16 mm wide."""
    profile = np.array([*WHEEL_PROFILE, WHEEL_PROFILE[0]], dtype=float)
    mesh = trimesh.creation.revolve(profile, sections=SECTIONS)  # about z
    return mesh.apply_transform(rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0]))


def support() -> trimesh.Trimesh:
    """A housing on four feet, symmetric in y: a tube on its roof, an axle of 14 mm to either side at z = 10 mm."""
    solid = [box([-15, -30, 0], [15, 30, 52]), cylinder(8.5, [-5, 0, 50], [-5, 0, 102])]
    room = [
        box([-13, -28, -1], [13, 28, 50]),
        cylinder(6.5, [-5, 0, 49], [-5, 0, 103]),
        box([-16, -18, -1], [16, 18, 25]),  # the arch
        cylinder(18.0, [-16, 0, 25], [16, 0, 25]),
    ]
    axles = [cylinder(7.0, [0, 29 * side, 10], [0, 44 * side, 10]) for side in (-1, 1)]
    axles += [cylinder(6.5, [0, 43 * side, 10], [0, 61 * side, 10]) for side in (-1, 1)]
    hollow = trimesh.boolean.difference([trimesh.boolean.union(solid), *room])
    return trimesh.boolean.union([hollow, *axles])


def box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    """A box between two corners [mm]."""
    return trimesh.creation.box(bounds=[low, high])


def cylinder(radius: float, start: list[float], end: list[float]) -> trimesh.Trimesh:
    """A cylinder between the middles of its ends [mm]."""
    return trimesh.creation.cylinder(radius, segment=np.array([start, end], dtype=float), sections=SECTIONS)


def write(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write a binary STL; triangles in an order that depends on the shape alone."""
    triangles = np.round(mesh.triangles, 4) + 0.0
    first = [np.lexsort(corners.T[::-1])[0] for corners in triangles]
    turned = np.array([np.roll(corners, -k, axis=0) for corners, k in zip(triangles, first, strict=True)])
    ordered = turned[np.lexsort(turned.reshape(-1, 9).T[::-1])]
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(ordered), process=False).export(path)


if __name__ == "__main__":
    folder = Path(__file__).parent
    write(wheel(), folder / "wheel.stl")
    write(support(), folder / "support.stl")
