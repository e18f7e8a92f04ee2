"""What simulation measured: checked, chosen and joined row by row, and no part of what the cache keeps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from kumitate.errors import InputError
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.measured import Measured
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.store import cached_grasps

FIELDS = ("tried", "shift", "turn", "slip", "held")


def measured(n, seed=0):
    """Of n grasps four fifths or so were tried, and half of those held."""
    rng = np.random.default_rng(seed)
    tried = rng.random(n) < 0.8
    shift, turn, slip = rng.random((3, n)) * tried
    return Measured(tried, shift, turn, slip, tried & (rng.random(n) < 0.5))


def rows(some):
    return list(zip(*(getattr(some, name).tolist() for name in FIELDS), strict=True))


def test_rows_are_chosen_and_joined_whole():
    one, other = measured(20), measured(7, seed=1)
    assert rows(one.joined(other)) == rows(one) + rows(other)
    mask = one.slip > 0.3
    assert rows(one.take(mask)) == rows(one.take(np.flatnonzero(mask))) == [row for row in rows(one) if row[3] > 0.3]
    assert rows(one.take(slice(2, None, 3))) == rows(one)[2::3]
    assert len(one.take(slice(0))) == 0
    assert rows(one.take(slice(0)).joined(other)) == rows(other)


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        measured(3).held[0] = True


@pytest.mark.parametrize("name", FIELDS)
def test_an_array_of_another_length_or_kind_is_refused(name):
    some = measured(5)
    array = getattr(some, name)
    for wrong in (array[:-1], array[None], array.astype(int), array.astype(complex), array.tolist(), array[0]):
        with pytest.raises(InputError) as caught:
            replace(some, **{name: wrong})
        assert caught.value.place.startswith("measured: ")


@pytest.mark.parametrize("name", ["shift", "turn", "slip"])
@pytest.mark.parametrize("value", [-1e-3, np.nan, np.inf])
def test_lengths_and_angles_are_finite_and_not_negative(name, value):
    some = Measured(np.ones(4, dtype=bool), *np.zeros((3, 4)), np.ones(4, dtype=bool))
    with pytest.raises(InputError, match=f"measured: {name}: a number is negative or not finite"):
        replace(some, **{name: np.array([0.0, 0.1, value, 0.0])})


@pytest.mark.parametrize("name", ["shift", "turn", "slip", "held"])
def test_nothing_is_told_of_what_was_not_tried(name):
    some = measured(20)
    told = getattr(some, name).copy()
    told[~some.tried] = True
    with pytest.raises(InputError, match=f"measured: {name}: told of a grasp that was not tried"):
        replace(some, **{name: told})


def test_an_entry_of_the_cache_that_claims_measures_is_planned_again(block, gripper, tmp_path):
    coarse = GraspParameters(t_rnn=1e-2, n_da=2)
    planned = cached_grasps(block, gripper, coarse, tmp_path)
    (path,) = tmp_path.iterdir()
    entry = GraspSet.load(path)
    assert planned.measured is entry.measured is None
    replace(entry, measured=measured(len(entry))).save(path)
    assert cached_grasps(block, gripper, coarse, tmp_path).measured is None
    assert GraspSet.load(path).measured is None
