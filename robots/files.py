"""Reading text, XML and typed YAML files; what is wrong is told with file, line, field and cure."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import msgspec
import yaml

from ..errors import InputError

Record = TypeVar("Record")
_LARGEST = 8_000_000  # bytes


def read_text(path: Path, kind: str) -> str:
    """The text of a file; ``kind`` names it in errors.

    Raises:
        InputError: The file is missing, unreadable, too large, or no text.
    """
    try:
        if path.stat().st_size > _LARGEST:
            raise InputError(path, f"the {kind} file is larger than {_LARGEST} bytes", "give a smaller one")
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError(path, f"the {kind} file does not exist", "check the path") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"the {kind} file cannot be read ({error})", "give a readable text file") from error


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
        InputError: The file is missing, no YAML, uses aliases, or a field is unknown, missing or of the wrong type.
    """
    text = read_text(path, "YAML")
    try:
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)):
            raise InputError(path, "it uses YAML aliases", "write the values out")
        data = yaml.safe_load(text)
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
            f"{path}:{_line(text, keys)}: {field}", problem, "see the format in the documentation"
        ) from error


def _line(text: str, keys: list[int | str]) -> int:
    """Line, counted from 1, of the value that ``keys`` lead to, as far as they lead."""
    node = yaml.compose(text, yaml.SafeLoader)
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
