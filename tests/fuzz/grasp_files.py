"""Grasp sets: ``.npz`` files cut, with arrays of other shapes and kinds, pickles, claims and bombs."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from spoil import Rng, nudged, one, spoiled_bytes, spoiled_tree

from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.measured import Measured
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand

COUNT = 5000
_PART = Part.from_mesh(trimesh.creation.box([0.03, 0.02, 0.05]), mass=0.05, name="box")
_GRASPS = plan_grasps(_PART, load_hand("robotiq_2f85"), GraspParameters(t_rnn=8e-3, n_da=2))
_TRIED = np.arange(len(_GRASPS)) % 3 > 0
_MEASURED = Measured(_TRIED, *(_TRIED * np.array([[2e-3], [0.1], [1e-3]])), np.arange(len(_GRASPS)) % 3 > 1)
_FILE = Path("grasps.npz")


def make(rng: Rng, folder: Path) -> None:
    """Write a grasp set, and spoil it."""
    path = folder / _FILE
    replace(_GRASPS, measured=_MEASURED if rng.random() < 0.5 else None).save(path)
    way = _bomb if rng.random() < 0.002 else one(rng, _WAYS)
    path.write_bytes(way(rng, path.read_bytes()))


def feed(folder: Path) -> str:
    """Load the set and save it again."""
    grasps = GraspSet.load(folder / _FILE)
    if grasps.measured is not None:
        grasps = grasps.held()
    grasps.thin(5).save(folder / "again.npz")
    return "works"


def _entries(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _packed(entries: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", method) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return whole.getvalue()


def _npy(array: Any) -> bytes:
    written = io.BytesIO()
    np.save(written, array, allow_pickle=True)
    return written.getvalue()


def _claimed(shape: str, kind: str = "<f8", data: bytes = b"") -> bytes:
    """An ``.npy`` file whose header claims a shape and kind."""
    head = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + data


def _bytes(rng: Rng, content: bytes) -> bytes:
    return spoiled_bytes(rng, content)


def _entry_bytes(rng: Rng, content: bytes) -> bytes:
    entries = _entries(content)
    name = one(rng, list(entries))
    return _packed({**entries, name: spoiled_bytes(rng, entries[name])}, one(rng, (0, 8, 12, 14)))


def _names(rng: Rng, content: bytes) -> bytes:
    entries = _entries(content)
    name = one(rng, list(entries))
    data = entries.pop(name)
    return _packed(
        entries | {one(rng, ("x.npy", "../x.npy", "header", *entries)): data} if rng.random() < 0.7 else entries
    )


def _array(rng: Rng, content: bytes) -> bytes:
    """An array of another shape or kind, or with other numbers."""
    entries = _entries(content)
    name = one(rng, [name for name in entries if name != "header.npy"])
    array = np.load(io.BytesIO(entries[name]))
    changed: tuple[Callable[[], Any], ...] = (
        lambda: array[:-1],
        lambda: array[None],
        array.ravel,
        lambda: array[..., None],
        lambda: array.T,
        lambda: array[:0],
        lambda: np.full(array.shape, one(rng, (np.nan, np.inf, -1.0, 1e300))),
        lambda: array.astype(one(rng, ("f4", "i8", "c16", "O", "U8", "M8[s]", "?", "V8", ">f8", "f2", "g"))),
        lambda: np.array(nudged(rng, 1.0)),
        lambda: np.vectorize(lambda x: nudged(rng, float(x)))(array),
        lambda: rng.permutation(array),
        lambda: np.array([{"a": 1}, None], dtype=object),
        lambda: np.zeros(len(array), dtype=[("a", "f8"), ("b", "i4")]),
        lambda: np.asfortranarray(array),
    )
    with np.errstate(all="ignore"):
        entries[name] = _npy(one(rng, changed)())
    return _packed(entries)


def _header(rng: Rng, content: bytes) -> bytes:
    entries = _entries(content)
    header = json.loads(str(np.load(io.BytesIO(entries["header.npy"]))[()]))
    text = json.dumps(spoiled_tree(rng, header))
    if rng.random() < 0.2:
        text = spoiled_bytes(rng, text.encode()).decode(errors="replace").replace("\0", "")
    return _packed({**entries, "header.npy": _npy(np.array(text))})


def _claims(rng: Rng, content: bytes) -> bytes:
    entries = _entries(content)
    name = one(rng, list(entries))
    shape = one(
        rng, ("(10**9,)", "(1000000000,)", "(4, 1000000000000)", "(-1,)", "()", "(2, 3", "(1000000,)", "(0, 10)")
    )
    kind = one(rng, ("<f8", "|O", "|V1000000", "<U100000000", "<f8,<f8", "bad", "|S0"))
    return _packed({**entries, name: _claimed(shape, kind, bytes(800))})


def _bomb(rng: Rng, content: bytes) -> bytes:
    """Entries that are very much larger than the file."""
    entries = _entries(content)
    name = one(rng, list(entries))
    size = int(one(rng, (10**6, 10**8, 3 * 10**9)))
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for other in entries.keys() - {name}:
            archive.writestr(other, entries[other])
        with archive.open(name, "w", force_zip64=True) as entry:
            entry.write(_claimed(f"({size // 8},)", "<f8" if name != "header.npy" else "<U1"))
            for _ in range(0, size, 10**7):
                entry.write(bytes(min(size, 10**7)))
    return whole.getvalue()


def _something_else(rng: Rng, content: bytes) -> bytes:
    return one(
        rng, (b"", b"PK\x03\x04", _npy(np.zeros(3)), b"\x80\x04N.", b"{}", _npy(np.array([None])), b"PK\x05\x06")
    )


_WAYS = (*(2 * (_bytes, _entry_bytes, _names)), *(6 * (_array, _header)), *(2 * (_claims, _something_else)))
