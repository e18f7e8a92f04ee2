"""Meshes that the tests make, as fixtures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from kumitate.grasping.part import Part
from kumitate.robots.hand import Hand
from kumitate.robots.library import load_hand


def star_prism(radii: np.ndarray, height: float) -> trimesh.Trimesh:
    """A prism over a star-shaped polygon: the corner at angle 2 pi i / n has radius ``radii[i]``."""
    n = len(radii)
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.column_stack([radii * np.cos(angle), radii * np.sin(angle)])
    vertices = np.vstack(
        [np.column_stack([ring, np.full(n, z)]) for z in (0.0, height)] + [[[0.0, 0.0, 0.0], [0.0, 0.0, height]]]
    )
    i, j = np.arange(n), (np.arange(n) + 1) % n
    sides = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    caps = np.vstack(
        [np.column_stack([j, i, np.full(n, 2 * n)]), np.column_stack([i + n, j + n, np.full(n, 2 * n + 1)])]
    )
    return trimesh.Trimesh(vertices, np.vstack([sides, caps]), process=False)


def random_mesh(seed: int) -> trimesh.Trimesh:  # noqa: PLR0911 -- a kind each
    """A small part of a kind and size that the seed chooses, 20 to 60 mm large."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.02, 0.06)
    kind = rng.integers(8)
    if kind == 0:
        return trimesh.convex.convex_hull(rng.normal(size=(rng.integers(5, 60), 3)) * size / 3)
    if kind == 1:
        sphere = trimesh.creation.icosphere(subdivisions=2, radius=size / 2)
        bumps = 1.0 + rng.uniform(0.0, 0.05) * rng.normal(size=(len(sphere.vertices), 1))
        return trimesh.Trimesh(sphere.vertices * bumps, sphere.faces, process=False)
    if kind == 2:
        return trimesh.creation.box(rng.uniform(0.3, 1.0, 3) * size)
    if kind == 3:
        return star_prism(rng.uniform(0.2, 0.5, rng.integers(4, 12)) * size, rng.uniform(0.1, 1.0) * size)
    if kind == 4:
        return trimesh.creation.cylinder(radius=size / 3, height=size, sections=int(rng.integers(8, 40)))
    if kind == 5:
        return trimesh.creation.torus(size / 3, size / 8, int(rng.integers(12, 30)), int(rng.integers(8, 20)))
    if kind == 6:  # two blocks that touch along an edge, which four triangles share
        block = trimesh.creation.box([size / 2] * 3)
        return trimesh.util.concatenate([block, block.copy().apply_translation([size / 2, 0.0, size / 2])])
    return trimesh.creation.annulus(r_min=size / 5, r_max=size / 2, height=size / 3, sections=int(rng.integers(8, 40)))


@pytest.fixture(scope="session")
def random_part() -> Callable[[int], Part]:
    """Part of a random mesh, by seed."""
    return lambda seed: Part.from_mesh(random_mesh(seed), mass=0.1, name=f"random {seed}")


@pytest.fixture(scope="session")
def gripper() -> Hand:
    """The shipped gripper with two fingers."""
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="session")
def made() -> Callable[[str], Part]:
    """Part of a mesh of a size to hold, by name: block, tube, bracket or ball."""

    def part(name: str) -> Part:
        mesh = {
            "block": lambda: trimesh.creation.box([0.06, 0.04, 0.03]),
            "tube": lambda: trimesh.creation.annulus(r_min=0.012, r_max=0.02, height=0.06, sections=48),
            "bracket": lambda: (
                trimesh.creation.box([0.08, 0.05, 0.006])
                + trimesh.creation.box([0.006, 0.05, 0.06]).apply_translation([0.037, 0.0, 0.033])
            ),
            "ball": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.025),
        }[name]()
        return Part.from_mesh(mesh, mass=0.1, name=name)

    return part


@pytest.fixture(scope="session")
def paper_part(paper_objects) -> Callable[[str], Part]:
    """Part of one of the paper's meshes, by name."""
    return lambda name: Part.load(paper_objects / f"{name}.stl", unit="m", mass=0.1)


@pytest.fixture(scope="session")
def plate_with_hole() -> Part:
    """A washer: outer radius 30 mm, hole of 10 mm radius, 8 mm thick."""
    mesh = trimesh.creation.annulus(r_min=0.010, r_max=0.030, height=0.008, sections=48)
    return Part.from_mesh(mesh, mass=0.1, name="plate with hole")


@pytest.fixture(scope="session")
def block() -> Part:
    """A block of 40 x 30 x 20 mm about the origin, of 12 triangles."""
    return Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.1, name="block")
