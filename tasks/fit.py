"""Which grasps of two parts go together while one is pushed onto the other: questions that depend on no pose."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..regrasp.clearance import HandPoses, Mask, hands_hit
from ..regrasp.reach import APPROACH, Holder, Rows
from ..robots.rigid import Rigid
from ..robots.scene import Scene
from ..transforms import Array, compose
from .job import Whole

_ALONG = 0.01  # m between two looks along an insertion
_LEAVING = np.linspace(0.0, APPROACH, 4)  # m back from the grasp at which a leaving hand is looked at


@dataclass(frozen=True, eq=False)
class Insertion:
    """How one part comes to another, in the frame of the other.

    Attributes:
        at: Pose (4, 4) of the part at the end.
        way: The straight way (3,) there [m].
    """

    at: Array
    way: Array

    def before(self) -> Array:
        """Pose (4, 4) of the part before the straight way."""
        return compose(np.eye(3), -self.way) @ self.at

    def looks(self) -> Array:
        """Poses (n, 4, 4) of the part along the way, the last one first."""
        count = int(np.ceil(np.linalg.norm(self.way) / _ALONG)) + 1
        back = -np.linspace(0.0, 1.0, count)[:, None] * self.way
        return compose(np.broadcast_to(np.eye(3), (count, 3, 3)), back) @ self.at


class Fit:
    """Which grasps of the two parts of an insertion go together; each is looked at once, when asked for.

    Args:
        scene: The scene with the bodies of all parts.
        insertion: How the moved part comes to the other.
        moved: The moved part.
        still: The part that it is joined to.
        arm: The arm that moves the part.
        to_arm: The arm that holds the other.
    """

    def __init__(self, scene: Scene, insertion: Insertion, moved: Whole, still: Whole, arm: str, to_arm: str) -> None:
        self.insertion, self.arm, self.to_arm = insertion, arm, to_arm
        self.mover, self.holder = moved.holders[arm], still.holders[to_arm]
        self._moved, self._still = _bodies(scene, moved), _bodies(scene, still)
        self._holding = _Looked(len(self.holder.grasps))
        self._moving = _Looked(len(self.mover.grasps))

    def holding(self, wanted: Mask) -> Mask:
        """Which of the ``wanted`` grasps (n,) of the other part leave the whole way free."""
        return self._holding.clear(wanted, self._holder_hits)

    def moving(self, wanted: Mask) -> Mask:
        """Which of the ``wanted`` grasps (n,) of the moved part stay clear of the other, coming and leaving."""
        return self._moving.clear(wanted, self._mover_hits)

    def pairs(self, holding: Rows, moving: Rows) -> Mask:
        """Which grasps ``holding`` (h,) and ``moving`` (m,) have hands that stay clear of each other (h, m)."""
        pairs = np.stack(np.meshgrid(np.arange(len(holding)), np.arange(len(moving)), indexing="ij"), axis=-1)
        pairs = pairs.reshape(-1, 2)
        clear = np.ones(len(pairs), dtype=bool)
        still = _hands(self.holder, holding, self.holder.grasps.opening, np.eye(4), 0.0)
        for frame, openings, back in self._passes():
            (left,) = np.nonzero(clear)
            clear[left] = ~still.hit(_hands(self.mover, moving, openings, frame, back), pairs[left])
        return clear.reshape(len(holding), len(moving))

    def _passes(self) -> list[tuple[Array, Array, float]]:
        """The moving hand at the end, leaving, and along the way: pose of the part, openings (n,), way back [m]."""
        looks, grasps = self.insertion.looks(), self.mover.grasps
        leaving = [(looks[0], grasps.approach_opening, float(back)) for back in _LEAVING]
        return [*leaving, *((look, grasps.opening, 0.0) for look in looks)]

    def _holder_hits(self, grasps: Rows) -> Mask:
        hits = np.zeros(len(grasps), dtype=bool)
        for look, (body, at) in itertools.product(self.insertion.looks(), self._moved):
            left = grasps[~hits]
            hits[~hits] = _hit(self.holder, left, self.holder.grasps.opening, np.eye(4), 0.0, body, look @ at)
        return hits

    def _mover_hits(self, grasps: Rows) -> Mask:
        hits = np.zeros(len(grasps), dtype=bool)
        for (frame, openings, back), (body, at) in itertools.product(self._passes(), self._still):
            hits[~hits] = _hit(self.mover, grasps[~hits], openings, frame, back, body, at)
        return hits


class _Looked:
    """What is known of n grasps."""

    def __init__(self, n: int) -> None:
        self._known, self._clear = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)

    def clear(self, wanted: Mask, hits: object) -> Mask:
        """Which of the ``wanted`` (n,) are clear, asking ``hits`` for those that were never asked for."""
        (new,) = np.nonzero(wanted & ~self._known)
        if len(new):
            self._clear[new] = ~hits(new)  # type: ignore[operator]
            self._known[new] = True
        return self._clear & wanted


def _bodies(scene: Scene, whole: Whole) -> list[tuple[Rigid, Array]]:
    """The bodies of a whole, each with its pose (4, 4) in the whole's frame."""
    others = [(scene.bodies[name], pose) for name, pose in zip(whole.others, whole.poses, strict=True)]
    return [(scene.bodies[whole.part.name], np.eye(4)), *others]


def _bases(holder: Holder, grasps: Rows, frame: Array, back: float) -> Array:
    """Bases (k, 4, 4) of the hands of ``grasps`` with the part at ``frame`` (4, 4), ``back`` [m] along the approach."""
    base: Array = frame @ holder.part_from_flange[grasps] @ holder.arm.flange_from_base
    base[:, :3, 3] -= back * (frame @ holder.grasps.part_from_hand[grasps])[:, :3, 2]
    return base


def _hit(holder: Holder, grasps: Rows, openings: Array, frame: Array, back: float, body: Rigid, pose: Array) -> Mask:
    assert holder.arm.hand is not None
    return hands_hit(holder.arm.hand, _bases(holder, grasps, frame, back), openings[grasps], body, pose)


def _hands(holder: Holder, grasps: Rows, openings: Array, frame: Array, back: float) -> HandPoses:
    assert holder.arm.hand is not None
    return HandPoses.of(holder.arm.hand, _bases(holder, grasps, frame, back), openings[grasps])
