"""Quantities: units of the right kind, bare numbers SI, and a message with place and cure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kumitate.errors import InputError
from kumitate.tasks.quantities import UNITS, parse_quantity


@pytest.mark.parametrize(
    ("text", "kind", "wanted"),
    [
        ("2 mm", "length", 0.002),
        ("2mm", "length", 0.002),
        (" -1.5e1 cm ", "length", -0.15),
        (".5 in", "length", 0.0127),
        ("0.3", "length", 0.3),
        (0.3, "length", 0.3),
        (3, "length", 3.0),
        ("20 deg", "angle", math.radians(20)),
        ("1 rad", "angle", 1.0),
        ("50 g", "mass", 0.05),
        ("2.7 g/cm3", "density", 2700.0),
        ("100 N", "force", 100.0),
        ("500 ms", "time", 0.5),
    ],
)
def test_reads(text, kind, wanted):
    assert math.isclose(parse_quantity(text, kind, "x"), wanted)


@pytest.mark.parametrize(
    "text", ["", "mm", "2 kg", "2 MM", "2 mm mm", "1,5 mm", "nan", "inf", "1e999", "0x10", "--1", True, None, [1]]
)
def test_refuses_with_place_and_cure(text):
    with pytest.raises(InputError, match=r"--h-max: .*; write a length such as '2 mm'"):
        parse_quantity(text, "length", "--h-max")


@given(value=st.floats(-1e6, 1e6), kind=st.sampled_from(sorted(UNITS)), data=st.data())
def test_every_unit_scales(value, kind, data):
    unit = data.draw(st.sampled_from(sorted(UNITS[kind])))
    assert math.isclose(parse_quantity(f"{value!r} {unit}", kind, "x"), value * UNITS[kind][unit], abs_tol=1e-300)
