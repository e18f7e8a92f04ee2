"""``kumitate placements``: what it prints, the page it writes, and how it ends."""

from __future__ import annotations

import pytest
import trimesh

from kumitate.tasks.cli import main


@pytest.fixture
def block(tmp_path):
    path = tmp_path / "block.stl"
    trimesh.creation.box([40, 30, 20]).export(path)
    return path


def test_it_prints_one_line_a_placement_the_firmest_first(block, capsys):
    assert main(["placements", str(block), "--unit", "mm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "block: 12 triangles"
    rows = [line.split() for line in lines if line[:1].isdigit() and "stable" not in line]
    assert [row[0] for row in rows] == list("123456")
    assert [row[1] for row in rows] == ["56.3", "56.3", "33.7", "33.7", "26.6", "26.6"]
    assert [row[2] for row in rows] == ["10.0", "10.0", "15.0", "15.0", "20.0", "20.0"]
    assert [row[3] for row in rows] == ["1200", "1200", "800", "800", "600", "600"]
    assert sum(float(row[4]) for row in rows) == pytest.approx(100.0, abs=0.5)
    assert lines[-1].startswith("6 stable placements")


def test_the_page_is_named_after_the_mesh_unless_named(block, tmp_path, capsys):
    assert main(["placements", str(block), "--unit", "mm", "--view"]) == 0
    assert block.with_suffix(".placements.html").is_file()
    assert main(["placements", str(block), "--unit", "mm", "--view", str(tmp_path / "page.html")]) == 0
    assert (tmp_path / "page.html").is_file()
    assert "view -> " in capsys.readouterr().out


def test_a_part_that_only_rolls_is_exit_1(tmp_path, capsys):
    path = tmp_path / "ball.stl"
    trimesh.creation.icosphere(3, 20).export(path)
    assert main(["placements", str(path), "--unit", "mm", "--view", str(tmp_path / "ball.html")]) == 1
    assert "0 stable placements" in capsys.readouterr().out
    assert (tmp_path / "ball.html").is_file()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--unit", "furlong"], "furlong"),
        (["--unit", "m"], "mm"),
        (["--unit", "mm", "--view", "/proc/none/p"], "/proc"),
    ],
)
def test_a_wrong_input_is_one_line_and_exit_2(block, capsys, arguments, words):
    assert main(["placements", str(block), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("kumitate: ")
    assert words in error
    assert error.count("\n") == 1
