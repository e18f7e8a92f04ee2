"""The picture of a regrasp graph: which grasps work on a plane, what placements share, the command that draws it."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.placements import find_placements
from kumitate.robots.library import load_hand
from kumitate.tasks.cli import main
from kumitate.tasks.view_regrasp import APPROACH, feasible, shared_graph, write_regrasp_picture
from kumitate.transforms import invert, transform_points


@pytest.fixture(scope="module")
def block():
    return Part.from_mesh(trimesh.creation.box([0.06, 0.03, 0.02]), mass=0.05, name="block")


@pytest.fixture(scope="module")
def hand():
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="module")
def works(block, hand):
    return feasible(hand, plan_grasps(block, hand), find_placements(block))


def test_the_whole_hand_stays_above_the_plane_closed_open_and_where_it_comes_from(block, hand):
    """One by one: the lowest corner of any piece."""
    grasps, placements = plan_grasps(block, hand).thin(60), find_placements(block)
    got = feasible(hand, grasps, placements)
    assert got.any()
    assert not got.all()
    for i, surface_from_part in enumerate(placements.surface_from_part):
        for n in range(len(grasps)):
            hands = surface_from_part @ grasps.part_from_hand[n]
            base = hands @ invert(hand.base_from_hand(grasps.opening[n]))[0]
            lowest = []
            for opening, back in (
                (grasps.opening[n], 0),
                (grasps.approach_opening[n], 0),
                (grasps.approach_opening[n], 1),
            ):
                moved = base.copy()
                moved[:3, 3] -= back * APPROACH * hands[:3, 2]
                for piece, at in zip(hand.pieces, moved @ hand.base_from_piece(opening)[0], strict=True):
                    lowest.append(transform_points(at, piece.mesh.vertices)[:, 2].min())
            assert got[i, n] == (min(lowest) > 0.0)


def test_shared_grasps_are_those_that_work_at_both_ends(works):
    graph = shared_graph(works)
    assert list(graph) == [1, 2, 3, 4, 5, 6]
    assert [graph.nodes[i]["grasps"] for i in graph] == works.sum(axis=1).tolist()
    for i in range(6):
        for j in range(i):
            both = int((works[i] & works[j]).sum())
            assert graph.has_edge(i + 1, j + 1) == (both > 0)
            assert not both or graph.edges[i + 1, j + 1]["shared"] == both
    assert 0 < graph.number_of_edges() < 15  # lying on one side, hands that come from above do not come from below


def test_opposite_sides_of_a_flat_part_share_nothing(works, block):
    """Lying flat on either side it is thinner than the fingers reach beyond the contact."""
    placements = find_placements(block)
    flat = [i for i, height in enumerate(placements.height) if height < 0.011]
    assert len(flat) == 2
    assert not (works[flat[0]] & works[flat[1]]).any()
    assert works[flat].any(axis=1).all()


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_the_picture_is_drawn(block, works, tmp_path, suffix):
    path = tmp_path / f"graph{suffix}"
    write_regrasp_picture(path, block, find_placements(block), shared_graph(works), "block <b> & co.")
    if suffix != ".png":
        assert path.stat().st_size > 3000
        return
    pixels = imread(path)[..., :3]
    assert pixels.shape[0] == pixels.shape[1] > 800
    grey = np.ptp(pixels, axis=-1) < 0.05
    dark, blue = grey & (pixels.mean(axis=-1) < 0.3), (pixels[..., 2] - pixels[..., 0]) > 0.2
    assert dark.sum() > 1000  # words
    assert blue.sum() > 10_000  # parts and lines
    # Placements stand in a circle: something is drawn around each of the six places, nothing in the corners.
    middle, radius = np.array([0.53, 0.5]) * len(pixels), 0.36 * len(pixels)
    for turn in np.pi / 3.0 * np.arange(6):
        row, column = (middle + radius * np.array([-np.cos(turn), np.sin(turn)])).astype(int)
        assert blue[row - 40 : row + 40, column - 40 : column + 40].mean() > 0.2
    for corner in (pixels[:60, :60], pixels[:60, -60:], pixels[-60:, :60], pixels[-60:, -60:]):
        assert corner.min() == 1.0


@pytest.mark.parametrize("name", [r"a$\frac{$", "\udcff.stl", "a\0\nb", "<b>-->"])
def test_any_name_may_be_in_the_title(tmp_path, block, name):
    """Neither a formula, nor what no file can hold."""
    placements, path = find_placements(block), tmp_path / "graph.svg"
    write_regrasp_picture(path, block, placements, shared_graph(np.ones((len(placements), 1), dtype=bool)), name)
    assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_a_part_without_placements_is_an_empty_picture(tmp_path, hand):
    ball = Part.from_mesh(trimesh.creation.icosphere(2, 0.02), mass=0.05, name="ball")
    graph = shared_graph(np.zeros((0, 10), dtype=bool))
    write_regrasp_picture(tmp_path / "ball.png", ball, find_placements(ball), graph, "ball")
    assert (tmp_path / "ball.png").is_file()


# The command


@pytest.fixture
def mesh(tmp_path, monkeypatch):
    monkeypatch.setenv("KUMITATE_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "plate.stl"
    trimesh.creation.box([40, 20, 10]).export(path)
    return path


def test_the_command_draws_the_graph_and_keeps_the_grasps(mesh, tmp_path, capsys, monkeypatch):
    picture = tmp_path / "graph.png"
    arguments = ["placements", str(mesh), "--unit", "mm", "--hand", "robotiq_2f85", "--graph", str(picture)]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"graph -> {picture}"
    assert lines[-2].startswith("plate: ")
    assert "of 15 pairs of placements share some" in lines[-2]
    assert picture.read_bytes()[:4] == b"\x89PNG"
    monkeypatch.setattr("kumitate.grasping.planner.plan_grasps", lambda *_: pytest.fail("planned again"))
    assert main(arguments) == 0
    assert len(list((tmp_path / "cache").glob("grasps-*.npz"))) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--graph", "graph.png"], "--graph: given without --hand"),
        (["--hand", "robotiq_2f85"], "--hand: given without --graph"),
        (["--hand", "robotiq_2f85", "--graph", "graph.docx"], "end it in .png, .pdf, .svg"),
        (["--hand", "robotiq_2f86", "--graph", "graph.png"], "robotiq_2f86"),
        (["--hand", "robotiq_2f85", "--graph", "/proc/none/graph.png"], "/proc/none"),
    ],
)
def test_a_wrong_input_is_one_line_and_exit_2(mesh, capsys, arguments, words):
    assert main(["placements", str(mesh), "--unit", "mm", *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
