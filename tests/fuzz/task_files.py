"""Task files: those of the examples, spoiled, through the reader to the cell, and now and then to a plan."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import yaml
from spoil import NAMES, Rng, one, spoiled_bytes, spoiled_tree

from kumitate.tasks.cell import build_cell
from kumitate.tasks.planner import plan
from kumitate.tasks.task_file import read_task, task_of, task_to_builtins

COUNT = 4000
_EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
_PLANNED = 0.02  # of the tasks
_TIME_LIMIT = 2.0  # s
_FILES = ("wheel_support/task.yaml", "wheel_support/two_wheels.yaml", "flip/one_arm.yaml", "drill/task.yaml")
_TASKS: tuple[Any, ...] = tuple(yaml.safe_load((_EXAMPLES / name).read_text()) for name in _FILES)
_QUANTITIES = ("2 mm", "20 deg", "50 g", "2.7 g/cm3", "1e400 mm", "-5 m", "3 furlongs", "mm", "1,5 mm", "0 rad", ".inf")
_TEXTS = ("!!bool x", "!!timestamp x", "!!int ''", "!!python/name:os.system", "&a [*a]", "*a", "on", "~", "1:30", "0b1")


def make(rng: Rng, folder: Path) -> None:
    """Write a task file beside the parts of the examples, spoiled in up to three places."""
    (folder / "parts").symlink_to(_EXAMPLES / "parts")
    (folder / "task").mkdir()
    data = one(rng, _TASKS)
    others = [*_QUANTITIES, *_subtrees(one(rng, _TASKS)), *_subtrees(data)]
    for _ in range(int(rng.integers(0, 4))):
        data = spoiled_tree(rng, data, others)
    text = yaml.safe_dump(data, default_flow_style=one(rng, (None, True, False)), allow_unicode=bool(rng.integers(2)))
    content = text.encode(errors="replace")
    if rng.random() < 0.15:
        content = spoiled_bytes(rng, content)
    if rng.random() < 0.15:
        content = content.replace(one(rng, content.split()), one(rng, (*NAMES, *_TEXTS)).encode(errors="replace"), 1)
    (folder / "task" / "task.yaml").write_bytes(content)
    (folder / "case.json").write_text(json.dumps({"planned": rng.random() < _PLANNED}))


def feed(folder: Path) -> str:
    """Read the task, see that it survives being written, and build its cell; plan it if that is asked for."""
    os.environ["KUMITATE_CACHE"] = str(folder / "cache")
    path = folder / "task" / "task.yaml"
    task = read_task(path)
    if task_of(json.loads(json.dumps(task_to_builtins(task)))) != task:
        raise AssertionError("the task is another one once it is written and read")
    build_cell(task, path.parent)
    if json.loads((folder / "case.json").read_text())["planned"]:
        plan(task, path.parent, time_limit=_TIME_LIMIT).save(folder / "plan.json")
    return "works"


def _subtrees(tree: Any) -> list[Any]:
    below = list(tree.values()) if isinstance(tree, dict) else tree if isinstance(tree, list) else []
    return [*below, *(found for entry in below for found in _subtrees(entry))]
