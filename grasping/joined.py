"""Assemblies: parts joined into one, and which grasps of one of them hold the whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from ..robots.hand import Hand
from ..transforms import Array, transform_points
from .grasps import GraspSet
from .part import Part
from .softfinger import GRAVITY

_TINY = 1e-12  # N or N2: keeps quotients finite that nothing uses
_SHORTEST_LEVER = 1e-4  # m; a shorter one tells nothing of how much torque the contacts resist


def join_parts(parts: Sequence[Part], poses: Sequence[Array]) -> Part:
    """One part of several, in the frame of the first, which gives its name.

    Args:
        parts: The parts.
        poses: Pose (4, 4) of each in the frame of the first.
    """
    if len(parts) == 1:
        return parts[0]
    meshes = [part.mesh.copy().apply_transform(pose) for part, pose in zip(parts, poses, strict=True)]
    masses = np.array([part.mass for part in parts])
    centers = np.array([transform_points(p, q.center_of_mass[None])[0] for p, q in zip(poses, parts, strict=True)])
    return Part(
        name=parts[0].name,
        mesh=trimesh.util.concatenate(meshes),
        mass=float(masses.sum()),
        center_of_mass=masses @ centers / masses.sum(),
        watertight=all(part.watertight for part in parts),
    )


def hold_whole(grasps: GraspSet, part: Part, whole: Part, hand: Hand) -> GraspSet:
    """The grasps of ``part`` that also hold ``whole``, of which it is a part in the same frame (eq. 4).

    The torque that the contacts resist follows from the margin on the part alone; where that has no lever, the least
    of all grasps counts. A cup presses with what the vacuum leaves of its force, and must not peel off either.
    """
    if whole is part or not len(grasps):
        return grasps
    force = grasps.force if hand.lip is None else np.full(len(grasps), hand.lip.force - whole.mass * GRAVITY)
    middle = grasps.contacts.mean(axis=1)
    before, after = (np.linalg.norm(middle - one.center_of_mass, axis=1) for one in (part, whole))
    spare = [
        np.maximum((hand.friction * pressed) ** 2 - (one.mass * GRAVITY) ** 2, 0.0) * (pressed > 0.0)
        for pressed, one in ((grasps.force, part), (force, whole))
    ]
    told = before > _SHORTEST_LEVER
    share = (1.0 - grasps.margin) / np.where(told, before, 1.0)  # of the torque, for each metre of lever
    share = np.where(told, share, share[told].max(initial=0.0) if told.any() else np.inf)
    loss = np.sqrt(spare[0] / np.maximum(spare[1], _TINY))
    if hand.lip is not None:  # the margin of a cup is that against turning or peeling, whichever is less
        loss = np.maximum(loss, grasps.force / np.maximum(force, _TINY))
    margin = np.where(spare[1] > 0.0, 1.0 - share * after * loss * whole.mass / part.mass, -np.inf)
    kept = margin >= 0.0
    worth = np.divide(margin, grasps.margin, out=np.zeros_like(margin), where=grasps.margin > 0.0)
    quality = grasps.quality * np.clip(worth, 0.0, 1.0)
    return replace(grasps[kept], margin=margin[kept], quality=quality[kept], force=force[kept])
