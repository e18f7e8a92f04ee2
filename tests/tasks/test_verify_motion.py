"""Curves as the verifier reads them, against scipy's and against dense samples."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from kumitate.tasks.verify_motion import Curve


@pytest.fixture
def curve(rng):
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 0.5, 9))])
    return Curve(times, rng.normal(size=(10, 4)), rng.normal(size=(10, 4)))


def test_it_is_the_cubic_hermite_curve(curve, rng):
    other = CubicHermiteSpline(curve.times, curve.values, curve.rates)
    times = np.concatenate([curve.times, rng.uniform(0.0, curve.times[-1], 200)])
    np.testing.assert_allclose(curve.at(times), other(times), atol=1e-12)


def test_peaks_are_exact(curve):
    other = CubicHermiteSpline(curve.times, curve.values, curve.rates)
    dense = np.linspace(0.0, curve.times[-1], 200_001)
    sampled = other(dense).min(axis=0), other(dense).max(axis=0), np.abs(other(dense, 1)).max(axis=0)
    low, high, fast, hard = curve.peaks()
    for (value, _), reached in zip((low, high, fast), sampled, strict=True):
        np.testing.assert_allclose(value, reached, rtol=1e-5, atol=1e-7)
    assert (low[0] <= sampled[0]).all()
    assert (high[0] >= sampled[1]).all()
    assert (hard[0] >= np.abs(other(dense, 2)).max(axis=0)).all()
    np.testing.assert_allclose(hard[0], np.abs(other(dense, 2)).max(axis=0), rtol=1e-2)
    for order, sign, (value, when) in ((0, 1, low), (0, 1, high), (1, -1, fast)):
        there = other(when, order)[np.arange(4), np.arange(4)]
        np.testing.assert_allclose(value, there if sign > 0 else np.abs(there), atol=1e-9)


def test_no_column_turns_back_between_its_stops(curve):
    knots = np.unique(np.concatenate([curve.times, curve.stops.ravel()]))
    for start, end in itertools.pairwise(knots):
        if end - start > 1e-6:
            steps = np.diff(curve.at(np.linspace(start, end, 20)), axis=0)
            assert ((steps >= -1e-9).all(axis=0) | (steps <= 1e-9).all(axis=0)).all()


def test_a_curve_of_one_sample_stands_still():
    curve = Curve(np.zeros(1), np.array([[1.0, -2.0]]), np.zeros((1, 2)))
    np.testing.assert_array_equal(curve.at(np.zeros(2)), [[1.0, -2.0]] * 2)
    assert not curve.moving(0.0, 0.0).any()
    low, high, fast, hard = (value for value, _ in curve.peaks())
    np.testing.assert_array_equal([low, high], [[1.0, -2.0]] * 2)
    assert not fast.any()
    assert not hard.any()


def test_what_moves_is_told_for_each_stretch():
    values = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    rates = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    curve = Curve(np.array([0.0, 1.0, 2.0]), values, rates)
    assert curve.moving(0.0, 1.0).tolist() == [True, False, False]
    assert curve.moving(1.0, 2.0).tolist() == [False, False, True]
    assert curve.moving(0.5, 2.0).tolist() == [True, False, True]
