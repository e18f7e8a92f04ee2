"""The cache of grasp sets: one ``.npz`` file for each part, hand and parameters, found by their contents."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
from dataclasses import astuple, fields, replace
from hashlib import sha256
from pathlib import Path
from time import time

import numpy as np

from ..errors import InputError
from ..robots.hand import Hand
from .grasps import FORMAT, GraspSet
from .parameters import GraspParameters
from .part import Part

_PLANNER = 6  # raise whenever the same input gives other grasps: older entries are then planned again
_OPENINGS = 5  # openings at which a hand's linkage enters its digest
_DAY = 86_400.0  # s


def cache_folder() -> Path:
    """``KUMITATE_CACHE``, or else the folder that the platform has for caches."""
    if named := os.environ.get("KUMITATE_CACHE"):
        return Path(named)
    try:
        home = Path.home()
    except RuntimeError:  # a user whom the system does not know, as in many a container
        home = Path(tempfile.gettempdir())
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local")) / "kumitate" / "cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "kumitate"
    return Path(os.environ.get("XDG_CACHE_HOME", home / ".cache")) / "kumitate"


def grasp_key(part: Part, hand: Hand, parameters: GraspParameters) -> str:
    """SHA-256 over everything that decides the grasps: mesh, mass and its centre, the hand, the parameters."""
    content = sha256(f"{FORMAT} {_PLANNER} {part.digest} {hand_digest(hand)}".encode())
    content.update(np.array([part.mass, *part.center_of_mass, *astuple(parameters)], dtype="<f8").tobytes())
    return content.hexdigest()


def hand_digest(hand: Hand) -> str:
    """SHA-256 of what grasp planning reads of a hand: shapes, linkage, pads, forces."""
    openings = np.linspace(*hand.stroke, _OPENINGS)
    lip = (hand.lip.radius, hand.lip.compliance, hand.lip.force) if hand.lip else ()
    numbers = [hand.stroke, hand.contact_depth, hand.grip_force, hand.friction, lip, [pad.size for pad in hand.pads]]
    numbers += [piece.mesh.triangles for piece in hand.pieces]
    numbers += [hand.base_from_piece(openings), hand.base_from_hand(openings)]
    if hand.pads:
        numbers.append(hand.hand_from_pad(openings))
    content = sha256(hand.kind.encode())
    for array in numbers:
        content.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return content.hexdigest()


def cached_grasps(
    part: Part, hand: Hand, parameters: GraspParameters | None = None, folder: str | Path | None = None
) -> GraspSet:
    """The grasps that ``plan_grasps`` gives, from the cache if they are there; planned and put there if not.

    An entry that is broken, of another format, or not as it was written is planned again and replaced. A cache that
    cannot be written is no error.

    Args:
        part: The part.
        hand: The hand.
        parameters: The paper's parameters; its defaults unless given.
        folder: Folder of the cache; ``cache_folder()`` unless given.
    """
    parameters = parameters or GraspParameters()
    key = grasp_key(part, hand, parameters)
    path = Path(folder or cache_folder()) / f"grasps-{key[:32]}.npz"
    if (stored := _read(path, key)) is not None:
        return replace(stored, part=part.name, hand=hand.name)
    from .planner import plan_grasps  # only here: a hit is spared the loading of what planning needs

    grasps = replace(plan_grasps(part, hand, parameters), key=key)
    _write(replace(grasps, key=_seal(grasps, key)), path)
    return grasps


def _seal(grasps: GraspSet, key: str) -> str:
    """SHA-256 over a key and the arrays that were planned for it: entries have it in place of the key."""
    content = sha256(key.encode())
    for array in (getattr(grasps, item.name) for item in fields(grasps)):
        if isinstance(array, np.ndarray):
            content.update(f"{array.dtype.str} {array.shape}".encode() + array.tobytes())
    return content.hexdigest()


def _read(path: Path, key: str) -> GraspSet | None:
    """The entry for ``key``, if there is one and it is as it was written."""
    try:
        stored = GraspSet.load(path) if path.is_file() else None  # a pipe would wait for somebody to write
    except (InputError, OSError):
        return None
    if stored is None or stored.measured is not None or stored.key != _seal(stored, key):
        return None
    return replace(stored, key=key)


def _write(grasps: GraspSet, path: Path) -> None:
    """Write beside the place and rename: whoever reads finds the old entry or the new one, never half of one."""
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path.parent)
        handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".part")
        os.close(handle)
        try:
            grasps.save(beside)
            Path(beside).replace(path)
        finally:
            Path(beside).unlink(missing_ok=True)


def _sweep(folder: Path) -> None:
    """Remove what processes that were killed left half-written."""
    for left in folder.glob("*.part"):
        with contextlib.suppress(OSError):
            if left.stat().st_mtime < time() - _DAY:
                left.unlink()
