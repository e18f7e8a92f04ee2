"""Contacts that a plan's own events allow: nominal, never exempt.

Two bodies in such a contact may touch, but must be apart once they have been moved apart by the contact tolerance.
"""

from __future__ import annotations

import itertools

import numpy as np

from ..transforms import Array, invert, pose
from .document import Action, Plan
from .task import Use
from .verify_cell import Body, Cell
from .verify_holds import Stretch
from .verify_ways import unit

TOLERANCE = 0.5e-3  # m
NEXT_TO = 1e-3  # m that a body may have moved from where it rests, or where the hand closes, and still touch

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
        ends: Poses (2, bodies, 4, 4) at the stretch's beginning and end.
    """

    def __init__(self, plan: Plan, cell: Cell, stretch: Stretch, values: Array, poses: Array, ends: Array) -> None:
        self._plan, self._cell, self._stretch = plan, cell, stretch
        self._values, self._poses, self._ends = values, poses, ends
        self._action = plan.actions[stretch.action]
        self._use = _used(self._action, cell)
        self._tool = stretch.assembly(self._use.part) if self._use else frozenset[str]()
        self._hands: dict[str, Array] = {}

    def may_touch(self, i: int, j: int, sample: int) -> bool:
        """Whether bodies i and j may touch at a sample."""
        return self._allowed(i, j, self._poses[sample])

    def meet(self, i: int, j: int) -> bool:
        """Whether bodies i and j may touch at the beginning or the end of the stretch."""
        return any(self._allowed(i, j, poses) for poses in self._ends)

    def nominal(self, i: int, j: int, sample: int) -> bool:
        """Whether bodies i and j, which may touch, are apart after one of their ways apart."""
        return any(not self._touch(i, j, sample, way) for way in self._ways(i, j, sample))

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

    def _allowed(self, i: int, j: int, poses: Array) -> bool:
        """Whether bodies i and j may touch when all bodies are at ``poses`` (bodies, 4, 4)."""
        one, other = self._cell.bodies[i], self._cell.bodies[j]
        kinds = one.kind, other.kind
        if kinds == ("hand", "part"):
            finger = one.name.partition("/")[2] in self._cell.machine.grippers[one.arm].fingers
            return finger and self._grips(one, other, i, j, poses)
        if {one.name, other.name} & self._tool and not {one.name, other.name} <= self._tool:
            return self._worked_on(one, other)
        if kinds == ("part", "obstacle"):
            return other.support and self._rests(i, poses)
        if kinds == ("part", "part"):
            carried = one.name in self._stretch.carriers and other.name in self._stretch.carriers
            rests = not carried and (self._rests(i, poses) or self._rests(j, poses))
            return rests or self._mated(one.name, other.name)
        return False

    def _ways(self, i: int, j: int, sample: int) -> Array:
        """Ways (k, 3) in the world [m], any of which may be enough for body i to leave body j.

        Along several normals at once, as in a corner, a way goes by the tolerance along each.
        """
        one, other = self._cell.bodies[i], self._cell.bodies[j]
        if one.kind == "hand":
            gripper = self._cell.machine.grippers[one.arm]
            if one.arm not in self._hands:
                self._hands[one.arm] = self._cell.hand(one.arm, self._values)
            x, _, z = self._hands[one.arm][sample, :3, :3].T
            opens = x if gripper.fingers.index(one.name.partition("/")[2]) else -x
            return TOLERANCE * np.array([opens if gripper.lip is None else -z])
        if self._worked_on(one, other):
            back = self._back(sample)
            return TOLERANCE * np.array([back if one.name in self._tool else -back])
        if other.kind == "obstacle":
            return TOLERANCE * _UPWARD
        return TOLERANCE * (_APART if self._mated(one.name, other.name) else np.concatenate([_UPWARD, -_UPWARD]))

    def _worked_on(self, one: Body, other: Body) -> bool:
        """Whether one of two bodies is of the tool that this action uses, and the other what that works on."""
        return self._use is not None and {one.name, other.name} - self._tool == {self._use.of}

    def _back(self, sample: int) -> Array:
        """The direction (3,) in the world in which the tool goes back."""
        assert self._use is not None
        assert self._use.of is not None
        direction = self._poses[sample, self._cell.number[self._use.of], :3, :3] @ unit(self._use.approach.direction)
        return np.asarray(-direction)

    def _grips(self, piece: Body, part: Body, i: int, j: int, poses: Array) -> bool:
        """Whether the hand holds the part, takes it or lets it go in this action, or stands where it is about to."""
        arm = piece.arm
        if arm in [hold.carrier for hold in self._stretch.holds[part.name]] or _handles(self._action, arm, part.name):
            return True
        number, actions = self._stretch.action, self._plan.actions
        return any(
            0 <= other < len(actions)
            and _handles(actions[other], arm, part.name)
            and self._moved(i, invert(poses[j]) @ poses[i], invert(end[j]) @ end[i]) <= NEXT_TO
            for other, end in ((number - 1, self._ends[0]), (number + 1, self._ends[1]))
        )

    def _rests(self, i: int, poses: Array) -> bool:
        """Whether a part is where it rests: at an end of the stretch, or next to it."""
        return any(self._moved(i, poses[i], end[i]) <= NEXT_TO for end in self._ends)

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


def _used(action: Action, cell: Cell) -> Use | None:
    """How a tool is used, in an action that brings it to where it works, or back."""
    if action.kind not in ("press", "withdraw") or action.goal is None:
        return None
    return cell.task.goals[action.goal].use


def _handles(action: Action, arm: str, part: str) -> bool:
    return any(event.part == part and event.carrier == arm for event in action.events)
