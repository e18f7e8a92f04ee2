"""The files of the robot and the hands that a task names, and their digests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import yaml

from ..errors import InputError

LIBRARY = Path(__file__).resolve().parent.parent / "robots" / "library"
_HAND_FILES = (".yaml", ".yml")
_LARGEST, _LARGEST_YAML = 64 * 2**20, 2**19  # bytes


@dataclass(frozen=True, eq=False)
class HandFiles:
    """A hand.

    Attributes:
        name: How the task calls its YAML file.
        yaml: That file.
        urdf: Its URDF.
        content: What the YAML says.
    """

    name: str
    yaml: Path
    urdf: Path
    content: Mapping[str, Any]


@dataclass(frozen=True)
class ModelFiles:
    """Where a task's models are.

    Attributes:
        urdf: URDF of the robot.
        srdf: SRDF of the robot.
        limits: Its joint_limits.yaml, if there is one.
        packages: Folders in which ``package://`` addresses are looked up.
        hands: The hands, by arm.
    """

    urdf: Path
    srdf: Path
    limits: Path | None
    packages: tuple[Path, ...]
    hands: Mapping[str, HandFiles]


def model_files(task: Mapping[str, Any], folder: str | Path) -> ModelFiles:
    """The files of the robot and the hands of ``task``: shipped ones, or the user's own relative to ``folder``.

    Args:
        task: The task as a plan document has it.
        folder: Where its relative paths start.

    Raises:
        InputError: There is no such shipped robot or hand, or the YAML of a hand names no URDF.
    """
    folder, robot = Path(folder), task["robot"]
    names = {arm: hand["hand"] if isinstance(hand, Mapping) else hand for arm, hand in task["hands"].items()}
    read = {name: _hand_files(name, folder) for name in sorted(set(names.values()))}
    hands = {arm: read[name] for arm, name in names.items()}
    if isinstance(robot, Mapping):
        limits = robot.get("limits")
        return ModelFiles(
            urdf=folder / robot["urdf"],
            srdf=folder / robot["srdf"],
            limits=folder / limits if limits else None,
            packages=tuple(folder / package for package in robot.get("packages", ())),
            hands=hands,
        )
    urdf = _shipped(robot, ".urdf", "robot")
    return ModelFiles(urdf, urdf.with_suffix(".srdf"), urdf.with_name(f"{robot}_limits.yaml"), (), hands)


def model_digests(task: Mapping[str, Any], folder: str | Path) -> dict[str, str]:
    """SHA-256 of the files of the robot and the hands of ``task``, under names such as ``robot/nextage.urdf``.

    A hand of the user's own is named by the path that the task gives, as are robots by the names of their files.

    Args:
        task: The task as a plan document has it.
        folder: Where its relative paths start.

    Raises:
        InputError: A file is missing or cannot be read.
    """
    files = model_files(task, folder)
    named = {f"robot/{path.name}": path for path in (files.urdf, files.srdf, files.limits) if path is not None}
    for hand in files.hands.values():
        at = Path(hand.name)
        named[f"hand/{at.as_posix()}"] = hand.yaml
        named[f"hand/{at.with_name(hand.urdf.name).as_posix()}"] = hand.urdf
    return {name: sha256(read_bytes(path)).hexdigest() for name, path in sorted(named.items())}


def read_bytes(path: Path) -> bytes:
    """The contents of a file.

    Raises:
        InputError: It is missing, no plain file, too large, or cannot be read.
    """
    try:
        if path.exists() and not (path.is_file() and path.stat().st_size <= _LARGEST):
            problem = f"cannot be read: it is a folder, a device, or larger than {_LARGEST} bytes"
            raise InputError(path, problem, "give a plain file")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a name that no file can have is a ValueError
        raise InputError(path, f"cannot be read ({error})", "put the file where the task says") from error


def read_yaml(path: Path) -> dict[Any, Any]:
    """The mapping in a YAML file.

    Raises:
        InputError: The file cannot be read, is too large, or has none.
    """
    try:
        text = read_bytes(path)
        if len(text) > _LARGEST_YAML:
            raise InputError(path, f"larger than {_LARGEST_YAML} bytes", "give the YAML file that the task means")
        content = yaml.safe_load(text)
    except InputError:
        raise
    except Exception as error:  # what reads tagged values raises whatever it meets in them
        raise InputError(path, f"no YAML ({error})", "mend the file there") from error
    if not isinstance(content, dict):
        raise InputError(path, "no mapping", "give the YAML file that the task means")
    return content


def _hand_files(hand: str, folder: Path) -> HandFiles:
    if hand.endswith(_HAND_FILES):
        name, path = hand, folder / hand
    else:
        path = _shipped(hand, ".yaml", "hand")
        name = path.name
    content = read_yaml(path)
    urdf = content.get("urdf")
    if not isinstance(urdf, str) or not urdf:
        raise InputError(path, "names no URDF", "give the hand's URDF as urdf: NAME.urdf")
    return HandFiles(name, path, path.parent / urdf, content)


def _shipped(name: str, suffix: str, kind: str) -> Path:
    path = LIBRARY / f"{name}{suffix}"
    if path not in LIBRARY.iterdir():
        raise InputError("library", f"there is no {kind} named {name!r}", f"give a shipped {kind} or files of your own")
    return path
