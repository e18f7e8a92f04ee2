"""Quantities with a unit: "2 mm", "20 deg", "50 g"; a bare number is SI."""

from __future__ import annotations

import math
import re

from ..errors import InputError

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": 0.0254},
    "angle": {"rad": 1.0, "deg": math.pi / 180.0},
    "mass": {"kg": 1.0, "g": 1e-3},
    "density": {"kg/m3": 1.0, "g/cm3": 1000.0},
    "force": {"N": 1.0, "kN": 1e3},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
}
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S*)\s*")


def parse_quantity(value: str | float, kind: str, place: str) -> float:
    """A quantity in SI units.

    Args:
        value: A number, which is SI already, or text: a number and a unit.
        kind: One of ``UNITS``.
        place: Where the value stands, for the message.

    Raises:
        InputError: No number, an unknown unit or one of another kind, or a value that is not finite.
    """
    units = UNITS[kind]
    cure = f"write a {kind} such as {_EXAMPLES[kind]!r}; units: {', '.join(units)}"
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise InputError(place, f"{value!r} is no {kind}", cure)
    match = _QUANTITY.fullmatch(value if isinstance(value, str) else repr(value))
    if match is None:
        raise InputError(place, f"{value!r} is no {kind}", cure)
    number, unit = match.groups()
    if unit and unit not in units:
        raise InputError(place, f"{value!r} has no unit of {kind}", cure)
    result = float(number) * units.get(unit, 1.0)
    if not math.isfinite(result):
        raise InputError(place, f"{value!r} is not finite", cure)
    return result


_EXAMPLES = {
    "length": "2 mm",
    "angle": "20 deg",
    "mass": "50 g",
    "density": "2.7 g/cm3",
    "force": "100 N",
    "time": "2 s",
}
