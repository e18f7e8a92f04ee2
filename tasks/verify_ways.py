"""Where goals allow things to be, and straight ways there."""

from __future__ import annotations

import numpy as np

from ..transforms import Array, compose, pose, pose_distance, rotation_about
from .task import At, Axis, Insert
from .verify_cell import Cell
from .verify_holds import REACHED, TURNED, Stretch
from .verify_motion import Curve

OFF_LINE = 0.3e-3  # m
OFF_TURN = float(np.deg2rad(0.3))
_LOOKS = 20  # along each segment of a straight way


def unit(direction: Axis) -> Array:
    """The unit vector (3,) along a direction."""
    given = np.array(direction, dtype=float)
    return np.asarray(given / np.linalg.norm(given))


def allowed(at: At, any_turn: Axis | None, reached: Array) -> Array:
    """The pose (4, 4) that a goal allows: ``at``, turned about its axis ``any_turn`` to come nearest to ``reached``."""
    wanted = pose(at.xyz, at.rpy)
    if any_turn is None:
        return wanted
    axis, between = unit(any_turn), wanted[:3, :3].T @ reached[:3, :3]
    skew = between - between.T
    along = axis @ [skew[2, 1], skew[0, 2], skew[1, 0]]
    angle = np.arctan2(along, np.trace(between) - axis @ between @ axis)
    return np.asarray(wanted @ compose(rotation_about(axis, float(angle)), np.zeros(3)))


def off(what: str, reached: Array, wanted: Array) -> str:
    """By how much something at ``reached`` (4, 4) misses the pose ``wanted`` (4, 4); empty if it is there."""
    apart, turned = (float(x) for x in pose_distance(reached, wanted))
    if apart <= REACHED and turned <= TURNED:
        return ""
    return f"{what} is {1e3 * apart:.3f} mm and {np.rad2deg(turned):.3f} deg off"


def looks(cell: Cell, curve: Curve, held: Stretch, end: float) -> dict[str, Array]:
    """Poses ((n or 1), 4, 4) of all parts, carried as in ``held``, along a curve up to the time ``end`` [s]."""
    knots = np.append(curve.times[curve.times < end], end)
    places = np.linspace(0.0, len(knots) - 1.0, _LOOKS * (len(knots) - 1) + 1)
    return held.poses(cell.flanges(curve.at(np.interp(places, np.arange(len(knots)), knots))))


def crooked(what: str, poses: Array, wanted: Array, way: Insert) -> str:
    """What is crooked about a way, or too short; empty if nothing is.

    Args:
        what: What comes along it.
        poses: Where it is (n, 4, 4), in the frame in which the way is given.
        wanted: Where it comes (4, 4).
        way: The straight way that it shall come, without a turn.
    """
    direction = unit(way.direction)
    offset = poses[:, :3, 3] - wanted[:3, 3]
    left = -offset @ direction
    short = float(way.distance) - left[0]
    if short > OFF_LINE:
        return f"{what} comes straight for {1e3 * left[0]:.2f} mm, {1e3 * short:.2f} mm too short a way"
    inside = left <= way.distance
    aside = np.linalg.norm(offset + left[:, None] * direction, axis=1)[inside].max(initial=0.0)
    turned = pose_distance(poses, wanted)[1][inside].max(initial=0.0)
    if aside > OFF_LINE or turned > OFF_TURN:
        return f"{what} comes {1e3 * aside:.2f} mm and {np.rad2deg(turned):.2f} deg off the straight way"
    return ""
