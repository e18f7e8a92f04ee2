"""Files that people write: what is wrong is told with its line, and nothing blows up."""

from __future__ import annotations

import msgspec
import pytest

from kumitate.errors import InputError
from kumitate.robots.files import parse_xml, read_text, read_yaml


class Item(msgspec.Struct, forbid_unknown_fields=True):
    size: tuple[float, float]
    note: str = ""


class Box(msgspec.Struct):
    name: str
    items: list[Item]
    parts: dict[str, Item] = {}


@pytest.mark.parametrize(
    ("text", "line", "field"),
    [
        ("name: a\nitems:\n- size: [1, 2]\n- size: [1, x]\n", 4, r"items\[1\]\.size\[1\]"),
        ("name: a\nitems:\n- size: [1, 2]\n  colour: red\n", 3, r"items\[0\]"),
        ("name: a\nitems:\n- size:\n  - 1\n  - x\n", 5, r"items\[0\]\.size\[1\]"),
        ("name:\n  1\nitems: []\n", 2, "name"),
        ("name: a\nitems:\n\n- note: b\n", 4, r"items\[0\]"),
        ("items: []\n", 1, "top level"),
    ],
)
def test_errors_name_line_and_field(tmp_path, text, line, field):
    path = tmp_path / "box.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"box\.yaml:{line}: {field}: "):
        read_yaml(path, Box)


@pytest.mark.parametrize(
    "text",
    [
        *("a: [", "a: 2020-13-45", "? [a]\n: 1", "\x00"),
        *("a: 1" + "0" * 5000, "a: " + "[" * 5000, "a: " + "[" * 100_000),
    ],
)
def test_what_is_no_yaml_is_refused(tmp_path, text):
    path = tmp_path / "box.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="no valid YAML"):
        read_yaml(path, Box)


@pytest.mark.parametrize(
    "value", ["!!python/name:os.system", "!!bool x", "!!int ''", "!!timestamp x", "&a [*a]", "!x 1", "!!float y"]
)
def test_aliases_and_tags_are_refused_with_their_line(tmp_path, value):
    (tmp_path / "box.yaml").write_text(f"name: x\nitems: {value}\n")
    with pytest.raises(InputError, match=r"box\.yaml:2: no valid YAML \(it uses an alias or a tag"):
        read_yaml(tmp_path / "box.yaml", Box)


def test_half_a_character_is_refused_with_its_line(tmp_path):
    (tmp_path / "box.yaml").write_text('name: x\nitems: ["\\ud800"]\n')
    with pytest.raises(InputError, match=r"box\.yaml:2: no valid YAML \(an escape stands for half a character"):
        read_yaml(tmp_path / "box.yaml", Box)


def test_long_yaml_is_not_read(tmp_path):
    (tmp_path / "box.yaml").write_text("items: [" + "[], " * 40_000 + "]")
    with pytest.raises(InputError, match="longer than"):
        read_yaml(tmp_path / "box.yaml", Box)


@pytest.mark.parametrize("name", ["a" * 5000, "a\0b", "\ud800", "/dev/zero", "/dev/null"])
def test_what_can_be_no_file_is_refused(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read_text(tmp_path / name, "URDF")


def test_unreadable_files_are_refused(tmp_path):
    (tmp_path / "large").write_text("a" * 8_000_001)
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    for name, message in (
        ("large", "larger than"),
        ("binary", "cannot be read"),
        ("", "cannot be read"),
        ("no", "exist"),
    ):
        with pytest.raises(InputError, match=message):
            read_text(tmp_path / name, "YAML")


def test_what_is_no_xml_is_refused(tmp_path):
    for text in ("", "<a>", "<a></b>", "<a/><b/>"):
        with pytest.raises(InputError, match="well-formed"):
            parse_xml(tmp_path / "a.xml", text)
