"""A small URDF writer: links of coloured boxes and cylinders, joints, and nothing the shipped models do not use."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree as ET

Vector = Sequence[float]
ORIGIN = (0.0, 0.0, 0.0)
ALONG_X = (0.0, math.pi / 2, 0.0)
ALONG_Y = (-math.pi / 2, 0.0, 0.0)

COLOURS = {
    "white": (0.93, 0.93, 0.92),
    "silver": (0.76, 0.78, 0.80),
    "grey": (0.50, 0.52, 0.54),
    "dark": (0.33, 0.34, 0.36),
    "black": (0.20, 0.20, 0.22),
    "rubber": (0.45, 0.46, 0.47),
    "blue": (0.27, 0.50, 0.71),
    "navy": (0.16, 0.22, 0.34),
    "orange": (0.91, 0.53, 0.20),
}


@dataclass(frozen=True)
class Shape:
    """A primitive or a mesh at a place in its link's frame; ``geometry`` is its URDF tag with attributes."""

    geometry: tuple[str, dict[str, str]]
    colour: str
    xyz: Vector = ORIGIN
    rpy: Vector = ORIGIN


@dataclass(frozen=True)
class Link:
    """A rigid piece: its frame is that of the joint that carries it."""

    name: str
    shapes: Sequence[Shape] = ()


@dataclass(frozen=True)
class Joint:
    """A fixed joint, or a revolute one where an axis is given. Velocity [rad/s] and effort [N m] are limits."""

    name: str
    parent: str
    child: str
    xyz: Vector = ORIGIN
    rpy: Vector = ORIGIN
    axis: Vector | None = None
    limits: tuple[float, float] = (0.0, 0.0)
    velocity: float = 0.0
    effort: float = 100.0
    mimic: tuple[str, float] | None = None


@dataclass
class Robot:
    """What one URDF file holds; ``source`` says where the figures come from."""

    name: str
    source: str
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)

    def add(self, joint: Joint, *shapes: Shape) -> None:
        """Append a joint together with the link it carries."""
        self.joints.append(joint)
        self.links.append(Link(joint.child, shapes))


def box(centre: Vector, size: Vector, colour: str, rpy: Vector = ORIGIN) -> Shape:
    """A box of edge lengths ``size`` [m]."""
    return Shape(("box", {"size": numbers(size)}), colour, centre, rpy)


def span(low: Vector, high: Vector, colour: str) -> Shape:
    """The axis-aligned box between two corners [m], given in any order."""
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    return box(centre, [abs(b - a) for a, b in zip(low, high, strict=True)], colour)


def cylinder(centre: Vector, radius: float, length: float, colour: str, rpy: Vector = ORIGIN) -> Shape:
    """A cylinder about its z axis [m]."""
    return Shape(("cylinder", {"radius": number(radius), "length": number(length)}), colour, centre, rpy)


def bar(start: Vector, end: Vector, thickness: float, y: tuple[float, float], colour: str) -> Shape:
    """A box along the line from ``start`` to ``end``, both (x, z), that reaches from ``y[0]`` to ``y[1]``."""
    dx, dz = end[0] - start[0], end[1] - start[1]
    centre = ((start[0] + end[0]) / 2, (y[0] + y[1]) / 2, (start[1] + end[1]) / 2)
    return box(centre, (thickness, y[1] - y[0], math.hypot(dx, dz)), colour, (0.0, math.atan2(dx, dz), 0.0))


def sphere(centre: Vector, radius: float, colour: str) -> Shape:
    """A ball [m]."""
    return Shape(("sphere", {"radius": number(radius)}), colour, centre)


def mesh(uri: str, colour: str, xyz: Vector = ORIGIN, rpy: Vector = ORIGIN) -> Shape:
    """A mesh file by its package:// address."""
    return Shape(("mesh", {"filename": uri}), colour, xyz, rpy)


def mirrored(shapes: Sequence[Shape], side: float) -> list[Shape]:
    """``shapes`` reflected in the x-z plane where ``side`` is -1; primitives are their own mirror images."""
    return [
        Shape(s.geometry, s.colour, (s.xyz[0], side * s.xyz[1], s.xyz[2]), (side * s.rpy[0], s.rpy[1], side * s.rpy[2]))
        for s in shapes
    ]


def number(value: float) -> str:
    """A number with what matters of its digits, and no negative zero."""
    return f"{round(value, 12) + 0.0:.12g}"


def numbers(values: Vector) -> str:
    """Numbers separated by blanks, as URDF attributes want them."""
    return " ".join(number(value) for value in values)


def _origin(parent: ET.Element, xyz: Vector, rpy: Vector) -> None:
    ET.SubElement(parent, "origin", xyz=numbers(xyz), rpy=numbers(rpy))


def _link(root: ET.Element, link: Link) -> None:
    element = ET.SubElement(root, "link", name=link.name)
    for purpose in ("visual", "collision"):
        for shape in link.shapes:
            body = ET.SubElement(element, purpose)
            _origin(body, shape.xyz, shape.rpy)
            tag, attributes = shape.geometry
            ET.SubElement(ET.SubElement(body, "geometry"), tag, attributes)
            if purpose == "visual":
                ET.SubElement(body, "material", name=shape.colour)


def _joint(root: ET.Element, joint: Joint) -> None:
    kind = "fixed" if joint.axis is None else "revolute"
    element = ET.SubElement(root, "joint", name=joint.name, type=kind)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    _origin(element, joint.xyz, joint.rpy)
    if joint.axis is None:
        return
    ET.SubElement(element, "axis", xyz=numbers(joint.axis))
    low, high = joint.limits
    values = {"lower": low, "upper": high, "velocity": joint.velocity, "effort": joint.effort}
    ET.SubElement(element, "limit", {name: number(value) for name, value in values.items()})
    if joint.mimic is not None:
        ET.SubElement(element, "mimic", joint=joint.mimic[0], multiplier=number(joint.mimic[1]))


def document(root: ET.Element, source: str) -> str:
    """An XML document whose first lines are the comment ``source``."""
    ET.indent(root)
    return f'<?xml version="1.0"?>\n<!-- {source} -->\n{ET.tostring(root, encoding="unicode")}\n'


def to_urdf(robot: Robot) -> str:
    """The text of the URDF file."""
    root = ET.Element("robot", name=robot.name)
    for name, rgb in COLOURS.items():
        if any(shape.colour == name for link in robot.links for shape in link.shapes):
            ET.SubElement(ET.SubElement(root, "material", name=name), "color", rgba=numbers([*rgb, 1.0]))
    for link in robot.links:
        _link(root, link)
    for joint in robot.joints:
        _joint(root, joint)
    return document(root, robot.source)
