"""``kumitate grasps``: what it prints and writes, and one clear line for each wrong input."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import trimesh

from kumitate.grasping.grasps import GraspSet
from kumitate.tasks.cli import main

STAGES = [
    "segmentation",
    "sampling",
    "refinement 1",
    "refinement 2",
    "contact pairs",
    "stroke collision",
    "pad standing",
]


@pytest.fixture
def block(tmp_path):
    path = tmp_path / "block.stl"
    trimesh.creation.box([40, 30, 20]).export(path)
    return path


def test_grasps_prints_the_stages_and_writes_the_set(block, capsys):
    assert main(["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--mass", "50g"]) == 0
    printed = capsys.readouterr().out
    assert "12 triangles, 50 g" in printed
    lines = printed.splitlines()
    for stage in STAGES:
        assert any(line.startswith(stage) for line in lines)
    grasps = GraspSet.load(block.with_suffix(".robotiq_2f85.npz"))
    assert len(grasps) > 100
    assert f"{len(grasps)} grasps" in lines[-1]
    assert grasps.hand == "robotiq_2f85"


def test_the_density_is_printed_where_no_mass_is_given(block, capsys):
    assert main(["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85"]) == 0
    assert "24 g at 1000 kg/m3" in capsys.readouterr().out
    assert main(["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--density", "2 g/cm3"]) == 0
    assert "48 g at 2000 kg/m3" in capsys.readouterr().out


def test_parameters_reach_the_planner(block, capsys, tmp_path):
    common = ["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--output"]
    assert main([*common, str(tmp_path / "8.npz")]) == 0
    assert main([*common, str(tmp_path / "16.npz"), "--n-da", "16", "--t-rnn", "4 mm", "--theta-parl", "150 deg"]) == 0
    eight, sixteen = (GraspSet.load(tmp_path / f"{n}.npz") for n in (8, 16))
    assert {s.name: s.kept for s in sixteen.record}["refinement 2"] < {s.name: s.kept for s in eight.record}[
        "refinement 2"
    ]
    directions = [len(np.unique(np.round(g.part_from_hand[:, :3, 2], 3), axis=0)) for g in (eight, sixteen)]
    assert directions[1] > directions[0]


def test_a_sweep_prints_a_row_for_each_value_and_draws_a_plot_beside_the_mesh(block, capsys):
    """Bare angles are degrees here; parallel sides stay parallel however strictly one looks."""
    command = ["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--t-rnn", "5 mm"]
    assert main([*command, "--sweep", "theta_parl=120..175/3"]) == 0
    lines = capsys.readouterr().out.splitlines()
    head = lines.index("  theta_parl  facets  triangles  contacts  pairs  grasps     s")
    rows = [line.split() for line in lines[head + 1 : -1]]
    assert [row[:4] for row in rows] == [[angle, "deg", "6", "2.0"] for angle in ("120", "147.5", "175")]
    assert len({tuple(row[:-1][4:]) for row in rows}) == 1
    plot = block.with_suffix(".robotiq_2f85.theta_parl.png")
    assert lines[-1] == f"plot -> {plot}"
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert not block.with_suffix(".robotiq_2f85.npz").exists()


def test_a_sweep_of_a_cup_draws_where_it_is_told(block, capsys, tmp_path):
    command = ["grasps", str(block), "--unit", "mm", "--hand", "suction_cup", "--sweep", "n_da=4..5"]
    assert main([*command, "--plot", str(tmp_path / "plot.svg")]) == 0
    assert "pairs" not in capsys.readouterr().out
    assert "<svg" in (tmp_path / "plot.svg").read_text()


def test_a_sweep_without_any_grasp_is_exit_1(block):
    command = ["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--mass", "20 kg"]
    assert main([*command, "--sweep", "n_da=4..5"]) == 1


def test_no_grasp_at_all_is_exit_1(block):
    assert main(["grasps", str(block), "--unit", "mm", "--hand", "robotiq_2f85", "--mass", "20 kg"]) == 1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--unit", "mm", "--hand", "robotiq_2f58"], "robotiq_2f58"),
        (["--unit", "mm", "--hand", "missing.yaml"], "missing.yaml"),
        (["--unit", "furlong", "--hand", "robotiq_2f85"], "furlong"),
        (["--unit", "m", "--hand", "robotiq_2f85"], "mm"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--mass", "50 mm"], "--mass"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--mass", "-1 g"], "mass"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--h-max", "1 kg"], "--h-max"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--theta-parl", "20 deg"], "theta_parl"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--n-da", "8.5"], "--n-da"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--output", "/proc/none/g.npz"], "/proc/none/g.npz"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--plot", "p.png"], "--sweep"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "theta_parl=120"], "--sweep"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "theta_parl=20..175"], "theta_parl"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "n_da=4..5", "--n-da", "8"], "--n-da"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "n_da=4..5", "--view"], "--view"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "n_da=4..5", "--plot", "p.txt"], "p.txt"),
        (["--unit", "mm", "--hand", "robotiq_2f85", "--sweep", "n_da=4..5", "--plot", "/proc/no/p.png"], "/proc/no"),
    ],
)
def test_a_wrong_input_is_one_line_and_exit_2(block, capsys, arguments, words):
    assert main(["grasps", str(block), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("kumitate: ")
    assert words in error
    assert error.count("\n") == 1


def test_a_mesh_that_is_not_there_is_exit_2(tmp_path, capsys):
    assert main(["grasps", str(tmp_path / "none.stl"), "--unit", "mm", "--hand", "robotiq_2f85"]) == 2
    assert "none.stl" in capsys.readouterr().err


def test_it_runs_as_a_command(block):
    command = [
        sys.executable,
        "-m",
        "kumitate.tasks.cli",
        "grasps",
        str(block),
        "--unit",
        "mm",
        "--hand",
        "suction_cup",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "seal" in done.stdout
