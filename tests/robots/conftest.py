"""Fixtures of the ground floor's tests: meshes, cells, and a second opinion on collisions."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import trimesh
from cells import MAKERS, make_cell
from reference import Reference

from kumitate.robots.scene import Scene
from kumitate.robots.state import SceneState


@pytest.fixture(scope="session")
def make_mesh() -> Callable[..., trimesh.Trimesh]:
    """Closed non-convex meshes by kind and sizes."""
    return lambda kind, *sizes: MAKERS[kind](*sizes)


@pytest.fixture(scope="session")
def reference() -> Callable[[Scene], Reference]:
    """Makes the reference of a scene of a shipped robot."""
    return Reference


@pytest.fixture(scope="session")
def cell() -> Callable[[str], tuple[Scene, list[SceneState]]]:
    """A cell of a shipped robot, and states of it in which no two still bodies touch."""
    return make_cell
