"""Writes the model files of this folder: ``python -m kumitate.robots.library.make_models``."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pinocchio as pin
import yaml

from ..allowed import disabled_collisions
from .dual_arm import DualArm, joint_limits, to_srdf
from .hands import hrp5p_three_finger, robotiq_2f85, suction_cup
from .hrp5p import hrp5p
from .nextage import nextage
from .ur3_dual import ur3_dual
from .urdf import to_urdf

HANDS = (robotiq_2f85, hrp5p_three_finger, suction_cup)
ROBOTS = (nextage, ur3_dual, hrp5p)
# <prefix>/lib/pythonX.Y/site-packages/pinocchio/: example-robot-data unpacks into the same prefix.
SHARE = Path(pin.__file__).parents[4] / "share"


def hand_files() -> dict[str, str]:
    """Text of every hand file by its name."""
    files = {}
    for make in HANDS:
        hand, description = make()
        files[f"{hand.name}.urdf"] = to_urdf(hand)
        files[f"{hand.name}.yaml"] = yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=120)
    return files


def robot_files() -> dict[str, str]:
    """Text of every robot's URDF and limits by file name."""
    files = {}
    for make in ROBOTS:
        model = make()
        files[f"{model.robot.name}.urdf"] = to_urdf(model.robot)
        files[f"{model.robot.name}_limits.yaml"] = yaml.safe_dump(joint_limits(model), sort_keys=False, width=120)
    return files


def srdf_text(model: DualArm) -> str:
    """Text of a robot's SRDF; the disabled collisions take seconds to sample. Between the arms none is disabled."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.urdf"
        path.write_text(to_urdf(model.robot), encoding="utf-8")
        kinematics = pin.buildModelFromUrdf(str(path))
        geometry = pin.buildGeomFromUrdf(kinematics, str(path), pin.COLLISION, package_dirs=[str(SHARE)])
    pairs = disabled_collisions(kinematics, geometry)
    sides = [{link.split("_")[0] for link in pair[:2]} for pair in pairs]
    return to_srdf(model, [pair for pair, side in zip(pairs, sides, strict=True) if side != {"left", "right"}])


def main() -> None:
    """Write every file."""
    files = hand_files() | robot_files()
    for make in ROBOTS:
        model = make()
        files[f"{model.robot.name}.srdf"] = srdf_text(model)
    for name, text in files.items():
        Path(__file__).with_name(name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
