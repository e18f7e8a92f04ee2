"""The part: a repaired mesh in metres with its mass properties."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path

import numpy as np
import trimesh

from ..transforms import Array


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid part in its own frame, that of its mesh file.

    Attributes:
        name: What reports call it.
        mesh: Repaired triangles in metres, float64; not to be changed.
        mass: [kg].
        center_of_mass: (3,) [m], uniform density.
        watertight: Whether the mesh bounds a volume; if not, the mass properties are those of its convex hull.
        repairs: What was repaired, a sentence each.
        warnings: What could not be repaired, a sentence each.
    """

    name: str
    mesh: trimesh.Trimesh
    mass: float
    center_of_mass: Array
    watertight: bool
    repairs: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        unit: str,
        mass: float | None = None,
        density: float | None = None,
        name: str | None = None,
    ) -> Part:
        """Read a mesh file (STL, OBJ, PLY, OFF, GLB), repair it and weigh it.

        Args:
            path: Mesh file.
            unit: What one unit of the file is: ``"mm"``, ``"cm"``, ``"m"`` or ``"in"``.
            mass: Mass [kg]; either this or the density.
            density: Density [kg/m3].
            name: What reports call the part; the file's stem unless given.

        Raises:
            InputError: The file is missing, too large, no mesh, or its mesh cannot be planned on.
        """
        raise NotImplementedError

    @classmethod
    def from_mesh(
        cls,
        mesh: trimesh.Trimesh,
        *,
        unit: str = "m",
        mass: float | None = None,
        density: float | None = None,
        name: str = "part",
    ) -> Part:
        """Repair and weigh a mesh that is already in memory; it is copied.

        Args:
            mesh: Triangles.
            unit: What one unit of the mesh is: ``"mm"``, ``"cm"``, ``"m"`` or ``"in"``.
            mass: Mass [kg]; either this or the density.
            density: Density [kg/m3].
            name: What reports call the part.

        Raises:
            InputError: The mesh cannot be planned on, with the reason and the cure.
        """
        raise NotImplementedError

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the mesh's contents, the key of caches."""
        content = sha256(np.ascontiguousarray(self.mesh.vertices, dtype="<f8").tobytes())
        content.update(np.ascontiguousarray(self.mesh.faces, dtype="<i8").tobytes())
        return content.hexdigest()
