"""Timed joint motions: cubic Hermite curves within velocity and acceleration limits, close to the path they time."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicHermiteSpline

from ..errors import InputError
from ..transforms import Array

_STILL = 1e-9  # rad: less is no motion
_NO_BLEND = 1e-6  # rad: where corners may be cut by less, the motion stops at them
_THINNING = 0.3  # share of the deviation spent on leaving out waypoints; the rest cuts corners
_LONGEST_BLEND = 0.45  # share of a leg that the blend at one of its ends may take
_BLEND_STEPS = 4  # pieces of a blend between legs at right angles
_SHORTEST_PHASE = 1e-4  # s, or a hundredth of its straight's time
_ROUNDING = 1.0 + 1e-5
_TINY = 1e-300  # keeps quotients finite that nothing uses
_TIME_ROUNDING = 1e-9  # s
_JOIN_TOLERANCE = 1e-6  # rad, rad/s

_log = logging.getLogger(__name__)
logging.getLogger("toppra").setLevel(logging.CRITICAL)  # its failures are handled here


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A joint motion over time: between two samples a cubic Hermite curve.

    Attributes:
        joint_names: Names of the n joints.
        times: Sample times (k,) [s], strictly increasing from 0. One sample is a motion of no duration.
        positions: Joint positions (k, n) [rad or m].
        velocities: Joint velocities (k, n) [rad/s or m/s].
    """

    joint_names: tuple[str, ...]
    times: Array
    positions: Array
    velocities: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "joint_names", tuple(self.joint_names))
        times = _finite("trajectory times", self.times, 1)
        shape = (len(times), len(self.joint_names))
        if not len(times) or times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
            raise InputError("trajectory times", "they do not increase from 0", "give times (k,) [s] from 0 upwards")
        for name in ("positions", "velocities"):
            array = _finite(f"trajectory {name}", getattr(self, name), 2)
            if array.shape != shape:
                raise InputError(f"trajectory {name}", f"shape {array.shape}", f"give {shape}: times by joints")
            object.__setattr__(self, name, array)
        object.__setattr__(self, "times", times)

    @classmethod
    def dwell(cls, joint_names: Sequence[str], q: npt.ArrayLike, duration: float) -> Trajectory:
        """Standing still at ``q`` (n,) for ``duration`` [s], which may be 0."""
        times = np.array([0.0, duration]) if duration else np.zeros(1)
        positions = np.tile(_finite("dwell", q, 1), (len(times), 1))
        return cls(tuple(joint_names), times, positions, np.zeros_like(positions))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.times[-1])

    def sample(self, t: npt.ArrayLike) -> Array:
        """Positions (m, n) at times ``t`` (m,) [s].

        Raises:
            InputError: A time outside the trajectory.
        """
        return self._at(t, order=0)

    def velocity(self, t: npt.ArrayLike) -> Array:
        """Velocities (m, n) at times ``t`` (m,) [s].

        Raises:
            InputError: A time outside the trajectory.
        """
        return self._at(t, order=1)

    def peak_velocity(self) -> Array:
        """Largest speed (n,) of each joint [rad/s], exact: at samples and where the acceleration crosses zero."""
        start, end = self._accelerations()
        crosses = start * end < 0.0
        # v(t) = v0 + a0 t + (a1 - a0) t^2 / (2 T) is a0^2 T / (2 (a0 - a1)) beyond v0 where it turns.
        span = np.diff(self.times)[:, None]
        turned = self.velocities[:-1] + start**2 * span / (2.0 * np.where(crosses, start - end, 1.0))
        peaks: Array = np.concatenate([np.abs(self.velocities), np.where(crosses, np.abs(turned), 0.0)]).max(axis=0)
        return peaks

    def peak_acceleration(self) -> Array:
        """Largest acceleration (n,) of each joint [rad/s^2], exact: it is linear between samples."""
        peaks: Array = np.abs(np.concatenate(self._accelerations())).max(axis=0, initial=0.0)
        return peaks

    def slowed(self, factor: float) -> Trajectory:
        """The same curve in ``factor`` times the time."""
        return Trajectory(self.joint_names, self.times * factor, self.positions, self.velocities / factor)

    def reversed(self) -> Trajectory:
        """The same curve from its end to its start."""
        times = self.duration - self.times[::-1]
        return Trajectory(self.joint_names, times, self.positions[::-1], -self.velocities[::-1])

    def then(self, other: Trajectory) -> Trajectory:
        """This motion and ``other`` after it.

        Raises:
            InputError: Other joints, or ``other`` does not start with the position and velocity where this one ends.
        """
        if other.joint_names != self.joint_names:
            raise InputError("trajectory", f"joints {other.joint_names} follow {self.joint_names}", "keep the joints")
        gaps = (self.positions[-1] - other.positions[0], self.velocities[-1] - other.velocities[0])
        if np.abs(gaps).max(initial=0.0) > _JOIN_TOLERANCE:
            raise InputError("trajectory", "the next one starts elsewhere", "start it where, and as fast as, this ends")
        return Trajectory(
            self.joint_names,
            np.concatenate([self.times, self.duration + other.times[1:]]),
            np.concatenate([self.positions, other.positions[1:]]),
            np.concatenate([self.velocities, other.velocities[1:]]),
        )

    def _at(self, t: npt.ArrayLike, order: int) -> Array:
        t = _finite("time", t, 1)
        if np.any(t < -_TIME_ROUNDING) or np.any(t > self.duration + _TIME_ROUNDING):
            raise InputError("time", "it lies outside the trajectory", f"give times from 0 to {self.duration:.3f} s")
        if len(self.times) == 1:
            return np.repeat((self.positions, self.velocities)[order], len(t), axis=0)
        curve = CubicHermiteSpline(self.times, self.positions, self.velocities)
        values: Array = curve(np.clip(t, 0.0, self.duration), order)
        return values

    def _accelerations(self) -> tuple[Array, Array]:
        """Accelerations (k - 1, n) at the start and the end of each segment."""
        span = np.diff(self.times)[:, None]
        mean = np.diff(self.positions, axis=0) / span
        first, second = self.velocities[:-1], self.velocities[1:]
        return (6.0 * mean - 4.0 * first - 2.0 * second) / span, (2.0 * first + 4.0 * second - 6.0 * mean) / span


def time_path(
    q: npt.ArrayLike,
    joint_names: Sequence[str],
    velocity: npt.ArrayLike,
    acceleration: npt.ArrayLike,
    *,
    speed: float = 1.0,
    max_deviation: float = 0.02,
) -> Trajectory:
    """A fast motion along a polyline of waypoints, from rest to rest, within the limits.

    Corners become parabolic blends, through which the motion need not stop, and TOPP-RA (Pham and Pham, 2018) finds the
    speed along straights and blends. Velocity and acceleration are then measured on the resulting curve, and the motion
    is slowed by as much as they exceed the limits.

    Args:
        q: Waypoints (k, n) [rad or m]. The motion starts at the first and ends at the last, and passes near the others.
        joint_names: Names of the n joints.
        velocity: Velocity limits (n,) [rad/s or m/s].
        acceleration: Acceleration limits (n,) [rad/s^2 or m/s^2].
        speed: Share of the velocity limits to use, in (0, 1]. The motion is the one at full speed, slowed down as a
            whole: half the speed takes twice the time on the same curve, with a quarter of the accelerations.
        max_deviation: How far each joint may be from the polyline, and any waypoint from the curve [rad or m]. Halving
            it lowers the speed at corners by a third; at 0 the motion stops at every corner.

    Returns:
        The timed motion, never slower than stopping at every corner; one sample if nothing moves.

    Raises:
        InputError: Wrong shapes, numbers that are not finite, limits that are not positive, a speed outside (0, 1].
    """
    names = tuple(joint_names)
    waypoints = _finite("path", q, 2)
    if not waypoints.size or waypoints.shape[1] != len(names):
        raise InputError("path", f"shape {waypoints.shape}", f"give at least one waypoint (k, {len(names)})")
    velocity = _limits("velocity limits", velocity, len(names))
    acceleration = _limits("acceleration limits", acceleration, len(names))
    if not 0.0 < speed <= 1.0:
        raise InputError("speed", f"{speed} is no share of the limits", "give more than 0 and at most 1")
    if not 0.0 <= max_deviation < np.inf:
        raise InputError("max_deviation", f"{max_deviation} is no distance", "give 0 or more [rad]")

    corners = _simplified(waypoints, max(_THINNING * max_deviation, _STILL))
    travel = np.abs(np.diff(corners, axis=0)).sum(axis=0)
    if travel.max() < _STILL:
        return Trajectory.dwell(names, waypoints[0], 0.0)
    # No joint gets faster than by speeding up over half of its way: this keeps the numbers of tiny motions near 1.
    reachable = np.minimum(velocity, np.sqrt(acceleration * np.maximum(travel, _STILL)))

    def motion(path: _Path, squared_speeds: Array) -> Trajectory:
        run = _run(path, squared_speeds, acceleration, names, corners[-1])
        stretch = max((run.peak_velocity() / velocity).max(), np.sqrt((run.peak_acceleration() / acceleration).max()))
        return run.slowed(max(stretch, 1.0) * _ROUNDING / speed)

    polyline = _blended(corners, reachable, 0.0)
    stopping = motion(polyline, np.zeros(len(polyline.lengths) + 1))
    blended = _blended(corners, reachable, (1.0 - _THINNING) * max_deviation)
    if blended.straight.all():
        return stopping
    squared_speeds = _squared_speeds(blended, acceleration)
    if squared_speeds is None:
        _log.warning("TOPP-RA found no speeds along %d waypoints: the motion stops at each", len(corners))
        return stopping
    return min(motion(blended, squared_speeds), stopping, key=lambda run: run.duration)


@dataclass(frozen=True, eq=False)
class _Path:
    """A curve q(s) of m quadratic pieces, smooth in its first derivative; s is the time it takes at full speed.

    Attributes:
        lengths: Length (m,) of each piece in s.
        starts: Positions (m, n) at the start of the pieces.
        tangents: First derivatives (m, n) there, within the velocity limits.
        curvatures: Second derivatives (m, n), constant along a piece; zero on straights.
        straight: Which pieces are straights (m,); the others are steps of blends.
    """

    lengths: Array
    starts: Array
    tangents: Array
    curvatures: Array
    straight: npt.NDArray[np.bool_]


def _simplified(q: Array, tolerance: float) -> Array:
    """Waypoints such that all left out lie within ``tolerance`` of the polyline (Ramer, Douglas and Peucker)."""
    keep = np.zeros(len(q), dtype=bool)
    keep[[0, -1]] = True
    open_chords = [(0, len(q) - 1)]
    while open_chords:
        first, last = open_chords.pop()
        chord, between = q[last] - q[first], q[first + 1 : last] - q[first]
        along = np.clip(between @ chord / max(chord @ chord, _TINY), 0.0, 1.0)
        distance = np.linalg.norm(between - along[:, None] * chord, axis=1)
        if distance.max(initial=0.0) > tolerance:
            farthest = first + 1 + int(distance.argmax())
            keep[farthest] = True
            open_chords += [(first, farthest), (farthest, last)]
    return q[keep]


def _blended(corners: Array, velocity: Array, deviation: float) -> _Path:
    """The polyline at full speed, with a parabolic blend at each inner corner that stays within ``deviation``.

    A blend from s = r before a corner to r after it, where the tangent turns by c, passes the corner at c r / 4.
    """
    way = np.diff(corners, axis=0)
    duration = (np.abs(way) / velocity).max(axis=1)
    tangent = way / duration[:, None]
    turn = np.diff(tangent, axis=0)
    sharpness = np.linalg.norm(turn, axis=1) / np.linalg.norm(tangent[:-1], axis=1)
    steps = np.clip(np.ceil(_BLEND_STEPS * sharpness), 1, _BLEND_STEPS)
    reach = np.zeros(len(corners))
    if deviation > _NO_BLEND:
        # Where the speed changes, a Hermite curve leaves a quadratic piece by up to a quarter of the cut / steps^2.
        cut = deviation / (1.0 + 0.25 / steps**2)
        tightest = 4.0 * cut / np.maximum(np.abs(turn).max(axis=1), _TINY)
        reach[1:-1] = np.minimum(tightest, _LONGEST_BLEND * np.minimum(duration[:-1], duration[1:]))

    # Per leg: its straight, then the steps of the blend at its end; the last leg has none.
    turn, steps, span = np.pad(turn, ((0, 1), (0, 0))), np.append(steps, 1.0)[:, None], 2.0 * reach[1:, None]
    bend = np.divide(turn, span, out=np.zeros_like(way), where=span > 0.0)[:, None]
    step = np.arange(_BLEND_STEPS)
    s, into = (span * step / steps)[..., None], tangent[:, None]
    straight = corners[:-1] + tangent * reach[:-1, None]
    blend = corners[1:, None] + into * (s - reach[1:, None, None]) + 0.5 * bend * s**2
    lengths = np.column_stack([duration - reach[:-1] - reach[1:], np.where(step < steps, span / steps, 0.0)])
    present = lengths > 0.0
    return _Path(
        lengths=lengths[present],
        starts=np.concatenate([straight[:, None], blend], axis=1)[present],
        tangents=np.concatenate([into, into + bend * s], axis=1)[present],
        curvatures=np.concatenate([np.zeros_like(into), np.broadcast_to(bend, blend.shape)], axis=1)[present],
        straight=np.broadcast_to(np.arange(1 + _BLEND_STEPS) == 0, lengths.shape)[present],
    )


def _squared_speeds(path: _Path, acceleration: Array) -> Array | None:
    """Squared path speeds x (m + 1,) at the ends of the pieces; None where TOPP-RA finds none.

    Along a piece the path acceleration u is constant and q''(s) too, so that q'(s) u + q''(s) x is linear in s: to keep
    the acceleration limits at both ends of the piece keeps them on all of it. Velocities keep theirs while x <= 1.
    """
    # Heavy (it draws): who reads or checks a timed motion must not wait for it.
    from toppra.algorithm import TOPPRA
    from toppra.constraint import LinearConstraint

    class AccelerationLimits(LinearConstraint):
        def compute_constraint_params(self, path: Any, gridpoints: Any) -> tuple[Any, ...]:
            return limits

    tangent, bend = path.tangents / acceleration, path.curvatures / acceleration
    at_end = tangent + 3.0 * path.lengths[:, None] * bend  # x grows by 2 u length to there, and q' by bend * length
    a = np.pad(np.hstack([tangent, at_end]), ((0, 1), (0, 0)))
    b = np.pad(np.hstack([bend, bend]), ((0, 1), (0, 0)))
    both_signs = np.vstack([np.eye(a.shape[1]), -np.eye(a.shape[1])])
    at_most_one = np.tile([0.0, 1.0], (len(a), 1))
    limits = (a, b, np.zeros_like(a), both_signs, np.ones(len(both_signs)), None, at_most_one)
    constraint = AccelerationLimits()
    constraint.identical = True
    s = np.concatenate([[0.0], np.cumsum(path.lengths)])
    solver = TOPPRA([constraint], SimpleNamespace(path_interval=s[[0, -1]]), gridpoints=s, solver_wrapper="seidel")
    _, speeds, _ = solver.compute_parameterization(0, 0)
    return None if speeds is None or not np.all(speeds[1:-1] > 0.0) else speeds**2


def _run(path: _Path, x: Array, acceleration: Array, joint_names: tuple[str, ...], end: Array) -> Trajectory:
    """The motion along ``path`` to ``end`` (n,) with squared speeds ``x`` (m + 1,) at the ends of its pieces.

    Along a straight the speed rises with full acceleration, stays at the most the limits allow, and falls.
    """
    first, last, length, straight = x[:-1], x[1:], path.lengths, path.straight
    hardest = (np.abs(path.tangents) / acceleration).max(axis=1)
    slope = 2.0 / np.maximum(hardest, _TINY)  # of x along a straight, at full acceleration
    top = np.clip(0.5 * (first + last + slope * length), np.maximum(first, last), 1.0)
    phases = np.column_stack([np.zeros_like(length), (top - first) / slope, length - (top - last) / slope, length])
    speeds = np.sqrt(np.column_stack([first, top, top, last]))
    times = 2.0 * np.diff(phases) / np.maximum(speeds[:, :-1] + speeds[:, 1:], _TINY)
    # A phase too brief is left out: fewer samples, and lower accelerations.
    rises, stays, falls = (times > np.minimum(_SHORTEST_PHASE, 0.01 * times.sum(axis=1, keepdims=True))).T
    kept = np.column_stack([np.ones_like(straight), straight & rises & (stays | falls), straight & stays & falls])

    offset, speed = phases[:, :3][kept], np.append(speeds[:, :3][kept], speeds[-1, 3])
    piece = np.nonzero(kept)[0]
    way = np.append((np.cumsum(length) - length)[piece] + offset, length.sum())
    times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(way) / (speed[:-1] + speed[1:]))])
    positions = np.vstack([path.starts[piece] + path.tangents[piece] * offset[:, None], end])
    return Trajectory(joint_names, times, positions, path.tangents[np.append(piece, -1)] * speed[:, None])


def _finite(place: str, values: npt.ArrayLike, dimensions: int) -> Array:
    """A copy of ``values`` that nobody changes."""
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            place, f"no array of numbers ({error})", f"give numbers in {dimensions} dimension(s)"
        ) from error
    if array.ndim != dimensions:
        raise InputError(place, f"shape {array.shape}", f"give {dimensions} dimension(s)")
    if not np.isfinite(array).all():
        raise InputError(place, "a number is not finite", "give finite numbers")
    array.setflags(write=False)
    return array


def _limits(place: str, values: npt.ArrayLike, joints: int) -> Array:
    limits = _finite(place, values, 1)
    if limits.shape != (joints,) or np.any(limits <= 0.0):
        raise InputError(place, f"{limits} are no limits of {joints} joints", "give one positive number a joint")
    return limits
