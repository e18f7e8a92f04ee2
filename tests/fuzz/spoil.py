"""Ways to spoil files of any kind: their bytes, the numbers in their text, trees of values, trees of XML."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np

Rng = np.random.Generator
Thing = TypeVar("Thing")
Tree = Any  # mappings, lists, and what stands in them

NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1e308",
    "1e999",
    "1e-320",
    "-0.0",
    "0",
    "-1",
    "1e5",
    "1e-5",
    "1e20",
    "9" * 40,
)
NAMES = (
    "",
    " ",
    "x",
    "a" * 5000,
    "../../../etc/passwd",
    "/etc/passwd",
    "/dev/zero",
    "C:\\windows\\win.ini",
    "file:///etc/passwd",
    "package://none/none.stl",
    "../" * 40,
    "a\0b",
    "\ud800",
    "\u202eevil",
    "ünï/çø∂é 組み立て",
    "</script><script>alert(1)</script>",
    "\"'><img src=x onerror=alert(1)>",
    "{0.__class__}",
    "%s%n",
    "world",
    "left",
    "block",
    "*",
)
VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    2**31,
    2**63,
    10**40,
    10**400,
    0.5,
    -0.0,
    1e-320,
    1e308,
    float("nan"),
    float("inf"),
    [],
    {},
    [[]],
    [0, 0, 0],
    {"": None},
    [1e300] * 3,
)
_NUMBER = re.compile(rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_DEEP = 100_000


def one(rng: Rng, things: Sequence[Thing]) -> Thing:
    """One of ``things``."""
    return things[int(rng.integers(len(things)))]


def nudged(rng: Rng, number: float) -> float:
    """``number`` changed a little or a lot."""
    ways: tuple[Callable[[], float], ...] = (
        lambda: number * (1.0 + 10.0 ** rng.uniform(-6.0, 1.0)),
        lambda: number + rng.normal() * 10.0 ** rng.uniform(-6.0, 2.0),
        lambda: -number,
        lambda: 0.0,
        lambda: number * 1000.0,
    )
    return float(one(rng, ways)())


def spoiled_bytes(rng: Rng, data: bytes) -> bytes:
    """``data`` cut, doubled, flipped, overwritten, or with other numbers in its text."""
    if not data:
        return rng.bytes(int(rng.integers(1, 100)))
    start, end = np.sort(rng.integers(0, len(data) + 1, 2)).tolist()
    end = min(end, start + int(2 ** rng.uniform(0, 12)))
    ways: tuple[Callable[[], bytes], ...] = (
        lambda: data[:start],
        lambda: data[:start] + data[end:],
        lambda: data[:end] + data[start:],
        lambda: data[:start] + rng.bytes(end - start) + data[end:],
        lambda: data[:start] + one(rng, (b"\0", b"\xff", b"9", b"\n")) * (end - start) + data[end:],
        lambda: data[:start] + data[start:end] * int(rng.integers(2, 50)) + data[end:],
        lambda: data[:start] + one(rng, (b"[", b"{", b"(", b"<a>", b"- ")) * _DEEP + data[start:],
        lambda: _flipped(rng, data),
        lambda: spoiled_numbers(rng, data),
        lambda: spoiled_numbers(rng, data),
    )
    return one(rng, ways)()


def spoiled_numbers(rng: Rng, text: bytes, odd: float = 0.4) -> bytes:
    """``text`` with one to three of its numbers written otherwise, a share ``odd`` of them as no other number near."""
    places = list(_NUMBER.finditer(text))
    for _ in range(min(int(rng.integers(1, 4)), len(places))):
        place = one(rng, places)
        written = one(rng, NUMBERS) if rng.random() < odd else repr(nudged(rng, float(place[0][:30])))
        text = text[: place.start()] + written.encode() + text[place.end() :]
        places = list(_NUMBER.finditer(text))
    return text


def _flipped(rng: Rng, data: bytes) -> bytes:
    flipped = bytearray(data)
    for place in rng.integers(0, 8 * len(data), int(rng.integers(1, 20))).tolist():
        flipped[place // 8] ^= 1 << place % 8
    return bytes(flipped)


def spoiled_tree(rng: Rng, tree: Tree, more: Sequence[Any] = ()) -> Tree:
    """A copy of ``tree`` with an entry left out, doubled, renamed, swapped, nested or of another value.

    Args:
        rng: Random numbers.
        tree: Mappings and lists.
        more: Values that may stand in the wrong place.
    """
    tree = _copied(tree)
    holder, key = tree, None
    while True:  # a walk from the root, which ends early now and then
        entry = holder if key is None else holder[key]
        if not isinstance(entry, dict | list) or not entry or (key is not None and rng.random() < 0.2):
            break
        holder, key = entry, one(rng, list(entry) if isinstance(entry, dict) else range(len(entry)))
    if key is None:
        return one(rng, (*VALUES, *more))
    value = holder[key]
    ways: list[Callable[[], object]] = [
        lambda: holder.__delitem__(key),
        lambda: holder.__setitem__(key, one(rng, VALUES)),
        lambda: holder.__setitem__(key, one(rng, NAMES)),
        lambda: holder.__setitem__(key, one(rng, more) if more else None),
        lambda: _swapped(rng, holder, key),
        lambda: _doubled(rng, holder, key),
        lambda: holder.__setitem__(key, [value]),
        lambda: holder.__setitem__(key, nested(value)),
    ]
    if isinstance(value, float | int) and not isinstance(value, bool) and abs(value) < 1e300:
        ways += 4 * [lambda: holder.__setitem__(key, nudged(rng, value))]
    if isinstance(value, str):
        ways += 2 * [lambda: holder.__setitem__(key, value + one(rng, NAMES))]
        ways += [lambda: holder.__setitem__(key, spoiled_numbers(rng, value.encode()).decode())]
    one(rng, ways)()
    return tree


def nested(value: Any, depth: int = 100) -> Any:
    """``value`` in as many lists."""
    for _ in range(depth):
        value = [value]
    return value


def _copied(tree: Tree) -> Tree:
    if isinstance(tree, dict):
        return {key: _copied(entry) for key, entry in tree.items()}
    return [_copied(entry) for entry in tree] if isinstance(tree, list | tuple) else tree


def _swapped(rng: Rng, holder: Tree, key: Any) -> None:
    other = one(rng, list(holder) if isinstance(holder, dict) else range(len(holder)))
    holder[key], holder[other] = holder[other], holder[key]


def _doubled(rng: Rng, holder: Tree, key: Any) -> None:
    """Once more: in a list beside itself, in a mapping under another name, and then perhaps under its own no more."""
    if isinstance(holder, list):
        holder[key:key] = [holder[key]] * int(2 ** rng.uniform(0, 6))
    else:
        holder[one(rng, NAMES)] = holder.pop(key) if rng.random() < 0.5 else holder[key]


def spoiled_xml(rng: Rng, text: str) -> str:
    """XML ``text`` with elements and attributes left out, doubled, renamed, moved, or of other values."""
    root = ElementTree.fromstring(text)
    for _ in range(int(rng.integers(1, 4))):
        _spoil_element(rng, root)
    for element in root.iter():  # characters that XML has no way to write
        element.attrib = {_written(key): _written(value) for key, value in element.attrib.items()}
    written = ElementTree.tostring(root, encoding="unicode")
    if rng.random() < 0.02:
        place = one(rng, [found.start() for found in re.finditer("<(?!/)", written)][1:] or [0])
        written = written[:place] + _DEEP * "<a>" + _DEEP * "</a>" + written[place:]
    return written


def _spoil_element(rng: Rng, root: ElementTree.Element) -> None:
    parents = [element for element in root.iter() if len(element)]
    if not parents:
        return
    parent = one(rng, parents)
    child = one(rng, list(parent))
    ways: list[Callable[[], object]] = [
        lambda: parent.remove(child),
        lambda: parent.append(deepcopy(child)),
        lambda: parent.extend(deepcopy(child) for _ in range(int(2 ** rng.uniform(0, 9)))),
        lambda: one(rng, parents).append(deepcopy(child)),
        lambda: setattr(child, "tag", one(rng, [element.tag for element in root.iter()])),
        lambda: setattr(child, "text", one(rng, ("x", "0", "1e308", "&<"))),
        child.clear,
    ]
    holders = [element for element in root.iter() if element.attrib]
    if holders:
        ways += 12 * [lambda: _spoil_attribute(rng, one(rng, holders), holders)]
    one(rng, ways)()


def _spoil_attribute(rng: Rng, element: ElementTree.Element, others: Sequence[ElementTree.Element]) -> None:
    key = one(rng, list(element.attrib))
    value = element.attrib[key]
    like = [other.attrib[key] for other in others if key in other.attrib]
    ways: tuple[Callable[[], object], ...] = (
        lambda: element.attrib.pop(key),
        lambda: element.set(key, one(rng, NAMES)),
        lambda: element.set(key, one(rng, NUMBERS)),
        lambda: element.set(key, one(rng, like)),
        lambda: element.set(key, one(rng, like)),
        lambda: element.set(one(rng, list(one(rng, others).attrib)), element.attrib.pop(key)),
        lambda: element.set(key, spoiled_numbers(rng, value.encode()).decode()),
        lambda: element.set(key, spoiled_numbers(rng, value.encode()).decode()),
        lambda: element.set(key, f"{value} {value}"),
    )
    one(rng, ways)()


def _written(text: str) -> str:
    return re.sub("[\0\ud800-\udfff]", "?", text)
