"""Reading text, XML and typed YAML files; what is wrong is told with file, line, field and cure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import msgspec
import yaml

from ..errors import InputError

Record = TypeVar("Record")
_LARGEST = 8_000_000  # bytes
_LARGEST_YAML = 2**17  # characters; they take seconds to read


class _PlainLoader(yaml.SafeLoader):
    """YAML of plain values: aliases can blow up without bound, tags make what no field expects."""

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or getattr(event, "tag", None) is not None:
            raise yaml.MarkedYAMLError(problem="it uses an alias or a tag", problem_mark=event.start_mark)
        if re.search("[\ud800-\udfff]", getattr(event, "value", "")):
            raise yaml.MarkedYAMLError(problem="an escape stands for half a character", problem_mark=event.start_mark)
        return super().compose_node(parent, index)


def read_text(path: Path, kind: str) -> str:
    """The text of a file; ``kind`` names it in errors.

    Raises:
        InputError: The file is missing, no plain file, unreadable, too large, or no text.
    """
    try:
        return read_bytes(path, kind, _LARGEST).decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(path, f"the {kind} file cannot be read ({error})", "give a readable text file") from error


def read_bytes(path: Path, kind: str, largest: int) -> bytes:
    """The contents of a file of at most ``largest`` bytes; ``kind`` names it in errors.

    Raises:
        InputError: The file is missing, no plain file, unreadable, or too large.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError(path, f"the {kind} file cannot be read (it is a folder or a device)", "give a plain file")
        if path.stat().st_size > largest:
            raise InputError(path, f"the {kind} file is larger than {largest} bytes", "give a smaller one")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(path, f"the {kind} file does not exist", "check the path") from error
    except (OSError, ValueError) as error:  # a name that no file can have is a ValueError
        raise InputError(path, f"the {kind} file cannot be read ({error})", "give a file that can be read") from error


def parse_xml(path: Path, text: str) -> ElementTree.Element:
    """The root element of ``text``, the contents of ``path``.

    Raises:
        InputError: It is no XML, or it declares entities (which can blow up without bound).
    """
    if "<!ENTITY" in text:
        raise InputError(path, "it declares XML entities", "write them out")
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise InputError(path, f"no well-formed XML ({error})", "mend the file there") from error


def read_yaml(path: Path, kind: type[Record]) -> Record:
    """A record of type ``kind`` (a msgspec structure) from a YAML file.

    Raises:
        InputError: The file is missing, too large, no YAML, uses aliases or tags, or a field is unknown, missing or of
            the wrong type.
    """
    text = read_text(path, "YAML")
    if len(text) > _LARGEST_YAML:
        raise InputError(path, f"it is longer than {_LARGEST_YAML} characters", "give a smaller one")
    try:
        loader = _PlainLoader(text)
        root = loader.get_single_node()
        data = None if root is None else loader.construct_document(root)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{path}:{mark.line + 1}" if mark else path
        problem = getattr(error, "problem", None) or str(error)
        raise InputError(place, f"no valid YAML ({problem})", "mend the file there") from error
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$")
        keys = [int(i) if i else name for i, name in re.findall(r"\[(\d+)\]|\.([^.\[`]+)", where)]
        field = where.rstrip("`").lstrip(".") or "top level"
        raise InputError(
            f"{path}:{_line(root, keys)}: {field}", problem, "see the format in the documentation"
        ) from error


def _line(node: yaml.Node | None, keys: list[int | str]) -> int:
    """Line, counted from 1, of the value below ``node`` that ``keys`` lead to, as far as they lead."""
    line = 0
    for key in keys:
        if isinstance(node, yaml.SequenceNode) and isinstance(key, int):
            node = node.value[key]
        elif isinstance(node, yaml.MappingNode):
            entries = [(name, value) for name, value in node.value if name.value == key]
            if not entries:
                break
            node = entries[0][1]
        if node is not None:
            line = node.start_mark.line
    return line + 1
