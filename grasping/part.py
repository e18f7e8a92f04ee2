"""The part: a repaired mesh in metres with its mass properties."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from io import BytesIO
from math import isfinite
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from ..errors import InputError
from ..transforms import Array
from .repair import Repaired, repair, volume_and_centroid

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 25.4e-3}
FORMATS = ("stl", "obj", "ply", "off", "glb")
LARGEST_FILE = 64 * 2**20  # bytes
MOST_FACES = 200_000
_SMALLEST, _LARGEST = 2e-3, 2.0  # m, longest side of the bounding box
_THINNEST = 1e-4  # volume over that of the bounding box's cube below which a mesh is a sheet

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid part in its own frame, that of its mesh file.

    Attributes:
        name: What reports call it.
        mesh: Repaired triangles in metres, float64, in an order that depends on the shape alone; not to be changed.
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
        path = Path(path)
        return cls._build(_read(path), str(path), name=name or path.stem, unit=unit, mass=mass, density=density)

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
        return cls._build(mesh, name, name=name, unit=unit, mass=mass, density=density)

    @classmethod
    def _build(
        cls,
        mesh: trimesh.Trimesh,
        place: str,
        *,
        name: str,
        unit: str,
        mass: float | None,
        density: float | None,
    ) -> Part:
        """Scale, check, repair and weigh."""
        _check_weight(place, mass, density)
        vertices = _scaled(mesh, place, unit)
        fixed = repair(vertices, np.asarray(mesh.faces, dtype=np.int64))
        volume, center, sound = _volume(fixed, place)
        warnings = fixed.warnings
        if not sound:
            warnings += ("the mesh does not bound a volume: mass properties are those of its convex hull",)
        part = cls(
            name=name,
            mesh=trimesh.Trimesh(fixed.vertices, fixed.faces, process=False),
            mass=float(mass if mass is not None else (density or 0.0) * volume),
            center_of_mass=center,
            watertight=sound,
            repairs=fixed.repairs,
            warnings=warnings,
        )
        for sentence in part.repairs:
            _log.info("%s: %s", name, sentence)
        for sentence in part.warnings:
            _log.warning("%s: %s", name, sentence)
        return part

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the mesh's contents, the key of caches; equal shapes have equal digests."""
        content = sha256(np.ascontiguousarray(self.mesh.vertices, dtype="<f8").tobytes())
        content.update(np.ascontiguousarray(self.mesh.faces, dtype="<i8").tobytes())
        return content.hexdigest()


def _read(path: Path) -> trimesh.Trimesh:
    """The triangles of a file, as they stand there."""
    kind = path.suffix.lower().lstrip(".")
    if kind not in FORMATS:
        raise InputError(path, f"{path.suffix or 'no suffix'!r} is no mesh format", f"give one of {', '.join(FORMATS)}")
    try:
        size = path.stat().st_size
        if size > LARGEST_FILE:
            limit = f"{LARGEST_FILE // 2**20} MiB"
            raise InputError(path, f"{size / 2**20:.0f} MiB are more than the limit of {limit}", "reduce the mesh")
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give the path of a mesh file") from error
    if not content:
        raise InputError(path, "the file is empty", "export the mesh again")
    try:
        # From memory, so that no file named inside (materials, buffers) is opened.
        mesh = trimesh.load_mesh(BytesIO(content), file_type=kind, process=False)
    except Exception as error:  # the readers raise whatever their parsing meets
        cure = "export the mesh again: the file may be cut short or be something else"
        raise InputError(path, f"is no readable {kind.upper()} file ({error})", cure) from error
    if not isinstance(mesh, trimesh.Trimesh):
        raise InputError(path, "has no triangles", "export a triangle mesh")
    return mesh


def _check_weight(place: str, mass: float | None, density: float | None) -> None:
    """Exactly one of mass and density, positive and finite."""
    if (mass is None) == (density is None):
        given = "neither mass nor density is given" if mass is None else "mass and density are both given"
        raise InputError(place, given, "give one: mass [kg] or density [kg/m3]")
    for what, value in (("mass [kg]", mass), ("density [kg/m3]", density)):
        if value is not None and not (isfinite(value) and value > 0.0):
            raise InputError(place, f"{what} is {value}", "give a positive number")


def _scaled(mesh: trimesh.Trimesh, place: str, unit: str) -> Array:
    """Vertices in metres, checked."""
    if unit not in UNITS:
        raise InputError(place, f"there is no unit {unit!r}", f"give one of {', '.join(UNITS)}")
    vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces)
    if len(faces) == 0:
        raise InputError(place, "has no triangles", "export a triangle mesh; the file may be cut short")
    if vertices.shape[1:] != (3,) or faces.shape[1:] != (3,):
        raise InputError(place, "its vertices have not three coordinates", "export the mesh again")
    if len(faces) > MOST_FACES:
        raise InputError(
            place,
            f"{len(faces)} faces are more than the {MOST_FACES} that can be planned on",
            "reduce the mesh in the tool that made it, or export it with a coarser tolerance",
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(place, "a face names a vertex that does not exist", "export the mesh again")
    wrong = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(wrong):
        problem = f"{len(wrong)} vertices are not finite, the first is number {wrong[0]}: {vertices[wrong[0]]}"
        raise InputError(place, problem, "export the mesh again")
    size = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    if not _SMALLEST <= size * UNITS[unit] <= _LARGEST:
        likely = [other for other, scale in UNITS.items() if _SMALLEST <= size * scale <= _LARGEST]
        cure = f"the unit is likely {' or '.join(likely)}" if likely else "parts are from 2 mm to 2 m long"
        raise InputError(place, f"in {unit} the part would be {size * UNITS[unit]:.3g} m long", cure)
    return vertices * UNITS[unit]


def _volume(fixed: Repaired, place: str) -> tuple[float, Array, bool]:
    """Volume [m3], centroid (3,) [m], and whether they are the mesh's own; else they are its hull's."""
    thinnest = _THINNEST * float(np.ptp(fixed.vertices, axis=0).max()) ** 3 if len(fixed.faces) else 0.0
    try:
        hull = ConvexHull(fixed.vertices)
    except (QhullError, ValueError) as error:
        raise _flat(place) from error
    if hull.volume < thinnest:
        raise _flat(place)
    if fixed.closed and fixed.volume > _THINNEST * hull.volume:
        return fixed.volume, fixed.center, True
    corners = fixed.vertices[hull.simplices]
    outward = np.einsum(
        "ni,ni->n", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), hull.equations[:, :3]
    )
    corners[outward < 0.0] = corners[outward < 0.0, ::-1]
    return (*volume_and_centroid(corners), False)


def _flat(place: str) -> InputError:
    return InputError(place, "the mesh is flat and bounds no body", "give the part its thickness")
