"""Contacts that a plan's own events allow: nominal, never exempt.

Two bodies in such a contact may touch, but must be apart once they have been moved apart by the contact tolerance.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..transforms import Array, invert, pose
from .document import Action, Plan
from .verify_cell import Body, Cell
from .verify_holds import Stretch

TOLERANCE = 0.5e-3  # m
NEXT_TO = 1e-3  # m that a body may have moved from where it rests, or where the hand closes, and still touch

_UP = np.array([0.0, 0.0, 1.0])
_WAYS = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
_APART = _WAYS[np.argsort(np.abs(_WAYS).sum(axis=1), kind="stable")][1:]  # faces first, then edges and corners
_UPWARD = _APART[_APART[:, 2] > 0.0]
_FARTHEST = 0.05  # m to which the depth of a collision is measured
_HALVINGS = 10


class Contacts:
    """What may touch in one stretch.

    Args:
        plan: The plan.
        cell: Its cell.
        stretch: The stretch.
        values: Rows (n, columns) of its curve.
        poses: Poses (n, bodies, 4, 4) of all bodies there.
    """

    def __init__(self, plan: Plan, cell: Cell, stretch: Stretch, values: Array, poses: Array) -> None:
        self._plan, self._cell, self._stretch, self._values, self._poses = plan, cell, stretch, values, poses
        self._action = plan.actions[stretch.action]
        self._hands: dict[str, Array] = {}

    def ways(self, i: int, j: int, sample: int) -> Array:
        """Ways (k, 3) for body i to leave body j by the tolerance [m], any of which will do; none: they may not touch.

        Ways are in the world. Along several normals at once, as in a corner, a way goes by the tolerance along each.
        """
        one, other = self._cell.bodies[i], self._cell.bodies[j]
        kinds = one.kind, other.kind
        if kinds == ("hand", "part"):
            return self._backwards(one, other, i, j, sample)
        if kinds == ("part", "obstacle"):
            rests = other.support and self._rests(i, sample)
            return TOLERANCE * _UPWARD if rests else _UPWARD[:0]
        if kinds == ("part", "part"):
            if self._mated(one.name, other.name):
                return TOLERANCE * _APART
            rests = self._rests(i, sample) or self._rests(j, sample)
            held = one.name in self._stretch.carriers and other.name in self._stretch.carriers
            return TOLERANCE * np.concatenate([_UPWARD, -_UPWARD]) if rests and not held else _UPWARD[:0]
        return _UPWARD[:0]

    def may_touch(self, i: int, j: int, sample: int) -> bool:
        """Whether bodies i and j may touch at all."""
        return len(self.ways(i, j, sample)) > 0

    def nominal(self, i: int, j: int, sample: int) -> bool:
        """Whether bodies i and j are apart after one of their ways apart."""
        return any(not self._touch(i, j, sample, way) for way in self.ways(i, j, sample))

    def depth(self, i: int, j: int, sample: int) -> float:
        """How far body i has to move, the shortest of 26 ways, to be clear of body j; at most 50 mm [m]."""
        shortest = _FARTHEST
        for way in _APART / np.linalg.norm(_APART, axis=1, keepdims=True):
            if self._touch(i, j, sample, shortest * way):
                continue
            low, high = 0.0, shortest
            for _ in range(_HALVINGS):
                middle = (low + high) / 2.0
                low, high = (middle, high) if self._touch(i, j, sample, middle * way) else (low, middle)
            shortest = high
        return shortest

    def _touch(self, i: int, j: int, sample: int, way: Array) -> bool:
        moved = pose(way) @ self._poses[sample, i]
        return self._cell.solids.touch(i, moved, j, self._poses[sample, j])

    def _backwards(self, piece: Body, part: Body, i: int, j: int, sample: int) -> Array:
        """The way of a finger that opens, or of a cup that backs off."""
        fingers, name = self._cell.machine.grippers[piece.arm].fingers, piece.name.partition("/")[2]
        if name not in fingers or not self._grips(piece, part, i, j, sample):
            return _UPWARD[:0]
        if piece.arm not in self._hands:
            self._hands[piece.arm] = self._cell.hand(piece.arm, self._values)
        x, _, z = self._hands[piece.arm][sample, :3, :3].T
        way: Array = -z if self._cell.machine.grippers[piece.arm].lip is not None else x if fingers.index(name) else -x
        return TOLERANCE * way[None]

    def _grips(self, piece: Body, part: Body, i: int, j: int, sample: int) -> bool:
        """Whether the hand holds the part, takes it or lets it go in this action, or stands where it is about to."""
        arm = piece.arm
        if arm in [hold.carrier for hold in self._stretch.holds[part.name]] or _handles(self._action, arm, part.name):
            return True
        number, actions = self._stretch.action, self._plan.actions
        return any(
            0 <= other < len(actions) and _handles(actions[other], arm, part.name) and self._near(i, j, sample, end)
            for other, end in ((number - 1, 0), (number + 1, -1))
        )

    def _rests(self, i: int, sample: int) -> bool:
        """Whether a part is where it rests: at an end of the stretch, or next to it."""
        poses = self._poses[[sample, 0, -1], i]
        return min(self._moved(i, poses[0], poses[1]), self._moved(i, poses[0], poses[2])) <= NEXT_TO

    def _near(self, i: int, j: int, sample: int, end: int) -> bool:
        """Whether body i stands in body j's frame where it does at an end of the stretch, or next to it."""
        now, then = (invert(self._poses[k, j]) @ self._poses[k, i] for k in (sample, end))
        return self._moved(i, now, then) <= NEXT_TO

    def _moved(self, i: int, now: Array, then: Array) -> float:
        """How far any point of body i can have moved between two poses."""
        center, half = self._cell.solids.centers[i], self._cell.solids.halves[i]
        shift = (now[:3, :3] - then[:3, :3]) @ center + now[:3, 3] - then[:3, 3]
        turn = np.linalg.norm(now[:3, :3] - then[:3, :3]) / np.sqrt(2.0)
        return float(np.linalg.norm(shift) + turn * np.linalg.norm(half))

    def _mated(self, one: str, other: str) -> bool:
        """Whether two parts are of one assembly, or become so in this action."""
        joined = [
            self._stretch.assembly(event.part) | self._stretch.assembly(event.carrier)
            for event in self._action.events
            if event.kind == "attach" and event.carrier in self._stretch.holds
        ]
        return other in self._stretch.assembly(one) or any({one, other} <= both for both in joined)


def _handles(action: Action, arm: str, part: str) -> bool:
    return any(event.part == part and event.carrier == arm for event in action.events)
