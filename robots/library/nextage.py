"""Nextage: a one-axis chest, a two-axis head, two six-axis arms."""

from __future__ import annotations

from math import cos, radians, sin

from .dual_arm import AXES, SIDES, DualArm, Segment, add_arm, add_flange, mirror_angles
from .urdf import ALONG_Y, ORIGIN, Joint, Link, Robot, Vector, bar, box, cylinder, span

_WAIST = [
    box((-0.183, 0, -0.658), (0.587, 0.588, 0.624), "silver"),
    box((-0.184, -0.015, -0.253), (0.568, 0.399, 0.187), "white"),
    cylinder((0, 0, 0.100), 0.063, 0.260, "dark"),
]
_SHOULDER_TILT = radians(15.0)
# The arms swing past the chest within millimetres: its waist is narrow, and its shoulders carry the arms on tilted
# discs about the first joints' axes.
_CHEST = [
    cylinder((0, 0, 0.245), 0.064, 0.031, "dark"),
    span((-0.134, -0.0805, 0.260), (0.073, 0.0805, 0.310), "silver"),
    span((-0.1415, -0.088, 0.310), (0.073, 0.088, 0.357), "silver"),
    span((-0.187, -0.106, 0.357), (0.068, 0.106, 0.405), "white"),
    span((-0.187, -0.1165, 0.405), (0.068, 0.1165, 0.554), "white"),
    span((0.068, -0.095, 0.361), (0.085, 0.095, 0.539), "white"),
    span((-0.032, -0.185, 0.495), (0.0445, 0.185, 0.506), "dark"),
    span((-0.0255, -0.2226, 0.495), (0.037, 0.2226, 0.506), "dark"),
    span((-0.025, -0.200, 0.506), (0.0365, 0.200, 0.523), "grey"),
    span((-0.028, -0.168, 0.523), (0.0365, 0.168, 0.537), "grey"),
    span((-0.0613, -0.107, 0.262), (0.0525, 0.107, 0.334), "dark"),
    *(
        cylinder(
            (0, side * (0.145 - 0.079 * sin(_SHOULDER_TILT)), 0.370296 - 0.079 * cos(_SHOULDER_TILT)),
            0.0365,
            0.078,
            "white",
            (-side * _SHOULDER_TILT, 0, 0),
        )
        for side in (1.0, -1.0)
    ),
]
_HEAD_PAN = [box((-0.012, 0.007, -0.002), (0.083, 0.072, 0.051), "dark")]
_HEAD_TILT = [
    box((-0.010, 0.007, 0.023), (0.127, 0.153, 0.085), "dark"),
    box((-0.035, 0, 0.127), (0.238, 0.218, 0.123), "white"),
    span((0.084, -0.090, 0.095), (0.086, 0.090, 0.160), "black"),
]
_ARM = [
    [box((0, 0, -0.015), (0.074, 0.080, 0.092), "dark"), box((-0.001, 0.007, 0.063), (0.087, 0.094, 0.064), "silver")],
    [
        cylinder((0, 0.0985, 0), 0.0365, 0.117, "dark", ALONG_Y),
        bar((-0.002, -0.010), (-0.039, -0.190), 0.079, (0.0595, 0.1335), "dark"),
        bar((-0.001, 0.000), (-0.033, -0.120), 0.055, (0.1335, 0.157), "white"),
        span((-0.058, 0.1335, -0.235), (-0.012, 0.1895, -0.118), "white"),
        span((-0.074, 0.058, -0.235), (-0.020, 0.1335, -0.170), "dark"),
        span((-0.056, 0.060, -0.264), (0.000, 0.1335, -0.225), "dark"),
        cylinder((0, 0.1238, -0.25), 0.0385, 0.1316, "white", ALONG_Y),
    ],
    [
        box((-0.029, 0.021, -0.093), (0.080, 0.125, 0.120), "silver"),
        box((-0.014, -0.004, 0.001), (0.098, 0.074, 0.067), "dark"),
    ],
    [
        box((-0.003, 0.013, -0.214), (0.054, 0.100, 0.088), "white"),
        box((0, 0.006, -0.155), (0.072, 0.084, 0.030), "dark"),
    ],
    [
        box((-0.004, 0.009, -0.077), (0.074, 0.072, 0.079), "white"),
        box((-0.008, 0.034, -0.006), (0.065, 0.075, 0.061), "silver"),
    ],
    [box((0.019, 0, 0), (0.038, 0.044, 0.044), "dark"), box((-0.033, 0.004, -0.032), (0.065, 0.067, 0.124), "grey")],
]
_TORSO = ("CHEST_JOINT0", "HEAD_JOINT0", "HEAD_JOINT1")


def _axis(
    i: int, xyz: Vector, axis: str, limits: tuple[float, float], velocity: float | tuple[float, float]
) -> Segment:
    tilt = (-_SHOULDER_TILT, 0.0, 0.0) if i == 0 else ORIGIN
    return Segment(f"{{S}}ARM_JOINT{i}", f"{{side}}_link{i}", axis, limits, velocity, xyz, tilt, _ARM[i])


_SEGMENTS = [
    _axis(0, (0, 0.145, 0.370296), "z", (-1.53589, 1.53589), 3.002),
    _axis(1, ORIGIN, "y", (-2.44346, 1.0472), 2.321),
    _axis(2, (0, 0.095, -0.25), "y", (-2.75762, 0.0), (3.997, 3.752)),
    _axis(3, (-0.03, 0, 0), "z", (-1.8326, 2.87979), 4.608),
    _axis(4, (0, 0, -0.235), "y", (-1.74533, 1.74533), 3.910),
    _axis(5, (-0.047, 0, -0.09), "x", (-2.84489, 2.84489), 5.236),
]
_HOME = [radians(angle) for angle in (15.0, 0.0, -143.0, 0.0, 0.0, 0.0)]


def nextage() -> DualArm:
    """Nextage Open with bare tool changers; a hand sits 53 mm along the roll axis from the last joint's origin."""
    source = (
        "Nextage Open: kinematics, limits and outlines of the links as in its published description; the waist stands "
        "0.97 m above the floor; accelerations are assumed"
    )
    robot = Robot("nextage", source, [Link("waist", _WAIST)])
    chest, pan, tilt = _TORSO
    robot.add(Joint(chest, "waist", "chest", axis=AXES["z"], limits=(-2.84489, 2.84489), velocity=1.920), *_CHEST)
    robot.add(
        Joint(pan, "chest", "head_pan", (0, 0, 0.5695), axis=AXES["z"], limits=(-1.22173, 1.22173), velocity=2.618),
        *_HEAD_PAN,
    )
    robot.add(
        Joint(tilt, "head_pan", "head_tilt", axis=AXES["y"], limits=(-0.349066, 1.22173), velocity=4.363), *_HEAD_TILT
    )
    home = dict.fromkeys(_TORSO, 0.0)
    arms = {}
    for name, side in SIDES:
        joints = add_arm(robot, "chest", _SEGMENTS, side)
        home.update(zip(joints, mirror_angles(_SEGMENTS, side, _HOME), strict=True))
        arms[name] = ("chest", add_flange(robot, f"{name}_link5", side, (-0.053, 0, 0)))
    return DualArm(robot, arms, _TORSO, home, acceleration=5.0)
