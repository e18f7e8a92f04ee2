"""``kumitate simulate``: what it prints, measures and writes; why there is nothing to try; what it needs."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.part import Part
from kumitate.grasping.store import cached_grasps
from kumitate.robots.library import load_hand
from kumitate.tasks.cli import main

PEG = Path(__file__).resolve().parents[2] / "examples" / "parts" / "peg.stl"
HAND = ["--unit", "mm", "--hand", "robotiq_2f85"]
TRIED = 6


def made(folder, extents):
    path = folder / "made.stl"
    trimesh.creation.box(extents).export(path)
    return path


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """What was printed for programs of the peg, and the grasps that were written."""
    output, printed = tmp_path_factory.mktemp("peg") / "peg.npz", None
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr(sys.stdout, "write", lines.append)
        command = ["simulate", str(PEG), *HAND, "--count", str(TRIED), "--off", "1 mm", "--output", str(output)]
        assert main([*command, "--json"]) == 0
        printed = json.loads("".join(lines))
    return printed, GraspSet.load(output)


def test_the_file_has_all_planned_grasps_and_what_was_measured_of_those_tried(simulated):
    answer, grasps = simulated
    planned = cached_grasps(Part.load(PEG, unit="mm", density=1000.0), load_hand("robotiq_2f85"))
    assert grasps.key == planned.key
    assert np.array_equal(grasps.part_from_hand, planned.part_from_hand)
    assert answer["grasps"] == len(planned)
    assert grasps.measured.tried.sum() == answer["tried"] == TRIED
    assert grasps.measured.held.sum() == answer["held"] > 0


def test_what_is_told_is_what_the_file_says_of_the_grasps_that_held(simulated):
    answer, grasps = simulated
    found = grasps[grasps.measured.held].measured
    for name, values in (("displacement", found.shift), ("turn", found.turn), ("slip", found.slip)):
        assert answer[name]["median"] == pytest.approx(np.median(values))
        assert answer[name]["largest"] == values.max()
        assert answer[name]["median"] <= answer[name]["p95"] <= answer[name]["largest"]
    largest = answer["displacement"]["largest"]
    assert max(answer["dx"], answer["dy"]) <= largest <= np.hypot(answer["dx"], answer["dy"])
    assert TRIED <= answer["possible"] <= answer["upright"] <= answer["grasps"]
    assert answer["held"] <= answer["lifted"] <= TRIED
    assert 0.0 < answer["seconds"] < 10.0


def test_fingers_centre_a_part_that_lies_off_by_a_millimetre(simulated):
    """Pads push it back along their closing axis: by no more than it was off, and the hand tells of it."""
    answer, _ = simulated
    assert 0.1e-3 < answer["displacement"]["largest"] < 1.2e-3


def test_the_plot_is_a_picture_beside_the_grasps(simulated):
    picture = imread(simulated[0]["plot"])
    assert Path(simulated[0]["plot"]) == Path(simulated[0]["output"]).with_suffix(".png")
    assert (picture[..., :3] < 0.5).any()


def test_people_get_counts_and_failures_by_quality_and_files_beside_the_mesh(tmp_path, capsys):
    """A hand that stands off by up to 20 cm misses a block that is 4 cm long more often than not."""
    mesh = made(tmp_path, [40, 30, 20])
    assert main(["simulate", str(mesh), *HAND, "--t-rnn", "8 mm", "--count", "6", "--off", "20 cm"]) == 0
    printed = capsys.readouterr().out
    tried, lifted, held = map(int, re.search(r"(\d+) tried, (\d+) lifted, (\d+) held", printed).groups())
    assert tried == 6
    assert held <= lifted < tried
    failures = re.search(r"failures by quarter of the quality, the lowest first: (.*)", printed)[1]
    quarters = np.array([list(map(int, quarter.split(" of "))) for quarter in failures.split(", ")])
    assert quarters.sum(axis=0).tolist() == [tried - held, tried]
    assert printed.splitlines()[0].startswith("made: 12 triangles, 24 g at 1000 kg/m3")
    grasps = mesh.with_suffix(".robotiq_2f85.simulated.npz")
    assert printed.splitlines()[-2:] == [f"grasps -> {grasps}", f"plot -> {grasps.with_suffix('.png')}"]
    assert len(GraspSet.load(grasps).held()) == held
    assert imread(grasps.with_suffix(".png")).size


@pytest.mark.parametrize(
    ("extents", "more", "words"),
    [
        ([40, 30, 20], ["--mass", "20 kg"], "there is no grasp"),
        (None, [], "the part has no stable placement"),
        ([200, 200, 12], ["--mass", "5 g"], "no grasp approaches within 40 deg of the vertical"),
        ([70, 70, 5.5], ["--mass", "5 g"], r"the hand meets the table in each of the \d+ grasps"),
    ],
)
def test_nothing_to_try_is_told_with_its_reason_and_exit_1(tmp_path, capsys, extents, more, words):
    mesh = tmp_path / "made.stl"
    solid = trimesh.creation.box(extents) if extents else trimesh.creation.icosphere(subdivisions=2, radius=20)
    solid.export(mesh)
    command = ["simulate", str(mesh), *HAND, "--t-rnn", "8 mm", *more]
    assert main(command) == 1
    assert re.fullmatch(f"nothing to try: {words}.*", capsys.readouterr().out.splitlines()[-1])
    assert main([*command, "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["tried"] == answer["possible"] == 0
    assert re.match(words, answer["because"])
    assert list(tmp_path.iterdir()) == [mesh]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--count", "0"], "--count"),
        (["--count", "2.5"], "--count"),
        (["--off", "-1 mm"], "--off"),
        (["--off", "1 kg"], "--off"),
        (["--theta-parl", "20 deg"], "theta_parl"),
        (["--output", "/proc/none/g.npz"], "/proc/none"),
        (["--plot", "p.txt"], "p.txt"),
        (["--plot", "/proc/none/p.png"], "/proc/none"),
        (["--output", "one.png", "--plot", "one.png"], "not three files"),
        (["--output", str(PEG)], "not three files"),
    ],
)
def test_a_wrong_input_is_one_line_and_exit_2(capsys, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", str(PEG), *HAND, *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("kumitate: ")
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.parametrize("module", ["mujoco", "manifold3d"])
def test_without_physics_the_cure_is_told_before_any_work(tmp_path, monkeypatch, capsys, module):
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["simulate", str(tmp_path / "none.stl"), *HAND]) == 2
    error = capsys.readouterr().err
    assert error.startswith("kumitate: simulate: needs MuJoCo")
    assert error.endswith("run: pip install 'kumitate[sim]'\n")


def test_no_other_module_needs_them():
    """All of the package but its physics loads without."""
    code = """
import importlib, pkgutil, sys
sys.modules["mujoco"] = sys.modules["manifold3d"] = None
import kumitate.grasping, kumitate.regrasp, kumitate.robots, kumitate.tasks
for room in (kumitate.grasping, kumitate.regrasp, kumitate.robots, kumitate.tasks):
    for module in pkgutil.iter_modules(room.__path__, room.__name__ + "."):
        importlib.import_module(module.name)
print(len(sys.modules))
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert int(found.stdout) > 100
