"""Motions as the verifier reads them: cubic Hermite curves, their exact peaks, and the rules that they keep."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..transforms import Array, pose
from .document import Action, Plan, State
from .verify_cell import Cell
from .verify_faults import Findings

SAME = 1e-6  # m, rad
_STILL = 1e-9  # m, rad, and m/s, rad/s
_INSTANT = 1e-9  # s
_ROUNDING = 1.0 + 1e-6


@dataclass(frozen=True, eq=False)
class Curve:
    """Joints (in the machine's order), then openings (in the order of the cell's hands), over time.

    Attributes:
        times: (k,) of the samples [s].
        values: (k, n) there.
        rates: (k, n) there, by the second.
    """

    times: Array
    values: Array
    rates: Array

    @classmethod
    def of(cls, action: Action, cell: Cell) -> Curve:
        """The motion of an action."""
        motion = action.motion
        joints = [np.array(rows, dtype=float)[:, cell.order] for rows in (motion.positions, motion.velocities)]
        hands = [
            np.array([table[arm] for arm in cell.hands], dtype=float).reshape(len(cell.hands), -1).T
            for table in (motion.openings, motion.opening_velocities)
        ]
        hands = [rows if cell.hands else np.zeros((len(motion.times), 0)) for rows in hands]
        return cls(np.array(motion.times), *(np.hstack(both) for both in zip(joints, hands, strict=True)))

    def at(self, times: Array) -> Array:
        """Values (m, n) at ``times`` (m,)."""
        if len(self.times) == 1:
            return np.repeat(self.values, len(times), axis=0)
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        span = np.diff(self.times)[i][:, None]
        s = (times[:, None] - self.times[i][:, None]) / span
        way = self.values[i + 1] - self.values[i]
        start, end = self.rates[i] * span - way, way - self.rates[i + 1] * span
        values: Array = self.values[i] + s * (way + (1.0 - s) * (start * (1.0 - s) + end * s))
        return values

    def moving(self, start: float, end: float) -> npt.NDArray[np.bool_]:
        """Which columns (n,) change in the segments that reach between two times."""
        if start >= end:
            return np.zeros(self.values.shape[1], dtype=bool)
        first = int(np.searchsorted(self.times, start, side="right")) - 1
        part = slice(max(first, 0), int(np.searchsorted(self.times, end, side="left")) + 1)
        moving: npt.NDArray[np.bool_] = np.ptp(self.values[part], axis=0) > _STILL
        moving |= np.abs(self.rates[part]).max(axis=0) > _STILL
        return moving

    @cached_property
    def stops(self) -> Array:
        """Times (3, k - 1, n) in each segment where a column may turn back: the roots of its rate, kept within it."""
        span, first, jerk = self._pieces
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(np.maximum(first**2 - 2.0 * jerk * self.rates[:-1], 0.0))
            # The last one is for segments of steady acceleration.
            into = np.stack([(-first - root) / jerk, (-first + root) / jerk, -self.rates[:-1] / first])
        stops: Array = self.times[:-1, None] + np.clip(np.where(np.isfinite(into), into, 0.0), 0.0, span)
        return stops

    @property
    def turns(self) -> Array:
        """Times (m,) within segments at which some column turns back."""
        after, before = self.times[:-1, None] + _INSTANT, self.times[1:, None] - _INSTANT
        return np.unique(self.stops[(self.stops > after) & (self.stops < before)])

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def peaks(self) -> tuple[tuple[Array, Array], ...]:
        """Extremes of the curve, exact: lowest, highest, fastest, hardest; each as values (n,) and times (n,).

        Where numbers are too large to reckon with, they come out infinite or as no numbers.
        """
        span, first, jerk = self._pieces
        ends = np.broadcast_to(self.times[:, None], self.values.shape)
        begin = self.times[:-1, None]
        into = self.stops - begin
        turns = self.values[:-1] + into * (self.rates[:-1] + into * (first / 2.0 + into * jerk / 6.0))
        values, when = np.vstack([self.values, *turns]), np.vstack([ends, *self.stops])
        bend = -first / jerk  # where the rate turns
        bend = np.clip(np.where(np.isfinite(bend), bend, 0.0), 0.0, span)
        rates = np.vstack([self.rates, self.rates[:-1] + bend * (first + 0.5 * bend * jerk)])
        accelerations = np.vstack([np.zeros((1, self.values.shape[1])), first, first + span * jerk])
        lowest, lowest_at = _largest(-values, when)
        return (
            (-lowest, lowest_at),
            _largest(values, when),
            _largest(np.abs(rates), np.vstack([ends, begin + bend])),
            _largest(np.abs(accelerations), np.vstack([ends[:1], ends[:-1], ends[1:]])),
        )

    @property
    def _pieces(self) -> tuple[Array, Array, Array]:
        """Duration (k - 1, 1), acceleration at the start (k - 1, n) and jerk (k - 1, n) of each segment."""
        span = np.diff(self.times)[:, None]
        mean = np.diff(self.values, axis=0) / span
        first = (6.0 * mean - 4.0 * self.rates[:-1] - 2.0 * self.rates[1:]) / span
        last = (2.0 * self.rates[:-1] + 4.0 * self.rates[1:] - 6.0 * mean) / span
        return span, first, (last - first) / span


def _largest(values: Array, times: Array) -> tuple[Array, Array]:
    """The largest of each column of ``values`` (m, n), and its time."""
    best, columns = values.argmax(axis=0), np.arange(values.shape[1])
    return values[best, columns], times[best, columns]


def check_motions(plan: Plan, cell: Cell, curves: list[Curve], findings: Findings) -> None:
    """The rules of single motions, and how they join up."""
    _check_start(plan.actions[0].start, cell, findings)
    for i, (action, curve) in enumerate(zip(plan.actions, curves, strict=True)):
        if i:
            _check_joined(plan.joints, plan.actions[i - 1].end, action.start, i, findings)
        _check_ends(action, curve, cell, i, findings)
        _check_idle(action, curve, cell, i, findings)
        _check_limits(curve, cell, i, findings)


def _check_start(state: State, cell: Cell, findings: Findings) -> None:
    """The first state against the task: joints, parts, and hands that hold nothing."""
    wanted = cell.start
    off = np.abs(np.array(state.q)[cell.order] - wanted)
    if off.max(initial=0.0) > SAME:
        name = cell.machine.joint_names[int(off.argmax())]
        findings.add("start", f"joint {name} is {off.max():.6f} off the task's start", action=0, bodies=[name])
    for part, entry in cell.task.parts.items():
        apart = np.abs(np.array(state.poses[part]) - pose(entry.at.xyz, entry.at.rpy)).max()
        if apart > SAME:
            words = f"{part} stands {1e3 * apart:.3f} mm or milliradian off its pose in the task"
            findings.add("start", words, action=0, bodies=[part])
    for part, carried in state.attached.items():
        findings.add("start", f"{part} is carried by {carried.carrier}", action=0, bodies=[part, carried.carrier])


def _check_joined(joints: tuple[str, ...], before: State, after: State, i: int, findings: Findings) -> None:
    """An action starts as the one before ended: joints, openings, poses, carriers."""
    gaps = {joint: abs(a - b) for joint, a, b in zip(joints, before.q, after.q, strict=True)}
    gaps |= {f"hand {arm}": abs(before.openings[arm] - after.openings[arm]) for arm in before.openings}
    gaps |= {part: _apart(before.poses[part], after.poses[part]) for part in before.poses}
    for part in before.attached.keys() | after.attached.keys():
        one, other = (state.attached.get(part) for state in (before, after))
        if one is None or other is None or one.carrier != other.carrier:
            gaps[f"carrier of {part}"] = np.inf
        else:
            gaps[f"place of {part} in {one.carrier}"] = _apart(one.carrier_from_part, other.carrier_from_part)
    worst = max(gaps, key=lambda name: gaps[name])
    if gaps[worst] > SAME:
        words = f"{worst} jumps by {gaps[worst]:.6g} from the end of the action before"
        findings.add("continuity", words, action=i, time=0.0, bodies=[worst])


def _apart(a: object, b: object) -> float:
    return float(np.abs(np.asarray(a) - np.asarray(b)).max())


def _check_ends(action: Action, curve: Curve, cell: Cell, i: int, findings: Findings) -> None:
    """The motion joins the states, and is at rest there."""
    for state, k, when in ((action.start, 0, 0.0), (action.end, -1, action.motion.duration)):
        stands = np.concatenate([np.array(state.q)[cell.order], [state.openings[arm] for arm in cell.hands]])
        off, rate = np.abs(stands - curve.values[k]), np.abs(curve.rates[k])
        worst, fastest = int(off.argmax()), int(rate.argmax())
        if off[worst] > SAME:
            words = f"the motion is {off[worst]:.6g} off the action's state in {cell.columns[worst]}"
            findings.add("continuity", words, action=i, time=when, bodies=[cell.columns[worst]])
        if rate[fastest] > SAME:
            words = f"{cell.columns[fastest]} moves at {rate[fastest]:.6g} per second"
            findings.add("standstill", words, action=i, time=when, bodies=[cell.columns[fastest]])


def _check_idle(action: Action, curve: Curve, cell: Cell, i: int, findings: Findings) -> None:
    own = [column for arm in action.arms for column in cell.machine.arms[arm][0]]
    own += [len(cell.order) + cell.hands.index(arm) for arm in action.arms if arm in cell.hands]
    others = np.setdiff1d(np.flatnonzero(curve.moving(0.0, curve.times[-1])), own)
    if len(others):
        name = cell.columns[int(others[0])]
        findings.add("idle", f"{name} moves, and only {', '.join(action.arms)} should", action=i, bodies=[name])
    moving = np.flatnonzero(curve.moving(0.0, curve.times[-1])[: len(cell.order)])
    if action.kind in ("close", "open") and len(moving):
        name = cell.columns[int(moving[0])]
        findings.add("kind", f"{name} moves while a hand closes or opens", action=i, bodies=[name])


def _check_limits(curve: Curve, cell: Cell, i: int, findings: Findings) -> None:
    """Positions, speeds and accelerations, on the curve itself."""
    lower, upper, speed, acceleration = cell.limits
    (low, low_at), (high, high_at), (fast, fast_at), (hard, hard_at) = curve.peaks()
    beyond = np.maximum(lower - low, high - upper)
    at = np.where(lower - low > high - upper, low_at, high_at)
    finger = np.arange(len(beyond)) >= len(cell.order)
    for names, excess, when in (
        (("position", "stroke"), beyond - SAME, at),
        (("velocity", "finger-speed"), fast - speed * _ROUNDING, fast_at),
        (("acceleration", "acceleration"), hard - acceleration * _ROUNDING, hard_at),
    ):
        for name, mask in zip(names, (~finger, finger), strict=True):
            over = np.where(mask, excess, -np.inf)
            worst = int(over.argmax())
            if not over[worst] <= 0.0:  # what is no number is beyond every limit
                words = f"{cell.columns[worst]} is {over[worst]:.6g} beyond its limit"
                bodies = [cell.columns[worst]]
                findings.add(name, words, action=i, time=float(when[worst]), bodies=bodies)
