"""Grasp sets: arrays of grasps of one part by one hand, the best first."""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, fields, replace
from io import BytesIO
from math import prod
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..transforms import Array, checked_poses
from .measured import Measured
from .record import Stage

FORMAT = 1
LARGEST_FILE = 2**28  # bytes, unpacked; close to a million grasps
_UNIT = 1e-6


@dataclass(frozen=True, eq=False)
class GraspSet:
    """n grasps of a part by a hand, in the part's frame, the best first.

    Attributes:
        part: Name of the part.
        hand: Name of the hand.
        part_from_hand: (n, 4, 4) poses of the hand frame at ``opening``.
        opening: (n,) opening at which the pads stand on the part [m]; 0 for a suction cup.
        approach_opening: (n,) how wide the fingers open with the base where it grasps until the part is in the way;
            fully, for most [m].
        contacts: (n, k, 3) contact points [m]: the single finger's, then the other side's; one for a cup.
        normals: (n, k, 3) outward unit normals of the surface at the contacts.
        facets: (n, k) facets the contacts belong to.
        force: (n,) normal force at each contact [N].
        margin: (n,) stability margin, 1 at best, 0 where the part is about to turn (eq. 4).
        distance: (n,) distance between grasp centre and centre of mass [m].
        parallelness: (n,) how opposed the contacts are [rad], pi at best (see ContactPairs); pi for a cup.
        quality: (n,) in [0, 1]: margin x nearness to the centre of mass x cosine of the contacts' misalignment; less
            where the forces of the two sides pass each other (``force_offsets``).
        record: What each stage took, kept and dropped.
        key: Digest of mesh, hand and parameters; empty when unknown.
        measured: What simulation measured of the n grasps; none when they were not simulated.
    """

    part: str
    hand: str
    part_from_hand: Array
    opening: Array
    approach_opening: Array
    contacts: Array
    normals: Array
    facets: npt.NDArray[np.int64]
    force: Array
    margin: Array
    distance: Array
    parallelness: Array
    quality: Array
    record: tuple[Stage, ...] = ()
    key: str = ""
    measured: Measured | None = None

    def __post_init__(self) -> None:
        """Check shapes, finiteness, poses, unit normals and the order.

        Raises:
            InputError: An array is not what this class promises.
        """
        n, k = np.shape(self.contacts)[:2] if np.ndim(self.contacts) == 3 else (-1, -1)
        for name, shape in _shapes(n, k).items():
            array = getattr(self, name)
            if not isinstance(array, np.ndarray) or array.shape != shape:
                raise InputError(f"grasps: {name}", f"shape {np.shape(array)}", f"give an array of shape {shape}")
            if array.dtype.kind not in ("i" if name == "facets" else "f") or not np.isfinite(array).all():
                raise InputError(
                    f"grasps: {name}", f"dtype {array.dtype}, or values that are not finite", "give finite numbers"
                )
        checked_poses(self.part_from_hand, "grasps: part_from_hand")
        if np.any(np.abs(np.linalg.norm(self.normals, axis=-1) - 1.0) > _UNIT):
            raise InputError("grasps: normals", "a normal is not of unit length", "normalise it")
        if np.any(self.opening < 0.0) or np.any(self.approach_opening < self.opening):
            raise InputError(
                "grasps: opening", "negative, or wider than the approach opening", "give 0 <= opening <= approach"
            )
        if self.measured is not None and len(self.measured) != n:
            raise InputError("grasps: measured", f"of {len(self.measured)} grasps", f"measure all {n}")
        for name in _ARRAYS:
            getattr(self, name).setflags(write=False)

    def __len__(self) -> int:
        """Number of grasps n."""
        return len(self.opening)

    def __getitem__(self, chosen: npt.NDArray[np.int64] | npt.NDArray[np.bool_] | slice) -> GraspSet:
        """The chosen grasps: a mask, indices or a slice."""
        arrays: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        return replace(self, **arrays, measured=None if self.measured is None else self.measured.take(chosen))

    def joined(self, other: GraspSet) -> GraspSet:
        """These grasps, then the other's; names and record are kept, what was measured only if it was of both."""
        arrays: dict[str, Any] = {n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in _ARRAYS}
        measured = None
        if self.measured is not None and other.measured is not None:
            measured = self.measured.joined(other.measured)
        return replace(self, **arrays, measured=measured)

    def held(self) -> GraspSet:
        """The grasps that were tried in simulation, and held.

        Raises:
            InputError: They were not simulated.
        """
        if self.measured is None:
            raise InputError("grasps", "nothing was measured of them", "run `kumitate simulate`")
        return self[self.measured.held]

    def thin(self, n: int) -> GraspSet:
        """At most n grasps that are good and spread over position and orientation (see ``spread``)."""
        return self[self.spread(n)]

    def spread(self, n: int) -> npt.NDArray[np.int64]:
        """Indices, ascending, of at most n grasps that are good and spread over position and orientation.

        The best of all is the first. Each next one has the largest quality times distance to those already chosen; the
        distance adds the grasp centres' (over the spread of all centres) to the angle between the hands' orientations
        (over half a turn).
        """
        if n >= len(self):
            return np.arange(len(self))
        centers, rotations = self.part_from_hand[:, :3, 3], self.part_from_hand[:, :3, :3].reshape(-1, 9)
        spread = max(float(np.linalg.norm(centers - centers.mean(axis=0), axis=-1).max()), _UNIT)
        nearest, chosen = np.full(len(self), np.inf), [int(np.argmax(self.quality))]
        while len(chosen) < n:
            last = chosen[-1]
            angle = np.arccos(np.clip((rotations @ rotations[last] - 1.0) / 2.0, -1.0, 1.0))
            nearest = np.minimum(nearest, np.linalg.norm(centers - centers[last], axis=-1) / spread + angle / np.pi)
            nearest[last] = -np.inf
            chosen.append(int(np.argmax((self.quality + _UNIT) * nearest)))
        return np.sort(np.array(chosen[:n], dtype=np.int64))

    def save(self, path: str | Path) -> None:
        """Write one ``.npz`` file (arrays and JSON text, no pickle)."""
        record = [{**{f.name: getattr(s, f.name) for f in fields(s)}, "dropped": dict(s.dropped)} for s in self.record]
        header = {"format": FORMAT, "part": self.part, "hand": self.hand, "key": self.key, "record": record}
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        if self.measured is not None:
            arrays |= {f"{_MEASURED}{item.name}": getattr(self.measured, item.name) for item in fields(Measured)}
        with Path(path).open("wb") as file:
            np.savez(file, header=np.array(json.dumps(header)), **arrays)

    @classmethod
    def load(cls, path: str | Path) -> GraspSet:
        """Read what ``save`` wrote, checking everything.

        Raises:
            InputError: The file is missing, of another format or version, or its contents are malformed.
        """
        cure = "write it again with GraspSet.save or `kumitate grasps`"
        try:
            header, arrays, measured = _read(Path(path))
            if header.format != FORMAT:
                raise InputError(path, f"format {header.format}, and this version reads {FORMAT}", cure)
        except FileNotFoundError as error:
            raise InputError(path, "there is no such file", "check the path") from error
        except InputError:
            raise
        except Exception as error:  # numpy, zipfile, zlib and json raise a dozen errors at random bytes
            raise InputError(path, f"no grasp set ({error})", cure) from error
        try:
            return cls(
                part=header.part,
                hand=header.hand,
                **arrays,
                record=header.record,
                key=header.key,
                measured=Measured(**measured) if measured else None,
            )
        except InputError as error:
            raise InputError(f"{path}: {error.place}", error.problem, cure) from error


class _Header(msgspec.Struct, frozen=True):
    format: int
    part: str
    hand: str
    key: str
    record: tuple[Stage, ...]


def _read(path: Path) -> tuple[_Header, dict[str, Any], dict[str, Any]]:
    """Header and arrays of a file, and those of what was measured, if it has any.

    Nothing is unpickled, and no array is larger than what is there for it.
    """
    if path.exists() and not path.is_file():  # a pipe would wait for somebody to write
        raise ValueError("it is a folder or a device")
    with zipfile.ZipFile(path) as file:
        if (size := sum(entry.file_size for entry in file.infolist())) > LARGEST_FILE:
            raise ValueError(f"{size} bytes are more than {LARGEST_FILE}")
        header, *arrays = (_array(file.read(f"{name}.npy")) for name in ("header", *_ARRAYS))
        simulated = any(name.startswith(_MEASURED) for name in file.namelist())
        names = [item.name for item in fields(Measured)] if simulated else []
        measured = {name: _array(file.read(f"{_MEASURED}{name}.npy")) for name in names}
    return msgspec.convert(json.loads(str(header[()])), _Header), dict(zip(_ARRAYS, arrays, strict=True)), measured


def _array(data: bytes) -> npt.NDArray[Any]:
    """An array in numpy's format, of exactly the numbers that its header claims."""
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, kind = read_header(stream)
    if kind.hasobject or prod(shape) * kind.itemsize != len(data) - stream.tell():
        raise ValueError(f"an array claims shape {shape} and type {kind}, and there are {len(data)} bytes")
    array = np.frombuffer(data, kind, prod(shape), stream.tell()).reshape(shape, order="F" if fortran else "C")
    return array.copy()  # aligned, and its own


def _shapes(n: int, k: int) -> dict[str, tuple[int, ...]]:
    """Shape of every array of a set of n grasps with k contacts each."""
    vectors = dict.fromkeys(("contacts", "normals"), (n, k, 3))
    numbers = ("opening", "approach_opening", "force", "margin", "distance", "parallelness", "quality")
    return {"part_from_hand": (n, 4, 4), **vectors, "facets": (n, k), **dict.fromkeys(numbers, (n,))}


_ARRAYS = tuple(_shapes(0, 0))
_MEASURED = "measured_"  # what the names of its arrays start with in a file
