"""Robots: the shipped URDF, SRDF and joint limits, spoiled, through the reader to a scene and its check."""

from __future__ import annotations

import json
from pathlib import Path

import mesh_files
import numpy as np
import yaml
from spoil import NAMES, Rng, one, spoiled_bytes, spoiled_numbers, spoiled_tree, spoiled_xml

from kumitate.robots.library import load_hand
from kumitate.robots.robot import Robot
from kumitate.robots.scene import Scene
from kumitate.tasks.models import LIBRARY
from kumitate.tasks.verify_arms import read_machine
from kumitate.tasks.verify_task import read_task

COUNT = 4000
_ROBOTS = ("nextage", "hrp5p")
_HAND = load_hand("suction_cup")


def make(rng: Rng, folder: Path) -> None:
    """Write the three files of a robot, one or two of them spoiled."""
    name = one(rng, _ROBOTS)
    files = {suffix: (LIBRARY / f"{name}{suffix}").read_text() for suffix in (".urdf", ".srdf", "_limits.yaml")}
    if rng.random() < 0.2:
        files[".urdf"] = _with_mesh(rng, files[".urdf"], folder)
    written = {suffix: text.encode() for suffix, text in files.items()}
    for _ in range(int(rng.integers(1, 3))):
        suffix = one(rng, (".urdf", ".urdf", ".srdf", "_limits.yaml"))
        written[suffix] = spoiled_text(rng, suffix, files[suffix])
    for suffix, content in written.items():
        (folder / f"robot{suffix}").write_bytes(content)
    home = "home" if rng.random() < 0.95 else one(rng, NAMES)
    (folder / "case.json").write_text(json.dumps({"home": home}))


def feed(folder: Path) -> str:
    """Load the robot, give it a hand, and look for collisions at home."""
    home = json.loads((folder / "case.json").read_text())["home"]
    robot = Robot.load(*(folder / f"robot{end}" for end in (".urdf", ".srdf", "_limits.yaml")), home=home)
    robot = robot.with_hand(next(iter(robot.arms)), _HAND)
    scene = Scene.of(robot, [])
    scene.touching(scene.state({}))
    _check_verifier(robot, folder, home)
    return "works"


def _check_verifier(robot: Robot, folder: Path, home: str) -> None:
    """The verifier reads the same robot from the same files."""
    own = {"urdf": "robot.urdf", "srdf": "robot.srdf", "limits": "robot_limits.yaml", "home": home}
    task = {"robot": own, "hands": {}, "parts": {}, "goals": []}
    machine = read_machine(read_task(task), task, folder)
    order = [robot.joint_names.index(name) for name in machine.joint_names]
    limits = np.array([robot.lower, robot.upper, robot.velocity, robot.acceleration])[:, order]
    flanges = machine.flanges(machine.home[None])
    if set(machine.arms) != set(robot.arms) or not np.allclose(machine.limits, limits, atol=1e-9):
        raise AssertionError(f"arms {set(machine.arms)} and {set(robot.arms)}, limits {machine.limits} and {limits}")
    if not np.allclose(machine.home, robot.home[order], atol=1e-9):
        raise AssertionError(f"home {machine.home} and {robot.home[order]}")
    for arm in robot.arms:
        if not np.allclose(flanges[arm][0], robot.flange(arm, robot.home), atol=1e-6):
            raise AssertionError(f"flange {arm} at {flanges[arm][0]} and {robot.flange(arm, robot.home)}")


def spoiled_text(rng: Rng, suffix: str, text: str) -> bytes:
    """A file that ends in ``suffix``, spoiled as what it is: bytes, numbers, YAML or XML."""
    way = rng.random()
    if way < 0.15:
        return spoiled_bytes(rng, text.encode())
    if way < 0.45:
        return spoiled_numbers(rng, text.encode(), odd=0.0)
    if suffix.endswith(".yaml"):
        return yaml.safe_dump(spoiled_tree(rng, yaml.safe_load(text))).encode()
    return spoiled_xml(rng, text).encode(errors="replace")


def _with_mesh(rng: Rng, urdf: str, folder: Path) -> str:
    """``urdf`` with a mesh, perhaps a spoiled one, in place of a box."""
    mesh_files.make(rng, folder)
    name = json.loads((folder / "case.json").read_text())["file"]
    address = one(rng, (name, f"file://{folder / name}", f"package://{folder.name}/{name}", one(rng, NAMES)))
    scale = one(rng, ("1 1 1", "0.001 0.001 0.001", "-1 1 1", "0 1 1", "nan 1 1", "1 1"))
    return urdf.replace("<box ", f'<mesh filename="{_quoted(address)}" scale="{scale}"/><box ', 1)


def _quoted(text: str) -> str:
    return (
        text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;").replace("\0", "").replace("\ud800", "")
    )
