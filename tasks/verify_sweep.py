"""No two bodies touch all along a motion: proved by clearance where there is some, by fine steps where there is not.

At an instant in the middle of an interval two bodies are found so far apart that, by how far their points travel, they
cannot meet in all of it; if not, the interval is halved. Boxes around the bodies tell most distances well enough, the
triangles all others. Samples lie so closely that no point moves farther between two of them than a fifth of what the
planner may leave unchecked: where bodies are nearer than that, every sample is looked at.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from ..transforms import Array, invert, transform_points
from .document import Plan
from .verify_cell import Cell
from .verify_contacts import TOLERANCE, Contacts
from .verify_faults import Findings
from .verify_holds import Stretch
from .verify_motion import Curve
from .verify_solids import inside

FREE_STEP = 1e-3  # m
STRAIGHT_STEP = 0.2e-3  # m
_FREE = ("transit", "transfer")
_COARSE = 8  # pieces of a segment from which its steps are found
_BLOCK = 4096  # samples that are looked at together
_ASTRAY = 0.5  # rad or m out of the range, from where on a motion is not followed: wild ones take long, and are faults
_SPARE = 1.05  # because the pieces of a piece are not all alike
_CURVING = 2e-5  # m by which two bodies may come nearer to each other between two samples than their chords tell
_WORTH_MEASURING = 0.02  # m; over longer ways a distance proves little, and costs most

Indices = npt.NDArray[np.intp]


@dataclass
class Sweeper:
    """Looks along stretches, one after the other; what was found about bodies at rest is kept.

    Attributes:
        plan: The plan.
        cell: Its cell.
        findings: Where faults go.
        clearance: Smallest distance measured of two bodies that may not touch [m].
        nearest: Their names.
        samples: How many instants were looked at.
    """

    plan: Plan
    cell: Cell
    findings: Findings
    clearance: float = np.inf
    nearest: tuple[str, ...] = ()
    samples: int = 0
    _resting: dict[tuple[int, int, bytes], bool] = field(default_factory=dict)

    def look(self, stretch: Stretch, curve: Curve) -> None:
        """Look for bodies that touch in a stretch; not where joints or hands go astray, far out of their ranges."""
        (lowest, _), (highest, _), *_ = curve.peaks()
        beyond = np.maximum(self.cell.limits[0] - lowest, highest - self.cell.limits[1])
        if not beyond.max(initial=0.0) <= _ASTRAY:  # also where numbers are too large to reckon with
            return
        ends = self.cell.poses(curve.at(np.array([stretch.start, stretch.end])), stretch.poses)
        groups = self.cell.groups(curve.moving(stretch.start, stretch.end), stretch.carriers)
        apart = groups[self.cell.pairs[:, 0]] != groups[self.cell.pairs[:, 1]]
        for times in self._sampled(stretch, curve):
            self.samples += len(times)
            values = curve.at(times)
            poses = self.cell.poses(values, stretch.poses)
            contacts = Contacts(self.plan, self.cell, stretch, values, poses, ends)
            boxes = _Boxes.around(self.cell, poses)
            touching = self._at_rest(self.cell.pairs[~apart], boxes, poses, contacts)
            touching |= self._moving(self.cell.pairs[apart], boxes, poses, contacts)
            for name in ("collision", "contact"):
                found = {pair: k for pair, (kind, k) in touching.items() if kind == name}
                if found:
                    self._report(name, found, contacts, stretch, times)

    def look_inside(self, stretch: Stretch, curve: Curve) -> None:
        """Look for bodies that lie in each other at the very beginning, without their surfaces meeting."""
        poses, pairs = self.cell.poses(curve.at(np.array([stretch.start])), stretch.poses), self.cell.pairs
        near = _Boxes.around(self.cell, poses).gap(pairs, np.zeros(len(pairs), dtype=np.intp)) <= 0.0
        for pair in pairs[near].tolist():
            if self.cell.solids.touch(pair[0], poses[0, pair[0]], pair[1], poses[0, pair[1]]):
                continue
            for i, j in (pair, pair[::-1]):
                corner = self.cell.solids.meshes[i].vertices[:1]
                there = transform_points(invert(poses[0, j]) @ poses[0, i], corner)[0]
                if inside(there, self.cell.solids.meshes[j]):
                    names = self.cell.bodies[i].name, self.cell.bodies[j].name
                    self.findings.add("collision", f"{names[0]} starts in {names[1]}", action=0, time=0.0, bodies=names)

    def _sampled(self, stretch: Stretch, curve: Curve) -> Iterator[Array]:
        """Times (n,) of a stretch, block by block, as close as the steps ask for; blocks share their ends."""
        # Between two samples no joint turns back, or it could go farther than the samples tell.
        knots = np.concatenate([curve.times, curve.turns])
        knots = knots[(knots > stretch.start) & (knots < stretch.end)]
        knots = np.unique(np.concatenate([[stretch.start], knots, [stretch.end]]))
        step = FREE_STEP if self.plan.actions[stretch.action].kind in _FREE else STRAIGHT_STEP
        for some in _blocks(knots, _BLOCK // _COARSE):
            times = _refined(some, np.full(len(some) - 1, _COARSE))
            travelled = _travelled(self.cell, self.cell.poses(curve.at(times), stretch.poses)).max(axis=1)
            counts = np.maximum(np.ceil(_SPARE * travelled / step), 1.0).astype(np.intp)
            yield from _blocks(_refined(times, counts), _BLOCK)

    def _at_rest(
        self, pairs: Indices, boxes: _Boxes, poses: Array, contacts: Contacts
    ) -> dict[tuple[int, int], tuple[str, int]]:
        """Pairs that touch among those that keep their places to each other: looked at once for every such place."""
        found = {}
        start = np.zeros(len(pairs), dtype=np.intp)
        for i, j in pairs[boxes.gap(pairs, start) <= 0.0].tolist():
            place = np.round(invert(poses[0, j]) @ poses[0, i], 9)
            key = i, j, (place + 0.0).tobytes()
            if key not in self._resting:
                self._resting[key] = self.cell.solids.touch(i, poses[0, i], j, poses[0, j])
            if self._resting[key]:
                kind = _judged(contacts, i, j, 0)
                if kind:
                    found[i, j] = kind, 0
        return found

    def _moving(
        self, pairs: Indices, boxes: _Boxes, poses: Array, contacts: Contacts
    ) -> dict[tuple[int, int], tuple[str, int]]:
        """Pairs that touch among those that move against each other, with the earliest sample that was looked at."""
        found: dict[tuple[int, int], tuple[str, int]] = {}
        last = len(poses) - 1
        number, low, high = np.arange(len(pairs)), np.zeros(len(pairs), dtype=np.intp), np.full(len(pairs), last)
        earliest = np.full(len(pairs), last + 1)
        way = boxes.way[:, pairs].sum(axis=2)  # (n, pairs)
        while len(number):
            middle = (low + high) // 2
            before, after = np.maximum(low - 1, 0), np.minimum(high + 1, last)
            reach = np.maximum(way[after, number] - way[middle, number], way[middle, number] - way[before, number])
            unproved = boxes.gap(pairs[number], middle) < reach + _CURVING
            number, low, middle, high, reach = (x[unproved] for x in (number, low, middle, high, reach))
            close = (reach <= _WORTH_MEASURING) | (low == high)
            proved = np.zeros(len(number), dtype=bool)
            for k in np.flatnonzero(close):
                (i, j), at = pairs[number[k]].tolist(), int(middle[k])
                distance = self.cell.solids.distance(i, poses[at, i], j, poses[at, j])
                proved[k] = distance >= reach[k] + _CURVING
                if distance < self.clearance and not (contacts.meet(i, j) or contacts.may_touch(i, j, at)):
                    self.clearance, self.nearest = distance, (self.cell.bodies[i].name, self.cell.bodies[j].name)
                if distance <= 0.0 and at < earliest[number[k]] and (kind := _judged(contacts, i, j, at)):
                    earliest[number[k]], found[i, j] = at, (kind, at)
            number, low, middle, high, close = (x[~proved] for x in (number, low, middle, high, close))
            number = np.concatenate([number, number])
            low, high = np.concatenate([low, middle + 1]), np.concatenate([np.where(close, middle - 1, middle), high])
            left = (low <= high) & (low < earliest[number])
            number, low, high = number[left], low[left], high[left]
        return found

    def _report(
        self, name: str, found: dict[tuple[int, int], int], contacts: Contacts, stretch: Stretch, times: Array
    ) -> None:
        (i, j), at = min(found.items(), key=lambda entry: entry[1])
        bodies = self.cell.bodies[i].name, self.cell.bodies[j].name
        words = f"{bodies[0]} and {bodies[1]} touch, {1e3 * contacts.depth(i, j, at):.2f} mm deep"
        if name == "contact":
            words += f"; {1e3 * TOLERANCE:g} mm is the most"
        if len(found) > 1:
            words += f"; {len(found) - 1} more pairs touch"
        self.findings.add(name, words, action=stretch.action, time=float(times[at]), bodies=bodies)


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes around all bodies at n samples, along the bodies' axes and along the world's.

    Attributes:
        turns: (n, bodies, 3, 3) orientation of the bodies.
        centers: (n, bodies, 3) of the boxes in the world [m].
        halves: (bodies, 3) half sides along the bodies' axes [m].
        low: (n, bodies, 3) lowest corner of the boxes along the world's axes [m].
        high: (n, bodies, 3) highest corner.
        way: (n, bodies) how far any point of a body has travelled at most [m].
    """

    turns: Array
    centers: Array
    halves: Array
    low: Array
    high: Array
    way: Array

    @classmethod
    def around(cls, cell: Cell, poses: Array) -> _Boxes:
        """The boxes at poses (n, bodies, 4, 4)."""
        turns, halves = poses[..., :3, :3], cell.solids.halves
        centers = _centers(cell, poses)
        reach = (np.abs(turns) @ halves[..., None])[..., 0]
        way = np.concatenate([np.zeros((1, len(halves))), np.cumsum(_travelled(cell, poses), axis=0)])
        return cls(turns, centers, halves, centers - reach, centers + reach, way)

    def gap(self, pairs: Indices, samples: Indices) -> Array:
        """A distance (p,) that pairs (p, 2) keep at least at ``samples`` (p,); 0 where the boxes may overlap [m]."""
        i, j = pairs.T
        between = np.maximum(self.low[samples, i] - self.high[samples, j], self.low[samples, j] - self.high[samples, i])
        gap: Array = np.linalg.norm(np.maximum(between, 0.0), axis=1)
        near = np.flatnonzero(gap < _WORTH_MEASURING)
        i, j, at = i[near], j[near], samples[near]
        turn, other = self.turns[at, i], self.turns[at, j]
        relative = np.abs(np.swapaxes(turn, 1, 2) @ other)
        offset = (self.centers[at, j] - self.centers[at, i])[:, None]
        along = np.abs(offset @ turn)[:, 0] - self.halves[i] - (relative @ self.halves[j][..., None])[..., 0]
        across = np.abs(offset @ other)[:, 0] - self.halves[j] - (self.halves[i][:, None] @ relative)[:, 0]
        gap[near] = np.maximum(gap[near], np.maximum(along, across).max(axis=1))
        return gap


def _centers(cell: Cell, poses: Array) -> Array:
    centers: Array = (poses[..., :3, :3] @ cell.solids.centers[..., None])[..., 0] + poses[..., :3, 3]
    return centers


def _travelled(cell: Cell, poses: Array) -> Array:
    """How far any point of each body's box can have moved from one sample to the next (n - 1, bodies) [m]."""
    shift = np.linalg.norm(np.diff(_centers(cell, poses), axis=0), axis=-1)
    turn = np.linalg.norm(np.diff(poses[..., :3, :3], axis=0), axis=(-2, -1)) / np.sqrt(2.0)  # a chord's length
    travelled: Array = shift + turn * np.linalg.norm(cell.solids.halves, axis=1)
    return travelled


def _blocks(times: Array, size: int) -> Iterator[Array]:
    """``times`` in blocks of at most ``size`` intervals."""
    for start in range(0, max(len(times) - 1, 1), size):
        yield times[start : start + size + 1]


def _refined(times: Array, counts: Indices) -> Array:
    """``times`` with each interval cut into as many pieces as ``counts`` says."""
    knots = np.concatenate([[0], np.cumsum(counts)])
    refined: Array = np.interp(np.arange(knots[-1] + 1), knots, times)
    return refined


def _judged(contacts: Contacts, i: int, j: int, sample: int) -> str:
    """What is wrong with two bodies that touch, if something is: a name of a fault."""
    if not contacts.may_touch(i, j, sample):
        return "collision"
    return "" if contacts.nominal(i, j, sample) else "contact"
