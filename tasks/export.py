"""A plan for other programs: ROS JointTrajectory messages, one for each action, or a table with one row a sample.

Fields are named as in trajectory_msgs. Between two points the motion is the cubic Hermite curve through their positions
and velocities, which is the plan's own. Points are no farther apart than a step, so that controllers that go straight
from point to point, or put quintics through the accelerations too, stay near the curve: with the default step of 20 ms
within half a milliradian at 10 rad/s2.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..errors import InputError
from ..robots.robot import Robot
from ..robots.trajectory import Trajectory
from ..transforms import Array
from .cell import robot_of
from .document import Action, Plan
from .film import check_names, curve, opening_of, within
from .task_file import task_of

STEP = 0.02  # s
_SHORTEST_STEP = 1e-3  # s
_MOST_POINTS = 100_000  # some hundred megabytes
_NANO = 1_000_000_000
_SLOPE_STEP = 1e-5  # m, of an opening
_ROUNDING = 1e-6  # of a step


class Time(msgspec.Struct, frozen=True):
    """A time or duration."""

    sec: int
    nanosec: int


class Header(msgspec.Struct, frozen=True):
    """When a trajectory starts, on the clock of the whole plan; joints have no frame."""

    stamp: Time
    frame_id: str = ""


class Point(msgspec.Struct, frozen=True):
    """One point of a trajectory [rad or m, per second, per second squared]."""

    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    accelerations: tuple[float, ...]
    effort: tuple[float, ...]
    time_from_start: Time


class JointTrajectory(msgspec.Struct, frozen=True):
    """trajectory_msgs/JointTrajectory."""

    header: Header
    joint_names: tuple[str, ...]
    points: tuple[Point, ...]


class GripEvent(msgspec.Struct, frozen=True):
    """A carrier (an arm or another part) takes a part or lets it go."""

    kind: str
    part: str
    carrier: str
    time_from_start: Time


class Stretch(msgspec.Struct, frozen=True):
    """One action.

    Attributes:
        action: Its number, from 1.
        kind: What the motion is for.
        words: What happens, in words.
        arms: Arms that move or whose hands do.
        trajectory: The motion of the robot's joints.
        hands: The motion of the hands' joints, mimics included, as ``arm/joint``; without accelerations.
        events: Takings and lettings go.
    """

    action: int
    kind: str
    words: str
    arms: tuple[str, ...]
    trajectory: JointTrajectory
    hands: JointTrajectory
    events: tuple[GripEvent, ...]


def trajectories(plan: Plan, step: float = STEP) -> list[Stretch]:
    """The whole plan, action by action.

    Args:
        plan: The plan.
        step: Longest time between two points [s].

    Raises:
        InputError: Robot or task are not to be had as they were, or ``step`` is below a millisecond or gives hundreds
            of thousands of points.
    """
    robot = _robot(plan, step)
    stretches, start = [], 0.0
    for number, action in enumerate(plan.actions, start=1):
        motion, times = curve(plan.joints, action.motion), _times(action, step)
        header, stamps = Header(_time(start)), [_time(time) for time in times]
        stretches.append(
            Stretch(
                action=number,
                kind=action.kind,
                words=action.words,
                arms=action.arms,
                trajectory=_joints(plan.joints, motion, times, header, stamps),
                hands=_fingers(robot, motion, times, header, stamps),
                events=tuple(GripEvent(e.kind, e.part, e.carrier, _time(e.time)) for e in action.events),
            )
        )
        start += action.motion.duration
    return stretches


def table(plan: Plan, step: float = STEP) -> str:
    """The whole plan as CSV: time [s], action, kind, every joint [rad or m], every opening [m], what is gripped.

    Args:
        plan: The plan.
        step: Longest time between two rows [s].

    Raises:
        InputError: As for `trajectories`.
    """
    arms = sorted(_robot(plan, step).hands)
    written = io.StringIO()
    writer = csv.writer(written, lineterminator="\n")
    writer.writerow(["time", "action", "kind", *plan.joints, *(opening_of(arm) for arm in arms), "event"])
    start = 0.0
    for number, action in enumerate(plan.actions, start=1):
        motion = curve(plan.joints, action.motion)
        times = _times(action, step)
        words = [""] * len(times)
        for event in action.events:
            nearest = int(np.abs(times - event.time).argmin())
            words[nearest] += f"{'; ' if words[nearest] else ''}{event.kind} {event.part} {event.carrier}"
        for time, row, text in zip(times, motion.sample(times), words, strict=True):
            writer.writerow([f"{start + time:.9f}", number, action.kind, *(f"{x:.9f}" for x in row), text])
        start += action.motion.duration
    return written.getvalue()


def _robot(plan: Plan, step: float) -> Robot:
    if not step >= _SHORTEST_STEP:
        raise InputError("step", f"{step} s between points", f"give at least {_SHORTEST_STEP} s")
    if plan.duration > _MOST_POINTS * step:
        problem = f"the motion of {plan.duration:g} s has more than {_MOST_POINTS} points {step:g} s apart"
        raise InputError("step", problem, "give a longer one")
    robot = robot_of(task_of(plan.task), plan.folder)
    check_names(plan, robot)
    return robot


def _times(action: Action, step: float) -> Array:
    """Times (n,) [s] of the samples of an action and of its events, and more between where they are far apart."""
    knots = np.array(action.motion.times)
    events = np.array([event.time for event in action.events])
    apart = np.abs(events[:, None] - knots).min(axis=1, initial=np.inf) > _SHORTEST_STEP
    knots = np.union1d(knots, events[apart])
    parts = np.maximum(np.ceil(np.diff(knots) / step - _ROUNDING), 1).astype(int)
    first = np.repeat(knots[:-1], parts)
    share = (np.arange(len(first)) - np.repeat(np.cumsum(parts) - parts, parts)) / np.repeat(parts, parts)
    return np.append(first + share * np.repeat(np.diff(knots), parts), knots[-1])


def _joints(
    names: Sequence[str], motion: Trajectory, times: Array, header: Header, stamps: Sequence[Time]
) -> JointTrajectory:
    """The robot's joints, with the accelerations of the curve: where they jump, those after the point."""
    count = len(names)
    accelerations = np.zeros((len(times), count))
    if len(motion.times) > 1:
        accelerations = CubicHermiteSpline(motion.times, motion.positions, motion.velocities)(times, 2)[:, :count]
    rows = zip(motion.sample(times)[:, :count], motion.velocity(times)[:, :count], accelerations, stamps, strict=True)
    points = (Point(tuple(q.tolist()), tuple(v.tolist()), tuple(a.tolist()), (), stamp) for q, v, a, stamp in rows)
    return JointTrajectory(header, tuple(names), tuple(points))


def _fingers(robot: Robot, motion: Trajectory, times: Array, header: Header, stamps: Sequence[Time]) -> JointTrajectory:
    """The joints of all hands."""
    positions, velocities, names = [np.zeros((len(times), 0))], [np.zeros((len(times), 0))], []
    openings, speeds = motion.sample(times), motion.velocity(times)
    for arm, hand in robot.hands.items():
        i = motion.joint_names.index(opening_of(arm))
        opening = within(openings[:, i], hand.stroke)
        low, high = (np.clip(opening + offset, *hand.stroke) for offset in (-_SLOPE_STEP, _SLOPE_STEP))
        rise = hand.joint_positions(high) - hand.joint_positions(low)
        names += [f"{arm}/{joint}" for joint in hand.joint_names]
        positions.append(hand.joint_positions(opening))
        velocities.append(rise * (speeds[:, i] / np.maximum(high - low, _SLOPE_STEP))[:, None])
    rows = zip(np.hstack(positions), np.hstack(velocities), stamps, strict=True)
    points = (Point(tuple(q.tolist()), tuple(v.tolist()), (), (), stamp) for q, v, stamp in rows)
    return JointTrajectory(header, tuple(names), tuple(points))


def _time(seconds: float) -> Time:
    return Time(*divmod(round(seconds * _NANO), _NANO))
