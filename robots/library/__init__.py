"""The shipped models: URDF, SRDF and YAML, authored from published figures in primitive shapes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...errors import UnknownNameError
from ...transforms import Array
from ..hand import Hand
from ..robot import Robot

HANDS = ("robotiq_2f85", "hrp5p_three_finger", "suction_cup")
ROBOTS = ("nextage", "ur3_dual", "hrp5p")


def load_hand(name: str) -> Hand:
    """A shipped hand by name.

    Raises:
        UnknownNameError: There is none of that name.
    """
    return Hand.load(_path(name, "hand", HANDS, ".yaml"))


def load_robot(name: str, hands: Mapping[str, str] | None = None, base: Array | None = None) -> Robot:
    """A shipped robot by name, with shipped ``hands`` by arm (as ``{"left": "robotiq_2f85"}``) on its flanges.

    Args:
        name: Name of the robot.
        hands: Name of a shipped hand for each arm that has one.
        base: Pose (4, 4) of the robot's root in the world.

    Raises:
        UnknownNameError: There is no robot, arm or hand of that name.
    """
    urdf = _path(name, "robot", ROBOTS, ".urdf")
    robot = Robot.load(urdf, urdf.with_suffix(".srdf"), urdf.with_name(f"{name}_limits.yaml"), base)
    loaded = {hand: load_hand(hand) for hand in set((hands or {}).values())}
    for arm, hand in (hands or {}).items():
        robot = robot.with_hand(arm, loaded[hand])
    return robot


def _path(name: str, kind: str, known: tuple[str, ...], suffix: str) -> Path:
    if name not in known:
        raise UnknownNameError("library", kind, name, known)
    return Path(__file__).with_name(name + suffix)
