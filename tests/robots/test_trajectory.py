"""Laws of timed motions: exact peaks, limits kept, close to the path, from rest to rest; and wrong input refused."""

from __future__ import annotations

import numpy as np
import pytest
import toppra
import toppra.algorithm
import toppra.constraint
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from kumitate.errors import InputError
from kumitate.robots import trajectory
from kumitate.robots.trajectory import Trajectory, time_path
from kumitate.transforms import Array

NAMES = ("shoulder", "elbow", "wrist")
VELOCITY = np.array([2.0, 3.0, 4.0])
ACCELERATION = np.array([6.0, 10.0, 25.0])

finite = st.floats(-3.0, 3.0, allow_subnormal=False)


def arrays(rows: int) -> st.SearchStrategy[Array]:
    return hnp.arrays(float, (rows, 3), elements=finite)


@st.composite
def trajectories(draw: st.DrawFn, fewest: int = 2) -> Trajectory:
    k = draw(st.integers(fewest, 6))
    spans = draw(hnp.arrays(float, k - 1, elements=st.floats(0.05, 2.0)))
    times = np.concatenate([[0.0], np.cumsum(spans)])
    return Trajectory(NAMES, times, draw(arrays(k)), draw(arrays(k)))


@st.composite
def paths(draw: st.DrawFn) -> Array:
    """Polylines of every kind: far and near waypoints, equal ones, joints at rest, there and back, densely sampled."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    vertices = rng.uniform(-1.5, 1.5, (draw(st.integers(2, 8)), 3)) * draw(st.sampled_from([1.0, 0.1, 1e-3, 1e-6]))
    if draw(st.booleans()):
        vertices[:, rng.integers(3)] = 0.4
    if draw(st.booleans()):
        vertices = np.concatenate([vertices, vertices[-2::-1]])
    if draw(st.booleans()):
        vertices = np.repeat(vertices, rng.integers(1, 3, len(vertices)), axis=0)
    if draw(st.booleans()):
        vertices = vertices[rng.integers(0, 2, len(vertices)).cumsum() % len(vertices)] + rng.normal(
            scale=1e-7, size=vertices.shape
        )
    each = draw(st.sampled_from([1, 1, 2, 30]))
    steps = np.linspace(0.0, 1.0, each, endpoint=False)[:, None]
    dense = vertices[:-1, None] + steps * np.diff(vertices, axis=0)[:, None]
    return np.concatenate([dense.reshape(-1, 3), vertices[-1:]])


def distance(points: Array, polyline: Array) -> Array:
    """From each of ``points`` (m, n) to a polyline (k, n): the largest joint difference to its nearest point there."""
    if len(polyline) == 1:
        return np.abs(points - polyline).max(axis=1)
    start, way = polyline[:-1], np.diff(polyline, axis=0)
    along = np.einsum("mkn,kn->mk", points[:, None] - start, way) / np.maximum((way**2).sum(axis=1), 1e-300)
    nearest = start + np.clip(along, 0.0, 1.0)[..., None] * way
    return np.abs(points[:, None] - nearest).max(axis=2).min(axis=1)


def within_limits(motion: Trajectory, share: float = 1.0) -> bool:
    return bool(
        np.all(motion.peak_velocity() <= share * VELOCITY)
        and np.all(motion.peak_acceleration() <= share**2 * ACCELERATION)
    )


# The curve


@given(trajectories())
def test_the_curve_passes_its_samples_with_their_velocities(motion):
    np.testing.assert_allclose(motion.sample(motion.times), motion.positions, atol=1e-9)
    np.testing.assert_allclose(motion.velocity(motion.times), motion.velocities, atol=1e-9)


@given(trajectories())
def test_the_velocity_is_the_derivative_of_the_position(motion):
    t, h = np.linspace(1e-3, motion.duration - 1e-3, 200), 1e-6
    slope = (motion.sample(t + h) - motion.sample(t - h)) / (2.0 * h)
    scale = 1.0 + motion.peak_velocity().max() + motion.peak_acceleration().max()
    np.testing.assert_allclose(motion.velocity(t), slope, atol=1e-5 * scale)


@given(trajectories())
def test_exact_peaks_are_those_of_dense_sampling(motion):
    spans = np.diff(motion.times)[:, None]
    t = motion.times[:-1, None] + spans * np.linspace(0.0, 1.0, 1001)
    velocity = np.abs(motion.velocity(t.ravel()))
    peak = motion.peak_velocity()
    assert np.all(velocity <= peak + 1e-9)
    # A parabola misses its vertex by at most half a step: a/2 (h/2)^2 with its slope's change a over the segment.
    np.testing.assert_allclose(velocity.max(axis=0), peak, rtol=1e-4, atol=1e-4)
    quotients = np.diff(motion.velocity(t.ravel()).reshape(*t.shape, 3), axis=1) / (spans[:, None] / 1000)
    peak = motion.peak_acceleration()
    assert np.all(np.abs(quotients) <= peak * (1.0 + 1e-6) + 1e-6)
    np.testing.assert_allclose(np.abs(quotients).max(axis=(0, 1)), peak, rtol=2e-3, atol=1e-6)


@given(trajectories())
def test_reversed_is_the_curve_backwards(motion):
    t = np.linspace(0.0, motion.duration, 50)
    back = motion.reversed()
    np.testing.assert_allclose(back.sample(t), motion.sample(motion.duration - t), atol=1e-9)
    np.testing.assert_allclose(back.velocity(t), -motion.velocity(motion.duration - t), atol=1e-9)
    np.testing.assert_allclose(back.reversed().times, motion.times, atol=1e-12)


@given(trajectories(), st.floats(0.1, 10.0))
def test_slowed_is_the_same_curve_in_other_time(motion, factor):
    t = np.linspace(0.0, motion.duration, 50)
    slow = motion.slowed(factor)
    np.testing.assert_allclose(slow.sample(np.minimum(factor * t, slow.duration)), motion.sample(t), atol=1e-8)
    np.testing.assert_allclose(factor * slow.peak_velocity(), motion.peak_velocity(), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(factor**2 * slow.peak_acceleration(), motion.peak_acceleration(), rtol=1e-9, atol=1e-12)


@given(trajectories(fewest=3), st.integers(1, 4))
def test_two_halves_joined_are_the_whole(motion, cut):
    cut = min(cut, len(motion.times) - 2)
    first = Trajectory(NAMES, motion.times[: cut + 1], motion.positions[: cut + 1], motion.velocities[: cut + 1])
    second = Trajectory(NAMES, motion.times[cut:] - motion.times[cut], motion.positions[cut:], motion.velocities[cut:])
    whole = first.then(second)
    np.testing.assert_allclose(whole.times, motion.times, atol=1e-12)
    t = np.linspace(0.0, whole.duration, 50)
    np.testing.assert_allclose(whole.sample(t), motion.sample(np.minimum(t, motion.duration)), atol=1e-8)


@pytest.mark.parametrize("duration", [0.0, 1.5])
def test_a_dwell_stands_still(duration):
    still = Trajectory.dwell(NAMES, [0.1, 0.2, 0.3], duration)
    assert still.duration == duration
    np.testing.assert_array_equal(still.sample([0.0, duration]), [[0.1, 0.2, 0.3]] * 2)
    np.testing.assert_array_equal(still.velocity([0.0, duration]), np.zeros((2, 3)))
    np.testing.assert_array_equal(still.peak_velocity(), np.zeros(3))
    np.testing.assert_array_equal(still.peak_acceleration(), np.zeros(3))
    np.testing.assert_array_equal(still.reversed().times, still.times)


def test_a_dwell_joins_the_motion_it_follows():
    motion = time_path([[0.0, 0.0, 0.0], [1.0, 0.5, -1.0]], NAMES, VELOCITY, ACCELERATION)
    longer = motion.then(Trajectory.dwell(NAMES, motion.positions[-1], 0.5))
    assert longer.duration == pytest.approx(motion.duration + 0.5)
    np.testing.assert_allclose(longer.sample([longer.duration - 0.25]), motion.positions[-1:], atol=1e-12)


def test_what_a_trajectory_holds_does_not_change():
    times = np.array([0.0, 1.0])
    motion = Trajectory(NAMES, times, np.zeros((2, 3)), np.zeros((2, 3)))
    times[1] = 2.0
    assert motion.duration == 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.positions[0, 0] = 1.0


@pytest.mark.parametrize(
    ("times", "positions", "velocities"),
    [
        ([0.0, 1.0, 1.0], np.zeros((3, 3)), np.zeros((3, 3))),
        ([0.0, 1.0, 0.5], np.zeros((3, 3)), np.zeros((3, 3))),
        ([0.5, 1.0], np.zeros((2, 3)), np.zeros((2, 3))),
        ([0.0, np.nan], np.zeros((2, 3)), np.zeros((2, 3))),
        ([], np.zeros((0, 3)), np.zeros((0, 3))),
        ([[0.0, 1.0]], np.zeros((2, 3)), np.zeros((2, 3))),
        ([0.0, 1.0], np.zeros((3, 3)), np.zeros((2, 3))),
        ([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 2))),
        ([0.0, 1.0], np.full((2, 3), np.inf), np.zeros((2, 3))),
        ([0.0, 1.0], [["a", 0.0, 0.0]] * 2, np.zeros((2, 3))),
    ],
)
def test_what_is_no_trajectory_is_refused(times, positions, velocities):
    with pytest.raises(InputError, match="trajectory"):
        Trajectory(NAMES, times, positions, velocities)


def test_times_outside_are_refused():
    motion = Trajectory.dwell(NAMES, np.zeros(3), 1.0)
    for t in ([-0.1], [1.1], [np.nan], 0.5):
        with pytest.raises(InputError, match="time"):
            motion.sample(t)


def test_only_what_starts_at_the_end_follows():
    motion = Trajectory.dwell(NAMES, np.zeros(3), 1.0)
    with pytest.raises(InputError, match="elsewhere"):
        motion.then(Trajectory.dwell(NAMES, np.full(3, 1e-3), 1.0))
    with pytest.raises(InputError, match="elsewhere"):
        motion.then(Trajectory(NAMES, np.zeros(1), np.zeros((1, 3)), np.ones((1, 3))))
    with pytest.raises(InputError, match="joints"):
        motion.then(Trajectory.dwell(NAMES[::-1], np.zeros(3), 1.0))


# Timing


@settings(max_examples=100, deadline=None)
@given(paths(), st.sampled_from([0.0, 1e-4, 0.01, 0.1]))
def test_a_timed_path_keeps_limits_ends_and_the_way_between(path, max_deviation):
    motion = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=max_deviation)
    assert within_limits(motion)
    np.testing.assert_allclose(
        motion.positions[[0, -1]], path[[0, -1]], atol=1e-9 + max_deviation * (len(motion.times) == 1)
    )
    np.testing.assert_array_equal(motion.velocities[[0, -1]], np.zeros((2, 3)))
    spans = np.diff(motion.times)[:, None]
    curve = (
        motion.sample((motion.times[:-1, None] + spans * np.linspace(0.0, 1.0, 9)).ravel()) if len(spans) else path[:1]
    )
    assert distance(curve, path).max() <= max_deviation + 1e-8
    assert distance(path, curve).max() <= 1.02 * max_deviation + 1e-8  # the chords of the curve are a little farther


@settings(max_examples=50, deadline=None)
@given(paths(), st.floats(0.05, 1.0))
def test_the_speed_slows_the_motion_on_the_same_curve(path, speed):
    full = time_path(path, NAMES, VELOCITY, ACCELERATION)
    slow = time_path(path, NAMES, VELOCITY, ACCELERATION, speed=speed)
    assert slow.duration == pytest.approx(full.duration / speed, rel=1e-9)
    assert within_limits(slow, speed)
    np.testing.assert_array_equal(slow.positions, full.positions)


@settings(max_examples=50, deadline=None)
@given(paths())
def test_blends_are_never_slower_than_stopping_at_corners(path):
    stopping = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=0.0).duration
    # The polylines differ by the waypoints left out, at most the deviation.
    blended = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=1e-3).duration
    assert blended <= stopping * (1.0 + 1e-2)


@given(hnp.arrays(float, 3, elements=st.floats(-2.0, 2.0)))
def test_a_straight_motion_takes_the_time_of_the_trapezoid(way):
    way = np.where(np.abs(way) < 1e-3, 0.0, way)
    motion = time_path([np.zeros(3), way], NAMES, VELOCITY, ACCELERATION)
    moving = way != 0.0
    if not moving.any():
        assert motion.duration == 0.0
        return
    top = (VELOCITY[moving] / np.abs(way[moving])).min()
    rise = (ACCELERATION[moving] / np.abs(way[moving])).min()
    expected = 1.0 / top + top / rise if top**2 < rise else 2.0 / np.sqrt(rise)
    assert motion.duration == pytest.approx(expected, rel=1e-5, abs=1e-4)


def test_the_same_input_gives_the_same_motion(rng):
    path = rng.uniform(-1.0, 1.0, (12, 3))
    first, second = (time_path(path, NAMES, VELOCITY, ACCELERATION) for _ in range(2))
    np.testing.assert_array_equal(first.times, second.times)
    np.testing.assert_array_equal(first.velocities, second.velocities)


def test_a_gentle_corner_is_run_through_and_a_sharp_one_costs_more_at_less_deviation():
    corner = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.7, 0.7, 0.0]]
    durations = [
        time_path(corner, NAMES, VELOCITY, ACCELERATION, max_deviation=deviation).duration
        for deviation in (0.1, 0.01, 0.001, 0.0)
    ]
    assert durations == sorted(durations)
    assert durations[0] < 0.9 * durations[-1]


def test_a_corner_is_cut_by_what_is_allowed():
    corner = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    for max_deviation in (1e-3, 1e-2, 1e-1):
        motion = time_path(corner, NAMES, VELOCITY, ACCELERATION, max_deviation=max_deviation)
        cut = distance(corner[1:2], motion.sample(np.linspace(0.0, motion.duration, 20001)))
        assert 0.5 * max_deviation < cut.item() <= max_deviation


@pytest.mark.parametrize("seed", range(4))
def test_densely_sampled_curves_take_about_the_time_of_the_optimum_on_their_spline(seed):
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, 300)
    waves = np.arange(1, 4)
    phases, sizes = rng.uniform(0.0, 6.0, (3, 3)), rng.normal(size=(3, 3)) / waves
    path = (sizes * np.cos(np.pi * waves * s[:, None, None] + phases)).sum(axis=2)
    limits = [toppra.constraint.JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY]))]
    limits.append(toppra.constraint.JointAccelerationConstraint(np.column_stack([-ACCELERATION, ACCELERATION])))
    solver = toppra.algorithm.TOPPRA(
        limits, toppra.SplineInterpolator(s, path), gridpoints=np.linspace(0.0, 1.0, 1001), solver_wrapper="seidel"
    )
    optimum = solver.compute_trajectory(0, 0).duration
    for max_deviation in (1e-4, 1e-3, 1e-2):
        motion = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=max_deviation)
        assert 0.96 * optimum < motion.duration < 1.1 * optimum
        assert within_limits(motion)
    assert len(motion.times) < 200


@pytest.mark.parametrize("path", [[[0.1, 0.2, 0.3]], [[0.1, 0.2, 0.3]] * 5, [[0.1, 0.2, 0.3], [0.1, 0.2, 0.3 + 1e-12]]])
def test_no_motion_takes_no_time(path):
    motion = time_path(path, NAMES, VELOCITY, ACCELERATION)
    assert motion.duration == 0.0
    np.testing.assert_array_equal(motion.sample([0.0]), path[:1])


def test_a_failure_of_toppra_stops_at_the_corners_and_says_so(rng, monkeypatch, caplog):
    path = rng.uniform(-1.0, 1.0, (5, 3))
    monkeypatch.setattr("toppra.algorithm.TOPPRA.compute_parameterization", lambda *_: (None, None, None))
    motion = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=0.05)
    assert "stops at each" in caplog.text
    assert within_limits(motion)
    assert distance(motion.positions, path).max() < 1e-12
    assert motion.duration == time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=0.0).duration


@given(paths(), st.sampled_from([1e-6, 1e-3, 0.1]))
def test_waypoints_left_out_lie_near_those_kept(path, tolerance):
    kept = trajectory._simplified(path, tolerance)
    np.testing.assert_array_equal(kept[[0, -1]], path[[0, -1]])
    assert distance(path, kept).max() <= tolerance


@pytest.mark.parametrize(
    "wrong",
    [
        {"q": [[0.0, 0.0, np.nan]]},
        {"q": [[0.0, 0.0]]},
        {"q": [0.0, 0.0, 0.0]},
        {"q": np.zeros((0, 3))},
        {"q": [["x", 0.0, 0.0]]},
        {"q": [[]], "joint_names": ()},
        {"velocity": [1.0, 0.0, 1.0]},
        {"velocity": [1.0, 1.0]},
        {"velocity": [1.0, np.inf, 1.0]},
        {"acceleration": [1.0, -1.0, 1.0]},
        {"acceleration": 1.0},
        {"speed": 0.0},
        {"speed": 1.1},
        {"speed": np.nan},
        {"max_deviation": -0.1},
        {"max_deviation": np.inf},
        {"max_deviation": np.nan},
    ],
)
def test_wrong_input_is_refused(wrong):
    right = {"q": np.zeros((2, 3)), "joint_names": NAMES, "velocity": VELOCITY, "acceleration": ACCELERATION}
    with pytest.raises(InputError):
        time_path(**(right | wrong))
