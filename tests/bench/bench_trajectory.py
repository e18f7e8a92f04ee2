# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""Timing: ``python tests/bench/bench_trajectory.py`` prints Markdown tables (median CPU times, one thread)."""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import time

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

from kumitate.robots.trajectory import Trajectory, time_path
from kumitate.transforms import Array

RUNS = 7
PATHS = 20
JOINTS = 12
NAMES = [f"joint_{i}" for i in range(JOINTS)]
VELOCITY = np.tile([2.2, 2.2, 3.1, 4.2, 4.2, 6.3], 2)
ACCELERATION = 4.0 * VELOCITY
DEVIATIONS = (0.001, 0.01, 0.02, 0.05, 0.1)


def scattered(rng: np.random.Generator, k: int) -> Array:
    """Waypoints anywhere: corners of a right angle and more."""
    return rng.uniform(-1.5, 1.5, (k, JOINTS))


def drifting(rng: np.random.Generator, k: int) -> Array:
    """Waypoints that go on more than they turn, as a shortened path does."""
    return np.cumsum(rng.uniform(-1.0, 1.0, JOINTS) + rng.uniform(-0.5, 0.5, (k, JOINTS)), axis=0)


def smooth(rng: np.random.Generator, k: int) -> Array:
    """A curve sampled at k points, as the joints on a straight motion of the hand."""
    waves = np.arange(1, 4)
    phases, sizes = rng.uniform(0.0, 6.0, (2, JOINTS, 3))
    s = np.linspace(0.0, 1.0, k)[:, None, None]
    return 0.1 * ((sizes - 3.0) / waves * np.cos(np.pi * waves * s + phases)).sum(axis=2)


def spline_optimum(path: Array) -> tuple[float, Array]:
    """Duration of TOPP-RA on the cubic spline through the waypoints, and points (m, n) of the spline."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    spline = toppra.SplineInterpolator(s / s[-1], path)
    limits = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-ACCELERATION, ACCELERATION])),
    ]
    grid = np.linspace(0.0, 1.0, 50 * len(path))
    solver = toppra.algorithm.TOPPRA(limits, spline, gridpoints=grid, solver_wrapper="seidel")
    return float(solver.compute_trajectory(0, 0).duration), spline(grid)


def farthest(points: Array, polyline: Array) -> float:
    """The largest joint difference between any of ``points`` (m, n) and the polyline (k, n)."""
    nearest = np.full(len(points), np.inf)
    for start, way in zip(polyline[:-1], np.diff(polyline, axis=0), strict=True):
        along = np.clip((points - start) @ way / max(way @ way, 1e-300), 0.0, 1.0)
        nearest = np.minimum(nearest, np.abs(points - start - along[:, None] * way).max(axis=1))
    return float(nearest.max())


def excess(motion: Trajectory) -> float:
    """What the motion exceeds the limits by, in percent; not above 0 is within."""
    used = max((motion.peak_velocity() / VELOCITY).max(), (motion.peak_acceleration() / ACCELERATION).max())
    return 100.0 * (float(used) - 1.0)


def timed(path: Array, max_deviation: float) -> tuple[Trajectory, float]:
    """The motion, and the median CPU time it takes to find [ms]."""
    spent = []
    for _ in range(RUNS):
        start = time.process_time()
        motion = time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=max_deviation)
        spent.append(1e3 * (time.process_time() - start))
    return motion, float(np.median(spent))


def cost_table() -> None:
    print(f"12 joints, medians of {RUNS} runs, over 5 paths\n")
    print("| path | waypoints | max_deviation | CPU ms | slowest path | motion s | samples | excess % | deviation |")
    print("|---|---|---|---|---|---|---|---|---|")
    cases = [(scattered, 10, 0.02), (scattered, 50, 0.02), (drifting, 50, 0.02)]
    cases += [(smooth, k, deviation) for k in (70, 600, 5000) for deviation in (1e-2, 1e-3, 1e-4)]
    for kind, k, max_deviation in cases:
        rows = []
        for seed in range(5):
            path = kind(np.random.default_rng(seed), k)
            motion, spent = timed(path, max_deviation)
            curve = motion.sample(np.linspace(0.0, motion.duration, 2000))
            rows.append([spent, motion.duration, len(motion.times), excess(motion), farthest(curve, path)])
        spent, duration, samples, over, deviation = np.array(rows).T
        print(
            f"| {kind.__name__} | {k} | {max_deviation:g} | {np.median(spent):.1f} | {spent.max():.1f} "
            f"| {np.median(duration):.2f} | {np.median(samples):.0f} | {over.max():.3f} | {deviation.max():.2g} |"
        )


def duration_table() -> None:
    print(f"\nMotion time as a share of stopping at every corner (trapezoids), means of {PATHS} paths\n")
    columns = " | ".join(f"{deviation:g}" for deviation in DEVIATIONS)
    print(f"| path | waypoints | stopping s | {columns} | TOPP-RA on a spline | its deviation |")
    print("|---|---|---|" + "---|" * (len(DEVIATIONS) + 2))
    for kind in (scattered, drifting):
        for k in (3, 5, 10):
            rows = []
            for seed in range(PATHS):
                path = kind(np.random.default_rng(seed), k)
                stopping, *blended = (
                    time_path(path, NAMES, VELOCITY, ACCELERATION, max_deviation=deviation).duration
                    for deviation in (0.0, *DEVIATIONS)
                )
                optimum, curve = spline_optimum(path)
                shares = np.array([*blended, optimum]) / stopping
                rows.append([stopping, *shares, farthest(curve, path)])
            stopping, *shares, deviation = np.mean(rows, axis=0)
            told = " | ".join(f"{share:.3f}" for share in shares)
            print(f"| {kind.__name__} | {k} | {stopping:.2f} | {told} | {deviation:.2f} |")


if __name__ == "__main__":
    time_path(np.eye(3, JOINTS), NAMES, VELOCITY, ACCELERATION)  # loads what is loaded once
    cost_table()
    duration_table()
