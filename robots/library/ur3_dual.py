"""Two UR3 that hang outward and down from a column; their meshes come from example-robot-data."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi, remainder

from .dual_arm import AXES, SIDES, DualArm
from .urdf import ORIGIN, Joint, Link, Robot, Vector, box, cylinder, mesh

_MESHES = "package://example-robot-data/robots/ur_description/meshes/ur3/collision"
_QUARTER = 1.57079632679  # as in the maker's file, so that both give the same poses
_BODY = [
    box((0.18, 0, 0.105), (1.22, 0.82, 0.21), "dark"),
    box((0, 0, 0.4445), (0.642, 0.642, 0.469), "silver"),
    box((0, 0, 0.8895), (0.10, 0.10, 1.359), "grey"),
    box((0, 0, 1.619), (0.20, 0.55, 0.10), "grey"),
    *(box((0, y, 1.669), (0.20, 0.058, 0.042), "dark") for y in (0.3, -0.3)),
]
# Joint, link, mesh, colour, place in the previous link, its rpy, axis, velocity [rad/s].
_SEGMENTS: list[tuple[str, str, str, str, Vector, Vector, str, float]] = [
    ("shoulder_pan", "shoulder", "shoulder", "blue", (0, 0, 0.1519), ORIGIN, "z", 2.16),
    ("shoulder_lift", "upper_arm", "upperarm", "silver", (0, 0.1198, 0), (0, _QUARTER, 0), "y", 2.16),
    ("elbow", "forearm", "forearm", "silver", (0, -0.0925, 0.24365), ORIGIN, "y", 3.15),
    ("wrist_1", "wrist_1", "wrist1", "blue", (0, 0, 0.21325), (0, _QUARTER, 0), "y", 3.2),
    ("wrist_2", "wrist_2", "wrist2", "blue", (0, 0.08505, 0), ORIGIN, "z", 3.2),
    ("wrist_3", "wrist_3", "wrist3", "grey", (0, 0, 0.08535), ORIGIN, "y", 3.2),
]
_COUPLING = 0.0484
# Hands point straight down at (0.3, +-0.3, 1.25), closing along x; of the eight branches the one nearest to most grasps
# from above.
_HOME = (0.5071, -2.2525, -2.2206, -0.6908, -2.2374, -0.6655)


def _mirrored(angles: Sequence[float]) -> list[float]:
    """The right arm's angles that put its hand at the mirror image of the left one; the arms are both alike."""
    q1, q2, q3, q4, q5, q6 = angles
    return [-q1, remainder(pi - q2, 2 * pi), -q3, remainder(pi - q4, 2 * pi), -q5, -q6]


def ur3_dual() -> DualArm:
    """Two UR3 with a force sensor and a coupling on each flange."""
    source = (
        "Two UR3: arms as in example-robot-data (its meshes by reference), mounts and body as in the published cell of "
        "two UR3; joint ranges of one turn instead of two; accelerations are assumed"
    )
    robot = Robot("ur3_dual", source, [Link("body", _BODY)])
    home = {}
    arms = {}
    for (name, side), yaw in zip(SIDES, (pi, 0.0), strict=True):
        base = f"{name}_base_link"
        robot.add(
            Joint(f"{name}_mount", "body", base, (0, side * 0.258485, 1.610515), (0.75 * pi, 0, yaw)),
            mesh(f"{_MESHES}/base.stl", "grey"),
        )
        parent = base
        angles = _HOME if side > 0 else _mirrored(_HOME)
        for (joint, link, file, colour, xyz, rpy, axis, rate), angle in zip(_SEGMENTS, angles, strict=True):
            child = f"{name}_{link}_link"
            robot.add(
                Joint(f"{name}_{joint}_joint", parent, child, xyz, rpy, AXES[axis], (-pi, pi), rate),
                mesh(f"{_MESHES}/{file}.stl", colour),
            )
            home[f"{name}_{joint}_joint"] = angle
            parent = child
        robot.add(
            Joint(f"{name}_tool0_joint", parent, f"{name}_tool0", (0, 0.0819, 0), (-_QUARTER, 0, 0)),
            cylinder((0, 0, _COUPLING / 2), 0.0375, _COUPLING, "dark"),
        )
        robot.add(Joint(f"{name}_flange_joint", f"{name}_tool0", f"{name}_flange", (0, 0, _COUPLING), (0, 0, pi / 2)))
        arms[name] = (base, f"{name}_flange")
    return DualArm(robot, arms, (), home, acceleration=5.0)
