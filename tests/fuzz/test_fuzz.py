"""Some hundreds of spoiled files of every kind, and tasks of any fields and values: an error of ours, or it works."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import msgspec
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from spoil import NAMES, spoiled_tree

from kumitate.errors import InputError
from kumitate.tasks.task import Angle, Density, Length, Mass, Task
from kumitate.tasks.task_file import read_task, task_of, task_to_builtins

RUN = Path(__file__).with_name("run.py")
COUNT = 50  # of each kind


KINDS = ["meshes", "robots", "hands", "grasps", "plans", "tasks"]


def test_what_is_damaged_is_refused_and_harms_nothing(tmp_path):
    command = [sys.executable, str(RUN), "--count", str(COUNT), "--seed", "6", "--kind", *KINDS]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    rows = [line.strip("| ").split(" | ") for line in ended.stdout.splitlines() if line.startswith("| ")][1:]
    assert [name for name, *_ in rows] == KINDS
    for _, inputs, works, faults, refused, *_ in rows:
        assert int(inputs) == COUNT
        assert int(works) + int(faults) > 0
        assert int(refused) > 0


def values(kind: Any) -> st.SearchStrategy[Any]:
    """What may stand in a task file where ``kind`` is expected."""
    if kind in _PLAIN:
        return _PLAIN[kind]
    if isinstance(kind, type):
        return _records(kind)
    origin, options = get_origin(kind), get_args(kind)
    if origin is Literal:
        return st.sampled_from(options)
    if origin is dict:
        return st.dictionaries(_WORDS, values(options[1]), max_size=3)
    if origin is tuple:
        many = options[-1] is ...
        return st.lists(values(options[0]), max_size=3) if many else st.tuples(*map(values, options)).map(list)
    return st.one_of(*map(values, options))


def _records(kind: type[msgspec.Struct]) -> st.SearchStrategy[dict[str, Any]]:
    hints, fields = get_type_hints(kind), msgspec.structs.fields(kind)
    needed = {field.name: values(hints[field.name]) for field in fields if field.required}
    return st.fixed_dictionaries(
        needed, optional={field.name: values(hints[field.name]) for field in fields if not field.required}
    )


def _quantities(*units: str) -> st.SearchStrategy[Any]:
    number = st.floats(-10.0, 10.0)
    return number | st.builds("{} {}".format, number, st.sampled_from((*units, "", "furlong")))


_WORDS = st.text() | st.sampled_from(
    ("left", "right", "block", "table", "nextage", "robotiq_2f85", "tip", "a.stl", *(set(NAMES) - {"\ud800"}))
)
_PLAIN: Mapping[Any, st.SearchStrategy[Any]] = {
    str: _WORDS,
    bool: st.booleans(),
    int: st.integers(),
    float: st.floats(),
    type(None): st.none(),
    Length: _quantities("m", "mm"),
    Angle: _quantities("rad", "deg"),
    Mass: _quantities("kg", "g"),
    Density: _quantities("kg/m3", "g/cm3"),
}


def spoiled(task: Any, seed: int | None) -> Any:
    return task if seed is None else spoiled_tree(np.random.default_rng(seed), task)


TASKS = st.builds(spoiled, values(Task), st.none() | st.integers(0, 2**32 - 1))


@settings(max_examples=300, deadline=None)
@given(data=TASKS.filter(lambda data: r"\ud800" not in repr(data)))  # half a character: files alone may have it
def test_any_task_is_read_as_it_is_or_refused(data):
    with contextlib.suppress(InputError):
        task = task_of(data)
        assert task_of(task_to_builtins(task)) == task


@settings(max_examples=100, deadline=None)
@given(data=TASKS, flow=st.sampled_from((None, True, False)))
def test_any_task_file_is_refused_with_its_place_as_its_parts_are_missing(tmp_path_factory, data, flow):
    path = tmp_path_factory.mktemp("task") / "task.yaml"
    path.write_bytes(yaml.safe_dump(data, default_flow_style=flow).encode())
    if isinstance(data, dict) and data.get("parts"):
        with pytest.raises(InputError) as refused:
            read_task(path)
        assert refused.value.place.startswith(str(path))
    else:
        with contextlib.suppress(InputError):
            read_task(path)
