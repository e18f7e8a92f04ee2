"""Writes the model files of this folder: ``python -m kumitate.robots.library.make_models``."""

from __future__ import annotations

from pathlib import Path

import yaml

from .hands import hrp5p_three_finger, robotiq_2f85, suction_cup
from .urdf import to_urdf

HANDS = (robotiq_2f85, hrp5p_three_finger, suction_cup)


def hand_files() -> dict[str, str]:
    """Text of every hand file by its name."""
    files = {}
    for make in HANDS:
        hand, description = make()
        files[f"{hand.name}.urdf"] = to_urdf(hand)
        files[f"{hand.name}.yaml"] = yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=120)
    return files


def main() -> None:
    """Write every file."""
    for name, text in hand_files().items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
