"""The upper body of an HRP-5P: two arms of nine axes, the first of them in the clavicle."""

from __future__ import annotations

from math import pi, radians

from .dual_arm import SIDES, DualArm, Segment, add_arm, add_flange, mirror_angles
from .urdf import ALONG_X, ALONG_Y, ORIGIN, Link, Robot, Shape, Vector, box, cylinder, sphere

_BODY = [
    cylinder((-0.02, 0, -0.03), 0.120, 0.06, "dark"),
    cylinder((-0.02, 0, 0.06), 0.085, 0.14, "grey"),
    box((-0.03, 0, 0.20), (0.20, 0.26, 0.16), "navy"),
    box((-0.03, 0, 0.40), (0.26, 0.27, 0.26), "silver"),
    box((-0.06, 0, 0.56), (0.22, 0.20, 0.07), "silver"),
    box((0.103, 0, 0.42), (0.012, 0.18, 0.14), "navy"),
    box((-0.20, 0, 0.40), (0.09, 0.22, 0.28), "dark"),
    cylinder((-0.02, 0, 0.63), 0.045, 0.09, "dark"),
    box((-0.01, 0, 0.74), (0.18, 0.15, 0.16), "silver"),
    box((0.082, 0, 0.745), (0.012, 0.13, 0.06), "black"),
    sphere((-0.02, 0, 0.80), 0.07, "silver"),
]


def _axis(joint: str, axis: str, degrees: tuple[float, float], xyz: Vector = ORIGIN, *shapes: Shape) -> Segment:
    limits = (radians(degrees[0]), radians(degrees[1]))
    return Segment(f"{{side}}_{joint}", f"{{side}}_{joint}_link", axis, limits, 1.5, xyz, shapes=shapes)


# Limits of the left arm [deg]: those of the right one, listed by its makers' planner, with x and z reversed.
_SEGMENTS = [
    _axis("clavicle", "z", (-60, 20), (0.032, 0.080, 0.542), box((0, 0.045, 0), (0.075, 0.09, 0.075), "dark")),
    _axis("shoulder_pitch", "y", (-200, 70), (0, 0.130, 0), cylinder((0, 0, 0), 0.060, 0.075, "silver", ALONG_Y)),
    _axis("shoulder_roll", "x", (-25, 95)),
    _axis(
        "shoulder_yaw",
        "z",
        (-120, 92),
        (0, 0.020, 0),
        cylinder((0.005, 0.005, -0.10), 0.042, 0.09, "dark"),
        box((0.018, 0.005, -0.195), (0.095, 0.090, 0.12), "silver"),
    ),
    _axis(
        "elbow",
        "y",
        (-180, -17.2),
        (0.050, 0, -0.295804),
        cylinder((0, 0, 0), 0.040, 0.100, "dark", ALONG_Y),
        box((-0.030, 0, -0.085), (0.085, 0.085, 0.110), "silver"),
    ),
    _axis("forearm_yaw", "z", (-182, 122), (-0.050, 0, -0.295804), cylinder((0, 0, 0.095), 0.036, 0.11, "silver")),
    _axis("wrist_roll", "x", (-70, 47), ORIGIN, cylinder((0, 0, 0), 0.022, 0.070, "dark", ALONG_X)),
    _axis("wrist_pitch", "y", (-42, 42), ORIGIN, box((0, 0.004, -0.026), (0.050, 0.036, 0.034), "grey")),
    Segment(
        "{side}_hand_roll",
        "{side}_hand_roll_link",
        "x",
        (radians(-300), radians(300)),
        1.5,
        (0, -0.007004, -0.067249),
        (-pi / 2, -pi / 4, pi / 2),
        [cylinder((0.008, 0, 0), 0.032, 0.016, "dark", ALONG_X)],
    ),
]
_HOME = [radians(angle) for angle in (0, 45, 50, 45, -150, -45, 0, 0, 0)]


def hrp5p() -> DualArm:
    """HRP-5P's chest and arms in shapes of our own."""
    source = (
        "HRP-5P upper body: kinematics and ranges of the arms as in the published planner model; shapes are our own; "
        "velocities and accelerations are assumed"
    )
    robot = Robot("hrp5p", source, [Link("body", _BODY)])
    home: dict[str, float] = {}
    arms = {}
    for name, side in SIDES:
        joints = add_arm(robot, "body", _SEGMENTS, side)
        home.update(zip(joints, mirror_angles(_SEGMENTS, side, _HOME), strict=True))
        arms[name] = ("body", add_flange(robot, f"{name}_hand_roll_link", side))
    return DualArm(robot, arms, (), home, acceleration=3.0)
