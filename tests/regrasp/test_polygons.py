"""Sets of polygons: areas, bounds, turns, and whether two of them overlap, judged by their common area."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from kumitate.regrasp.polygons import Polygons, outline

seeds = st.integers(0, 10**6)
laws = settings(max_examples=40, deadline=None)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def random_polygons(rng: np.random.Generator, count: int) -> list[np.ndarray]:
    return [outline(rng.normal(size=(rng.integers(3, 9), 2))) for _ in range(count)]


def common_depth(a: np.ndarray, b: np.ndarray) -> float:
    """Radius of the largest circle in both polygons, below zero when they are apart (a linear program)."""
    rows, right = [], []
    for polygon in (a, b):
        along = np.roll(polygon, -1, axis=0) - polygon
        out = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
        rows.append(np.column_stack([out, np.ones(len(out))]))
        right.append((out * polygon).sum(axis=1))
    best = linprog([0.0, 0.0, -1.0], np.vstack(rows), np.concatenate(right), bounds=[(None, None)] * 3)
    return float(best.x[2])


@laws
@given(seeds)
def test_polygons_overlap_exactly_where_a_circle_fits_in_both(seed):
    rng = np.random.default_rng(seed)
    listed, other = random_polygons(rng, 4), random_polygons(rng, 1)[0]
    shifts = rng.normal(size=(5, 2)) * 2.0
    apart = Polygons.of(listed).apart(other, shifts)
    assert apart.shape == (4, 5)
    for i, polygon in enumerate(listed):
        for j, shift in enumerate(shifts):
            depth = common_depth(polygon + shift, other)
            assert abs(depth) < 1e-9 or apart[i, j] == (depth < 0.0)


def test_polygons_that_share_an_edge_do_not_overlap():
    found = Polygons.of([SQUARE]).apart(SQUARE, np.array([[1.0, 0.0], [0.99, 0.0], [0.0, -1.0], [0.5, 0.5]]))
    assert found.tolist() == [[True, False, True, False]]


@laws
@given(seeds)
def test_turning_keeps_areas_and_turns_each_corner(seed):
    rng = np.random.default_rng(seed)
    polygons = Polygons.of(random_polygons(rng, 3))
    angles = rng.uniform(-np.pi, np.pi, 4)
    turned = polygons.turned(angles)
    assert len(turned) == 12
    np.testing.assert_allclose(turned.area, np.tile(polygons.area, 4))
    for i, angle in enumerate(angles):
        for k in range(3):
            corners = polygons[k] @ [1.0, 1j] * np.exp(1j * angle)
            np.testing.assert_allclose(turned[3 * i + k] @ [1.0, 1j], corners, atol=1e-12)
            low, high = (bound[3 * i + k] for bound in turned.bounds)
            np.testing.assert_allclose(low, [corners.real.min(), corners.imag.min()], atol=1e-12)
            np.testing.assert_allclose(high, [corners.real.max(), corners.imag.max()], atol=1e-12)


@laws
@given(seeds)
def test_taking_polygons_keeps_them_as_they_are_in_any_order(seed):
    rng = np.random.default_rng(seed)
    listed = random_polygons(rng, 5)
    chosen = rng.integers(0, 5, rng.integers(0, 7))
    taken = Polygons.of(listed).take(chosen)
    assert len(taken) == len(chosen)
    for polygon, i in zip((taken[k] for k in range(len(chosen))), chosen, strict=True):
        np.testing.assert_array_equal(polygon, listed[i])


def test_areas():
    np.testing.assert_allclose(Polygons.of([SQUARE, SQUARE[:3], 2.0 * SQUARE]).area, [1.0, 0.5, 4.0])


def test_an_outline_holds_all_points_counterclockwise(rng):
    points = rng.normal(size=(50, 3))
    around = outline(points)
    along = np.roll(around, -1, axis=0) - around
    offset = points[:, None, :2] - around
    assert (along[:, 0] * offset[..., 1] - along[:, 1] * offset[..., 0] > -1e-12).all()


def test_no_polygons_at_all():
    nothing = Polygons.of([])
    assert len(nothing) == len(nothing.turned(np.zeros(4))) == len(nothing.area) == 0
    assert nothing.apart(SQUARE, np.zeros((3, 2))).shape == (0, 3)
