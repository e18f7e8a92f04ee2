"""What a shipped robot's files are written from, and the mirrored arms that two of them have."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi
from typing import Any
from xml.etree import ElementTree as ET

from .urdf import ORIGIN, Joint, Robot, Shape, Vector, document, mirrored, number

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
SIDES = (("left", 1.0), ("right", -1.0))


@dataclass(frozen=True)
class Segment:
    """A joint and the link that it carries, on the left arm.

    Attributes:
        joint: Name of the joint, ``{side}`` or ``{S}`` standing for the side or its initial.
        link: Name of the link, likewise.
        axis: ``x``, ``y`` or ``z`` of the joint frame.
        limits: Joint limits [rad] of the left arm.
        velocity: Velocity limit [rad/s], or one for each arm (left, right).
        xyz: Place of the joint frame in the previous one [m].
        rpy: Its orientation there [rad].
        shapes: Shapes of the link.
    """

    joint: str
    link: str
    axis: str
    limits: tuple[float, float]
    velocity: float | tuple[float, float]
    xyz: Vector = ORIGIN
    rpy: Vector = ORIGIN
    shapes: Sequence[Shape] = ()


@dataclass(frozen=True)
class DualArm:
    """A robot with the groups, home state and limits that its URDF cannot hold.

    Attributes:
        robot: Links and joints.
        arms: Base and tip link of each arm's chain.
        torso: Joints that belong to no arm.
        home: Every joint's value in the home state [rad].
        acceleration: Acceleration limit of every joint [rad/s^2].
    """

    robot: Robot
    arms: Mapping[str, tuple[str, str]]
    torso: Sequence[str]
    home: Mapping[str, float]
    acceleration: float


def mirror_angles(segments: Sequence[Segment], side: float, angles: Sequence[float]) -> list[float]:
    """The left arm's ``angles`` on the arm of ``side``: reflection in the x-z plane reverses turns about x and z."""
    return [a if s.axis == "y" else side * a for s, a in zip(segments, angles, strict=True)]


def add_arm(robot: Robot, base: str, segments: Sequence[Segment], side: float) -> list[str]:
    """Append the arm of ``side`` (1 left, -1 right) to ``base``; answers with the names of its joints."""
    name, index = ("left", 0) if side > 0 else ("right", 1)
    words = {"side": name, "S": name[0].upper()}
    parent, joints = base, []
    for segment in segments:
        x, y, z = segment.xyz
        roll, pitch, yaw = segment.rpy
        low, high = segment.limits
        reversed_axis = side < 0 and segment.axis != "y"
        joint, link = segment.joint.format(**words), segment.link.format(**words)
        rate = segment.velocity if isinstance(segment.velocity, float) else segment.velocity[index]
        robot.add(
            Joint(
                joint,
                parent,
                link,
                (x, side * y, z),
                (side * roll, pitch, side * yaw),
                AXES[segment.axis],
                (-high, -low) if reversed_axis else (low, high),
                rate,
            ),
            *mirrored(segment.shapes, side),
        )
        parent = link
        joints.append(joint)
    return joints


def add_flange(robot: Robot, parent: str, side: float, xyz: Vector = ORIGIN) -> str:
    """Append the frame that carries a hand along -x of ``parent``; it closes along y, mirrored between the arms."""
    link = f"{'left' if side > 0 else 'right'}_flange"
    robot.add(Joint(f"{link}_joint", parent, link, xyz, (-side * pi / 2, 0.0, side * pi / 2)))
    return link


def to_srdf(model: DualArm, disabled: Sequence[tuple[str, str, str]]) -> str:
    """The text of the SRDF file: the groups left, right, torso and all, the state home, disabled collisions."""
    root = ET.Element("robot", name=model.robot.name)
    for arm, (base, tip) in model.arms.items():
        ET.SubElement(ET.SubElement(root, "group", name=arm), "chain", base_link=base, tip_link=tip)
    for group, joints in (("torso", model.torso), ("all", model.home)):
        if joints:
            element = ET.SubElement(root, "group", name=group)
            for joint in joints:
                ET.SubElement(element, "joint", name=joint)
    state = ET.SubElement(root, "group_state", name="home", group="all")
    for joint, value in model.home.items():
        ET.SubElement(state, "joint", name=joint, value=number(value))
    for first, second, reason in disabled:
        ET.SubElement(root, "disable_collisions", link1=first, link2=second, reason=reason)
    return document(root, model.robot.source)


def joint_limits(model: DualArm) -> dict[str, Any]:
    """The limits of every moving joint as MoveIt's joint_limits.yaml holds them."""
    moving = [joint for joint in model.robot.joints if joint.axis is not None]
    return {
        "joint_limits": {
            joint.name: {
                "has_velocity_limits": True,
                "max_velocity": joint.velocity,
                "has_acceleration_limits": True,
                "max_acceleration": model.acceleration,
            }
            for joint in moving
        }
    }
