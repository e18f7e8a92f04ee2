"""Which grasps of two parts go together while one is pushed onto the other: questions that depend on no pose."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ..regrasp.clearance import HandPoses, Mask
from ..regrasp.reach import APPROACH, Holder, Rows
from ..robots.scene import Scene
from ..transforms import Array, compose, invert
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

    @property
    def distances(self) -> Array:
        """How far (n,) from its end the way is looked at, the end first [m]."""
        length = float(np.linalg.norm(self.way))
        return np.linspace(0.0, length, int(np.ceil(length / _ALONG)) + 1)

    def looks(self) -> Array:
        """Poses (n, 4, 4) of the part along the way, the last one first."""
        back = -self.distances[:, None] * self.way / np.linalg.norm(self.way)
        return compose(np.broadcast_to(np.eye(3), (len(back), 3, 3)), back) @ self.at


class Fit:
    """Which grasps of the two parts of an insertion go together; each is looked at once, when asked for.

    Attributes:
        insertion: How the moved part comes to the other.
        part: Name of the moved part.
        to: Name of the other.
        arm: The arm that moves the part.
        to_arm: The arm that holds the other.
        mover: Grasps of the moved part.
        holder: Grasps of the other.

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
        self.part, self.to = moved.part.name, still.part.name
        self.mover, self.holder = moved.holders[arm], still.holders[to_arm]
        self._moved, self._still = (
            [(scene.bodies[name], at) for name, at in whole.bodies()] for whole in (moved, still)
        )
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
        still = _covers(self.holder, holding, np.eye(4), closed=True, back=0.0)
        for frame, closed, back in self._passes():
            (left,) = np.nonzero(clear)
            clear[left] = ~still.hit(_covers(self.mover, moving, frame, closed=closed, back=back), pairs[left])
        return clear.reshape(len(holding), len(moving))

    def _holder_hits(self, grasps: Rows) -> Mask:
        hits = np.zeros(len(grasps), dtype=bool)
        for look, (body, at) in itertools.product(self.insertion.looks(), self._moved):
            hits[~hits] = self.holder.hands(closed=True).hit(grasps[~hits], body, look @ at)
        return hits

    def _mover_hits(self, grasps: Rows) -> Mask:
        hits = np.zeros(len(grasps), dtype=bool)
        for (frame, closed, back), (body, at) in itertools.product(self._passes(), self._still):
            hits[~hits] = self.mover.hands(closed=closed, back=back).hit(grasps[~hits], body, invert(frame) @ at)
        return hits

    def _passes(self) -> list[tuple[Array, bool, float]]:
        """The moving hand at the end, leaving, and along the way: pose of the part, whether closed, way back [m]."""
        looks = self.insertion.looks()
        return [*((looks[0], False, float(back)) for back in _LEAVING), *((look, True, 0.0) for look in looks)]


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


def _covers(holder: Holder, grasps: Rows, frame: Array, *, closed: bool, back: float) -> HandPoses:
    """The hands of ``grasps`` (k,) with the part at ``frame`` (4, 4), ``back`` [m] along their approach."""
    assert holder.arm.hand is not None
    base = frame @ holder.part_from_flange[grasps] @ holder.arm.flange_from_base
    base[:, :3, 3] -= back * (frame @ holder.grasps.part_from_hand[grasps])[:, :3, 2]
    openings = holder.grasps.opening if closed else holder.grasps.approach_opening
    return HandPoses.of(holder.arm.hand, base, openings[grasps])
