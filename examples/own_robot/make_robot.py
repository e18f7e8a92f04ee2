"""Make the robot of this example: two arms on a pedestal, as a URDF, an SRDF and a joint_limits.yaml.

The arms have the published kinematics and limits of a Franka Emika Panda; their shapes are our own cylinders, spheres
and boxes. Run this to write the three files anew. A robot of your own comes with such files: those of its MoveIt
configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from pathlib import Path
from xml.etree import ElementTree as ET

NAME = "two_arms"
SIDES = {"left": 0.3, "right": -0.3}  # y of the arms' bases [m]
DOFS = range(1, 8)

# Of joints 1 to 7: place in the link before and roll there [m, rad], limits, velocity and acceleration (up to rad/s2).
PLACES = [(0, 0, 0.333), (0, 0, 0), (0, -0.316, 0), (0.0825, 0, 0), (-0.0825, 0.384, 0), (0, 0, 0), (0.088, 0, 0)]
ROLLS = [0, -pi / 2, pi / 2, pi / 2, -pi / 2, pi / 2, pi / 2]
LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
VELOCITY = [2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61]
ACCELERATION = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
EFFORT = [87, 87, 87, 87, 12, 12, 12]
HOME = [0, -pi / 4, 0, -3 * pi / 4, 0, pi / 2, pi / 4]
FLANGE = 0.107  # m beyond joint 7

# Rods along z with round ends, of links 1 to 7: radius, place across (x, y), from where to where [m].
RODS = {
    1: [(0.060, 0, 0, -0.14, 0.00)],
    2: [(0.060, 0, 0, -0.06, 0.06)],
    3: [(0.060, 0, 0, -0.20, -0.06)],
    4: [(0.060, 0, 0, -0.06, 0.06)],
    5: [(0.060, 0, 0, -0.31, -0.21), (0.030, 0, 0.075, -0.20, -0.06)],
    6: [(0.050, 0, 0, -0.07, 0.01)],
    7: [(0.040, 0, 0, -0.06, 0.05)],
}
# Links of one arm, but for neighbours, that cannot touch whatever the joints between them do.
NEVER = [(0, 2), (0, 3), (0, 4), (1, 3), (1, 4), (2, 4), (3, 5), (3, 6), (3, 7), (4, 6), (4, 7), (5, 7)]


def urdf() -> ET.Element:
    """Links and joints."""
    robot = ET.Element("robot", name=NAME)
    add_link(robot, "pedestal", [box((0.35, 0.90, 0.70), (-0.05, 0, -0.35))])
    for side, y in SIDES.items():
        names = [f"{side}_link{i}" for i in range(8)]
        add_link(robot, names[0], [box((0.20, 0.13, 0.10), (-0.04, 0, 0.05)), cylinder(0.06, 0, 0, 0.0, 0.14)])
        add_joint(robot, f"{side}_mount", "pedestal", names[0], (0, y, 0))
        for i in DOFS:
            shapes = [shape for rod in RODS[i] for shape in round_rod(*rod)]
            add_link(robot, names[i], shapes + ([cylinder(0.035, 0, 0, 0.05, FLANGE)] if i == 7 else []))
            joint = add_joint(robot, f"{side}_joint{i}", names[i - 1], names[i], PLACES[i - 1], ROLLS[i - 1])
            joint.set("type", "revolute")
            ET.SubElement(joint, "axis", xyz="0 0 1")
            limits = {"lower": LOWER, "upper": UPPER, "velocity": VELOCITY, "effort": EFFORT}
            ET.SubElement(joint, "limit", {key: number(values[i - 1]) for key, values in limits.items()})
        add_link(robot, f"{side}_flange", [])
        add_joint(robot, f"{side}_flange_joint", names[7], f"{side}_flange", (0, 0, FLANGE))
    return robot


def srdf() -> ET.Element:
    """The arms as chains, their home, and the pairs of links that need no check."""
    robot = ET.Element("robot", name=NAME)
    for side in SIDES:
        group = ET.SubElement(robot, "group", name=f"{side}_arm")
        ET.SubElement(group, "chain", base_link=f"{side}_link0", tip_link=f"{side}_flange")
    for side in SIDES:
        state = ET.SubElement(robot, "group_state", name="home", group=f"{side}_arm")
        for i in DOFS:
            ET.SubElement(state, "joint", name=f"{side}_joint{i}", value=number(HOME[i - 1]))
    pairs = [("left_link0", "right_link0", "Never")]
    for side in SIDES:
        pairs += [("pedestal", f"{side}_link0", "Adjacent"), ("pedestal", f"{side}_link1", "Never")]
        pairs += [(f"{side}_link{i - 1}", f"{side}_link{i}", "Adjacent") for i in DOFS]
        pairs += [(f"{side}_link{i}", f"{side}_link{j}", "Never") for i, j in NEVER]
    for first, second, reason in pairs:
        ET.SubElement(robot, "disable_collisions", link1=first, link2=second, reason=reason)
    return robot


def joint_limits() -> str:
    """Velocities and accelerations."""
    lines = ["joint_limits:"]
    for side in SIDES:
        for i in DOFS:
            lines += [
                f"  {side}_joint{i}:",
                "    has_velocity_limits: true",
                f"    max_velocity: {VELOCITY[i - 1]}",
                "    has_acceleration_limits: true",
                f"    max_acceleration: {ACCELERATION[i - 1]}",
            ]
    return "\n".join(lines) + "\n"


def round_rod(radius: float, x: float, y: float, low: float, high: float) -> list[ET.Element]:
    """A rod along z, with balls at its ends."""
    return [cylinder(radius, x, y, low, high), *(shape("sphere", (x, y, z), radius=radius) for z in (low, high))]


def cylinder(radius: float, x: float, y: float, low: float, high: float) -> ET.Element:
    """A cylinder along z."""
    return shape("cylinder", (x, y, (low + high) / 2.0), radius=radius, length=high - low)


def box(size: Sequence[float], middle: Sequence[float]) -> ET.Element:
    """A box."""
    return shape("box", middle, size=size)


def shape(kind: str, middle: Sequence[float], **figures: float | Sequence[float]) -> ET.Element:
    """What a link looks like and collides with."""
    element = ET.Element("shape")
    ET.SubElement(element, "origin", xyz=number(middle))
    ET.SubElement(ET.SubElement(element, "geometry"), kind, {key: number(value) for key, value in figures.items()})
    return element


def add_link(robot: ET.Element, name: str, shapes: Sequence[ET.Element]) -> None:
    """Append a link with its shapes."""
    link = ET.SubElement(robot, "link", name=name)
    for use in ("visual", "collision"):
        for element in shapes:
            ET.SubElement(link, use).extend(element)


def add_joint(
    robot: ET.Element, name: str, parent: str, child: str, place: Sequence[float], roll: float = 0.0
) -> ET.Element:
    """Append a joint, fixed as yet."""
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=number(place), rpy=number((roll, 0, 0)))
    return joint


def number(values: float | Sequence[float]) -> str:
    """One number or several, as XML has them."""
    return " ".join(f"{value:.10g}" for value in (values if isinstance(values, Sequence) else [values]))


def write(folder: Path) -> None:
    """Write the three files."""
    for make in (urdf, srdf):
        root = make()
        ET.indent(root)
        (folder / f"{NAME}.{make.__name__}").write_text(ET.tostring(root, encoding="unicode") + "\n")
    (folder / "joint_limits.yaml").write_text(joint_limits())


if __name__ == "__main__":
    write(Path(__file__).parent)
