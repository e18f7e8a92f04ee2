"""The shipped models: URDF, SRDF and YAML, authored from published figures in primitive shapes."""

from __future__ import annotations

from pathlib import Path

from ...errors import UnknownNameError
from ..hand import Hand

HANDS = ("robotiq_2f85", "hrp5p_three_finger", "suction_cup")
ROBOTS = ("nextage", "ur3_dual", "hrp5p")


def load_hand(name: str) -> Hand:
    """A shipped hand by name.

    Raises:
        UnknownNameError: There is none of that name.
    """
    return Hand.load(_path(name, "hand", HANDS, ".yaml"))


def _path(name: str, kind: str, known: tuple[str, ...], suffix: str) -> Path:
    if name not in known:
        raise UnknownNameError("library", kind, name, known)
    return Path(__file__).with_name(name + suffix)
