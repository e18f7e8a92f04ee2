"""Exports: read back they are the plan, whoever reads them."""

from __future__ import annotations

import csv
import io
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace
from plans import sample_plan
from scipy.interpolate import BPoly, CubicHermiteSpline

from kumitate.errors import InputError
from kumitate.robots.library import load_hand
from kumitate.tasks.export import STEP, Stretch, table, trajectories

NANO = 1_000_000_000


@pytest.fixture(scope="module")
def plan():
    return sample_plan()


@pytest.fixture(scope="module")
def stretches(plan):
    """Written and read again."""
    return msgspec.json.decode(msgspec.json.encode(trajectories(plan)), type=list[Stretch])


def seconds(time):
    return time.sec + time.nanosec / NANO


def arrays(trajectory):
    """Times (k,), positions, velocities and accelerations (k, joints) of the points."""
    points = trajectory.points
    fields = ([getattr(point, name) for point in points] for name in ("positions", "velocities", "accelerations"))
    return np.array([seconds(point.time_from_start) for point in points]), *map(np.array, fields)


def plan_curve(action):
    motion = action.motion
    return CubicHermiteSpline(motion.times, motion.positions, motion.velocities)


def dense(times):
    return np.linspace(times[0], times[-1], 997)


def test_the_cubics_through_the_points_are_the_plan(plan, stretches):
    assert len(stretches) == len(plan.actions)
    for action, stretch in zip(plan.actions, stretches, strict=True):
        times, positions, velocities, _ = arrays(stretch.trajectory)
        assert stretch.trajectory.joint_names == plan.joints
        assert times[-1] == pytest.approx(action.motion.duration, abs=1e-9)
        read = CubicHermiteSpline(times, positions, velocities)(dense(times))
        assert np.abs(read - plan_curve(action)(dense(times))).max() < 1e-8


def test_readers_that_go_straight_or_use_the_accelerations_stay_near(plan, stretches):
    for action, stretch in zip(plan.actions, stretches, strict=True):
        times, positions, velocities, accelerations = arrays(stretch.trajectory)
        t = dense(times)
        expected = plan_curve(action)(t)
        straight = np.column_stack([np.interp(t, times, column) for column in positions.T])
        assert np.abs(straight - expected).max() < 5e-4
        quintic = BPoly.from_derivatives(times, np.stack([positions, velocities, accelerations], axis=1))(t)
        assert np.abs(quintic - expected).max() < 1e-4


def test_accelerations_are_the_slopes_of_the_velocities_after_the_point(plan, stretches):
    tiny = 1e-6
    for action, stretch in zip(plan.actions, stretches, strict=True):
        times, _, velocities, accelerations = arrays(stretch.trajectory)
        after = plan_curve(action)(times[:-1] + tiny, 1)
        assert np.abs((after - velocities[:-1]) / tiny - accelerations[:-1]).max() < 5e-3
    assert max(np.abs(arrays(stretch.trajectory)[3]).max() for stretch in stretches) > 1.0


def test_all_run_on_one_clock_without_gaps(plan, stretches):
    ends = [
        seconds(stretch.trajectory.header.stamp) + seconds(stretch.trajectory.points[-1].time_from_start)
        for stretch in stretches
    ]
    assert seconds(stretches[0].trajectory.header.stamp) == 0.0
    assert ends[-1] == pytest.approx(plan.duration, abs=1e-7)
    for end, (before, after) in zip(ends, pairwise(stretches), strict=False):
        assert seconds(after.trajectory.header.stamp) == pytest.approx(end, abs=2e-9)
        assert before.trajectory.points[-1].positions == pytest.approx(after.trajectory.points[0].positions, abs=1e-9)
    for stretch in stretches:
        steps = np.diff(arrays(stretch.trajectory)[0])
        assert (steps > 1e-6).all()
        assert steps.max() <= STEP + 2e-9
        assert stretch.hands.header == stretch.trajectory.header


def test_every_grip_is_told_at_a_point(plan, stretches):
    told = [(s.action, e.kind, e.part, e.carrier) for s in stretches for e in s.events]
    assert told == [
        (number, event.kind, event.part, event.carrier)
        for number, action in enumerate(plan.actions, start=1)
        for event in action.events
    ]
    assert {kind for _, kind, *_ in told} == {"attach", "detach"}
    for stretch in stretches:
        for event in stretch.events:
            assert np.abs(arrays(stretch.trajectory)[0] - seconds(event.time_from_start)).min() < 2e-9


def test_an_event_between_samples_gets_a_point(plan):
    action = next(a for a in plan.actions if a.events)
    event = replace(action.events[0], time=0.377 * action.motion.duration)
    (stretch,) = trajectories(replace(plan, actions=(replace(action, events=(event,)),)), step=1.0)
    assert np.abs(arrays(stretch.trajectory)[0] - event.time).min() < 1e-9
    rows = list(csv.DictReader(io.StringIO(table(replace(plan, actions=(replace(action, events=(event,)),)), 1.0))))
    (row,) = [row for row in rows if row["event"]]
    assert float(row["time"]) == pytest.approx(event.time, abs=1e-9)


def test_fingers_follow_the_openings(plan, stretches):
    hand = load_hand("robotiq_2f85")
    moved = 0.0
    for action, stretch in zip(plan.actions, stretches, strict=True):
        assert stretch.hands.joint_names == tuple(f"{a}/{j}" for a in ("left", "right") for j in hand.joint_names)
        times, positions, velocities, accelerations = arrays(stretch.hands)
        assert accelerations.size == 0
        for i, arm in enumerate(("left", "right")):
            own = slice(i * len(hand.joint_names), (i + 1) * len(hand.joint_names))
            motion = action.motion
            opening = CubicHermiteSpline(motion.times, motion.openings[arm], motion.opening_velocities[arm])(times)
            assert np.abs(hand.joint_positions(opening) - positions[:, own]).max() < 1e-6
        way = np.cumsum((velocities[1:] + velocities[:-1]) / 2.0 * np.diff(times)[:, None], axis=0)
        assert np.abs(positions[0] + way - positions[1:]).max() < 1e-3
        moved = max(moved, np.ptp(positions, axis=0).max())
    assert moved > 0.3


def test_fields_are_those_of_trajectory_msgs(plan):
    (first, *_) = msgspec.json.decode(msgspec.json.encode(trajectories(plan)))
    message = first["trajectory"]
    assert list(message) == ["header", "joint_names", "points"]
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert list(message["points"][0]) == ["positions", "velocities", "accelerations", "effort", "time_from_start"]
    assert message["points"][0]["effort"] == []
    assert set(message["points"][0]["time_from_start"]) == {"sec", "nanosec"}
    assert all(0 <= point["time_from_start"]["nanosec"] < NANO for point in message["points"])


def test_the_table_has_one_row_a_sample(plan, stretches):
    rows = list(csv.DictReader(io.StringIO(table(plan))))
    assert list(rows[0]) == ["time", "action", "kind", *plan.joints, "left/opening", "right/opening", "event"]
    assert len(rows) == sum(len(stretch.trajectory.points) for stretch in stretches)
    starts = np.cumsum([0.0, *(action.motion.duration for action in plan.actions)])
    for row in rows[::23]:
        number = int(row["action"])
        action = plan.actions[number - 1]
        motion = action.motion
        assert row["kind"] == action.kind
        time = np.clip(float(row["time"]) - starts[number - 1], 0.0, motion.duration)
        assert [float(row[j]) for j in plan.joints] == pytest.approx(plan_curve(action)(time), abs=1e-8)
        for arm in ("left", "right"):
            opening = CubicHermiteSpline(motion.times, motion.openings[arm], motion.opening_velocities[arm])(time)
            assert float(row[f"{arm}/opening"]) == pytest.approx(opening, abs=1e-8)
    told = [(int(row["action"]), row["event"]) for row in rows if row["event"]]
    assert told == [(s.action, f"{e.kind} {e.part} {e.carrier}") for s in stretches for e in s.events]


def test_a_wider_step_gives_fewer_points_on_the_same_curve(plan):
    wide = trajectories(plan, step=0.2)
    assert sum(len(s.trajectory.points) for s in wide) < 0.3 * sum(len(s.trajectory.points) for s in trajectories(plan))
    times, positions, velocities, _ = arrays(wide[0].trajectory)
    read = CubicHermiteSpline(times, positions, velocities)(dense(times))
    assert np.abs(read - plan_curve(plan.actions[0])(dense(times))).max() < 1e-8


@pytest.mark.parametrize("step", [0.0, -1.0, float("nan"), 1e-4])
def test_a_step_of_nothing_is_refused(plan, step):
    for export in (trajectories, table):
        with pytest.raises(InputError, match="step"):
            export(plan, step)


def test_more_points_than_anybody_can_use_are_refused(plan):
    action = plan.actions[0]
    motion = replace(action.motion, times=tuple(1e9 * time for time in action.motion.times))
    for export in (trajectories, table):
        with pytest.raises(InputError, match=r"step: .*more than 100000 points"):
            export(replace(plan, actions=(replace(action, motion=motion), *plan.actions[1:])))


def test_a_plan_of_another_robot_is_refused(plan):
    for export in (trajectories, table):
        with pytest.raises(InputError, match="joints"):
            export(replace(plan, task={**plan.task, "robot": "ur3_dual"}))


def test_an_action_of_no_duration_is_one_point(plan):
    action = plan.actions[0]
    motion = action.motion
    still = replace(
        motion,
        times=(0.0,),
        positions=motion.positions[:1],
        velocities=motion.velocities[:1],
        openings={arm: values[:1] for arm, values in motion.openings.items()},
        opening_velocities={arm: values[:1] for arm, values in motion.opening_velocities.items()},
    )
    (stretch,) = trajectories(replace(plan, actions=(replace(action, motion=still),)))
    (point,) = stretch.trajectory.points
    assert point.positions == motion.positions[0]
    assert not any(point.accelerations)
