"""What the tests of tasks share: the main job of the examples, and a cache of grasps of their own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from plans import MESHES, TASK

from kumitate.tasks.cell import Cell, build_cell
from kumitate.tasks.document import Plan
from kumitate.tasks.planner import plan
from kumitate.tasks.task import Task
from kumitate.tasks.task_file import read_task, task_of


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache of grasps that starts empty."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("KUMITATE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def wheel_folder() -> Path:
    """Folder of the main job: a wheel onto the axle of a support."""
    return Path(__file__).resolve().parents[2] / "examples" / "wheel_support"


@pytest.fixture(scope="session")
def wheel_task(wheel_folder: Path) -> Task:
    """The main job."""
    return read_task(wheel_folder / "task.yaml")


@pytest.fixture(scope="session")
def wheel_cell(wheel_task: Task, wheel_folder: Path) -> Cell:
    """Its cell."""
    return build_cell(wheel_task, wheel_folder)


@pytest.fixture(scope="session")
def wheel_plan(wheel_task: Task, wheel_folder: Path) -> Plan:
    """A plan for it."""
    return plan(wheel_task, wheel_folder, seed=3)


@pytest.fixture(scope="session")
def block_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the meshes of a block, a peg and a tube."""
    folder = tmp_path_factory.mktemp("block")
    for name, make in MESHES.items():
        make().export(folder / f"{name}.stl")
    return folder


@pytest.fixture(scope="session")
def block_task() -> Task:
    """A block to give to the right hand and to put down, and a peg to push into a tube."""
    return task_of(TASK)


@pytest.fixture(scope="session")
def block_cell(block_task: Task, block_folder: Path) -> Cell:
    """Its cell."""
    return build_cell(block_task, block_folder)
