"""Reading SRDF files, the part of a MoveIt configuration that names arms, home states and pairs that never collide."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from ..errors import InputError
from .files import parse_xml, read_text


@dataclass(frozen=True)
class Group:
    """A group of the SRDF: the joints it lists, or the chain between two links.

    Attributes:
        name: Its name.
        joints: Joints that it lists one by one.
        chain: Base and tip link, if it is a chain.
    """

    name: str
    joints: tuple[str, ...]
    chain: tuple[str, str] | None


@dataclass(frozen=True)
class Srdf:
    """What Kumitate uses of an SRDF.

    Attributes:
        path: The file.
        groups: Groups in the file's order.
        states: State name -> joint name -> position; states of the same name in several groups are one.
        disabled: Pairs of links whose collisions are not checked.
    """

    path: Path
    groups: tuple[Group, ...]
    states: dict[str, dict[str, float]]
    disabled: tuple[tuple[str, str], ...]


def read_srdf(path: str | Path) -> Srdf:
    """Parse an SRDF file.

    Raises:
        InputError: The file is missing, no XML, or an element lacks an attribute or holds a wrong number.
    """
    path = Path(path)
    root = parse_xml(path, read_text(path, "SRDF"))
    states: dict[str, dict[str, float]] = {}
    for state in root.iter("group_state"):
        joints = states.setdefault(_attribute(path, state, "name"), {})
        for joint in state.findall("joint"):
            joints[_attribute(path, joint, "name")] = _number(path, joint, "value")
    return Srdf(
        path=path,
        groups=tuple(_group(path, group) for group in root.findall("group") if len(group)),
        states=states,
        disabled=tuple(
            (_attribute(path, pair, "link1"), _attribute(path, pair, "link2"))
            for pair in root.iter("disable_collisions")
        ),
    )


def _group(path: Path, element: ElementTree.Element) -> Group:
    chain = element.find("chain")
    ends = (_attribute(path, chain, "base_link"), _attribute(path, chain, "tip_link")) if chain is not None else None
    joints = tuple(_attribute(path, joint, "name") for joint in element.findall("joint"))
    return Group(_attribute(path, element, "name"), joints, ends)


def _attribute(path: Path, element: ElementTree.Element, name: str) -> str:
    value = element.get(name)
    if not value:
        raise InputError(path, f"a <{element.tag}> has no {name!r}", f"add {name}=...")
    return value


def _number(path: Path, element: ElementTree.Element, name: str) -> float:
    text = _attribute(path, element, name)
    try:
        return float(text.split()[0])
    except (ValueError, IndexError) as error:
        raise InputError(path, f"<{element.tag}> has {name}={text!r}", "give a number") from error
