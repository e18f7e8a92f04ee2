"""The cache of grasp sets: one ``.npz`` file for each part, hand and parameters, found by their contents."""

from __future__ import annotations

import os
import sys
import tempfile
from dataclasses import astuple, replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..robots.hand import Hand
from .grasps import FORMAT, GraspSet
from .parameters import GraspParameters
from .part import Part

_PLANNER = 2  # raise whenever the same input gives other grasps: older entries are then planned again
_OPENINGS = 5  # openings at which a hand's linkage enters its digest


def cache_folder() -> Path:
    """``KUMITATE_CACHE``, or else the folder that the platform has for caches."""
    if named := os.environ.get("KUMITATE_CACHE"):
        return Path(named)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "kumitate" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "kumitate"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "kumitate"


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

    An entry that is broken or of another format is planned again and replaced. A cache that cannot be written is no
    error.

    Args:
        part: The part.
        hand: The hand.
        parameters: The paper's parameters; its defaults unless given.
        folder: Folder of the cache; ``cache_folder()`` unless given.
    """
    parameters = parameters or GraspParameters()
    key = grasp_key(part, hand, parameters)
    path = Path(folder or cache_folder()) / f"grasps-{key[:32]}.npz"
    try:
        stored = GraspSet.load(path)
        if stored.key == key:
            return replace(stored, part=part.name, hand=hand.name)
    except InputError:
        pass
    from .planner import plan_grasps  # only here: a hit is spared the loading of what planning needs

    grasps = replace(plan_grasps(part, hand, parameters), key=key)
    _write(grasps, path)
    return grasps


def _write(grasps: GraspSet, path: Path) -> None:
    """Write beside the place and rename: whoever reads finds the old entry or the new one, never half of one."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, beside = tempfile.mkstemp(dir=path.parent, suffix=".part")
    except OSError:
        return
    os.close(handle)
    try:
        grasps.save(beside)
        Path(beside).replace(path)
    except OSError:
        Path(beside).unlink(missing_ok=True)
