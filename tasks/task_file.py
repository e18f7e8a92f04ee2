"""Reading task files: typed, and what is wrong is told with file, line, field and cure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import reduce
from operator import getitem
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import yaml

from ..errors import InputError
from ..robots.files import read_text
from .quantities import UNITS, parse_quantity
from .task import Record, Task
from .task_checks import Keys, Mistake, mistakes, nearest

_LARGEST = 2**18  # characters
_PLAIN = {"Expected ": "expected ", "Invalid enum value": "there is no", "object": "mapping", "array": "list", "`": ""}
# A step in the paths that msgspec writes, such as $.goals[0].attach and $.parts[...].mesh.
_STEP = re.compile(r"\[(\d+|\.\.\.)\]|\.([^.\[`]+)")
# Half a character: what an escape may stand for, and bytes in names of files that are no UTF-8; no file can hold it.
_HALF = re.compile("[\ud800-\udfff]")


def read_task(path: str | Path) -> Task:
    """Read a task file.

    Raises:
        InputError: The file is missing, no YAML, or what it says is no sound task; with file, line, field and cure.
    """
    path = Path(path)
    root, data = _parsed(path)
    if _HALF.search(str(path.parent.resolve())):
        raise InputError(
            path, "the name of its folder is no UTF-8, and a plan must tell it", "name the folder otherwise"
        )

    def place(keys: Keys) -> str:
        return f"{path}:{_line(root, keys)}: {_field(keys)}"

    return _checked(_converted(data, place), path.parent, place)


def task_of(data: Mapping[str, Any]) -> Task:
    """The task that `task_to_builtins` wrote, such as a plan document's; its files are not looked for.

    Raises:
        InputError: It is no sound task; with field and cure.
    """
    return _checked(_converted(data, _field), None, _field)


def checked_task(task: Task, folder: str | Path | None = None) -> Task:
    """``task``, such as one built in code, if it is sound.

    Args:
        task: The task.
        folder: Where its relative paths start; its files must be there. Without it they are not looked for.

    Raises:
        InputError: What it says does not fit together; with field and cure.
    """
    return _checked(task, None if folder is None else Path(folder), _field)


def task_to_builtins(task: Task) -> dict[str, Any]:
    """``task`` as dictionaries, lists, text and plain numbers (SI), as JSON has them."""
    builtins: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(task, enc_hook=float))
    return builtins


def in_file(error: InputError, path: str | Path) -> InputError:
    """``error`` with file and line, if it is about a field of the task at ``path``; else as it is.

    Whoever loads what a task speaks of knows the field that is wrong, but no file.
    """
    keys = tuple(name or int(index) for index, name in _STEP.findall(f".{error.place}"))
    if not keys or keys[0] not in Task.__struct_fields__:
        return error
    root, _ = _parsed(Path(path))
    return InputError(f"{path}:{_line(root, keys)}: {error.place}", error.problem, error.cure)


def task_schema() -> dict[str, Any]:
    """JSON Schema of the task file."""

    def quantity(kind: type) -> dict[str, Any]:
        units = "|".join(UNITS[kind.__name__.lower()])
        pattern = rf"^\s*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?\s*({units})?\s*$"
        return {"type": ["number", "string"], "pattern": pattern, "description": kind.__doc__}

    return msgspec.json.schema(Task, schema_hook=quantity)


class _Loader(yaml.SafeLoader):
    """YAML of mappings with text keys, lists and plain scalars: no aliases, no tags, no merges, no key twice."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            raise _yaml_error(event.start_mark, f"it uses a YAML alias (*{event.anchor})", "write the values out")
        if getattr(event, "tag", None) is not None:
            raise _yaml_error(event.start_mark, f"it uses a YAML tag ({event.tag})", "write the plain value")
        if _HALF.search(getattr(event, "value", "")):
            raise _yaml_error(event.start_mark, "an escape stands for half a character", "write the character itself")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.tag != "tag:yaml.org,2002:str":
                shown = key.value if isinstance(key, yaml.ScalarNode) else key.id
                raise _yaml_error(key.start_mark, f"the key {shown!r} is no text in YAML", "put it in quotes")
            if key.value in seen:
                raise _yaml_error(key.start_mark, f"the key {key.value!r} is there twice", "keep one of them")
            seen.add(key.value)
        return super().construct_mapping(node, deep)


# Only true and false are truth values, as in YAML 1.2; on (a field), off, yes and no are text.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:bool" or first in "tTfF"]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def _yaml_error(mark: Any, problem: str, cure: str) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark, note=cure)


def _parsed(path: Path) -> tuple[yaml.Node | None, Any]:
    """The YAML of a file, as nodes (which know their lines) and as Python's values."""
    text = read_text(path, "task")
    if len(text) > _LARGEST:
        raise InputError(path, f"the task file is longer than {_LARGEST} characters", "give a smaller one")
    try:
        loader = _Loader(text)
        root = loader.get_single_node()
        return root, None if root is None else loader.construct_document(root)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{path}:{mark.line + 1}" if mark else path
        problem = getattr(error, "problem", None) or " ".join(str(error).split())
        cure = getattr(error, "note", None)
        raise InputError(place, problem if cure else f"no valid YAML ({problem})", cure or "mend it there") from error


def _line(root: yaml.Node | None, keys: Keys) -> int:
    """Line, counted from 1, of what ``keys`` lead to, as far as they lead."""
    node, line = root, 0
    for key in keys:
        if isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
            node = node.value[key]
            line = node.start_mark.line
        elif isinstance(node, yaml.MappingNode):
            entries = [entry for entry in node.value if entry[0].value == key]
            if not entries:
                break
            line, node = entries[0][0].start_mark.line, entries[0][1]
    return line + 1


def _field(keys: Keys) -> str:
    """``goals[0].attach.part`` for ``("goals", 0, "attach", "part")``."""
    written = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys)
    return written.lstrip(".") or "task"


def _convert(data: Any, kind: Any) -> Any:
    def quantity(kind: type, value: Any) -> Any:
        try:
            return kind(parse_quantity(value, kind.__name__.lower(), ""))
        except InputError as error:
            raise ValueError(error.problem) from error  # msgspec adds the place to this kind of error only

    return msgspec.convert(data, kind, dec_hook=quantity)


def _converted(data: Any, place: Callable[[Keys], str]) -> Task:
    """The task in ``data``, or an error that tells what field is wrong."""
    try:
        task: Task = _convert(data, Task)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$")
        keys: Keys = ()
        for index, name in _STEP.findall(where):
            # An entry of a mapping is "...": msgspec does not tell which.
            keys += (_culprit(data, keys) if index == "..." else name or int(index),)
        mistake = _explained(error, problem, keys)
        raise InputError(place(mistake.keys), mistake.problem, mistake.cure) from error
    return task


def _culprit(data: Any, keys: Keys) -> str:
    """The first entry of the wrong type in the mapping to which ``keys`` lead; msgspec stops there too."""
    kind = _type_at((*keys, "..."))
    for name, value in reduce(getitem, keys, data).items():
        try:
            _convert(value, kind)
        except msgspec.ValidationError:
            return str(name)
    return "..."


def _explained(error: Exception, problem: str, keys: Keys) -> Mistake:
    """What msgspec found at ``keys``, in the words of a task file."""
    told = getattr(error.__cause__, "__cause__", None)
    if isinstance(told, InputError):
        return Mistake(keys, told.problem, told.cure)
    options = _options(_type_at(keys))
    if unknown := re.fullmatch("Object contains unknown field `(.*)`", problem):
        known = next(option.__struct_fields__ for option in options if _is_record(option))
        return Mistake((*keys, unknown[1]), "there is no such field", nearest(unknown[1], known))
    if missing := re.fullmatch("Object missing required field `(.*)`", problem):
        return Mistake(keys, f"the field {missing[1]!r} is missing", "add it")
    choices = next((get_args(option) for option in options if get_origin(option) is Literal), ())
    cure = f"give one of {', '.join(choices)}" if choices else "see `kumitate schema task`"
    for term, plain in _PLAIN.items():
        problem = problem.replace(term, plain)
    return Mistake(keys, problem, cure)


def _type_at(keys: Keys) -> Any:
    """The type of what ``keys`` lead to in a task."""
    kind: Any = Task
    for key in keys:
        for option in _options(kind):
            if _is_record(option):
                kind = get_type_hints(option)[str(key)]
            elif get_origin(option) in (dict, tuple):
                kind = get_args(option)[-1 if get_origin(option) is dict else 0]
    return kind


def _options(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Record)


def _checked(task: Task, folder: Path | None, place: Callable[[Keys], str]) -> Task:
    """``task``, if there is no mistake in it."""
    for mistake in mistakes(task, folder):
        raise InputError(place(mistake.keys), mistake.problem, mistake.cure)
    return task
