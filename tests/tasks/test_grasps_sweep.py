"""Sweeps of one parameter: how they are written, what they count, what they draw."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from kumitate.errors import InputError
from kumitate.grasping.facets import segment
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand
from kumitate.tasks.grasps_sweep import plot_sweep, read_sweep, shown, swept

COARSE = GraspParameters(t_rnn=6e-3, t_bdry=3e-3, n_da=4)


@pytest.fixture(scope="module")
def ball():
    """Eighty triangles: how flat a facet must be decides how large it is."""
    return Part.from_mesh(trimesh.creation.icosphere(subdivisions=1, radius=0.025), mass=0.05, name="ball$_$")


@pytest.fixture(scope="module")
def hand():
    return load_hand("robotiq_2f85")


@pytest.fixture(scope="module")
def flatness(ball, hand):
    return swept(ball, hand, COARSE, "theta_pln", np.radians([1.0, 20.0, 50.0]))


@pytest.mark.parametrize(
    ("text", "name", "ends", "count"),
    [
        ("theta_parl=120..175", "theta_parl", (radians(120.0), radians(175.0)), 12),
        ("theta_parl = 120 .. 175 deg / 3", "theta_parl", (radians(120.0), radians(175.0)), 3),
        ("theta_pln=0.1rad..0.3rad/5", "theta_pln", (0.1, 0.3), 5),
        ("t_dct=0..6 mm", "t_dct", (0.0, 6e-3), 12),
        ("t_dct=0..6", "t_dct", (0.0, 6e-3), 12),
        ("t_rnn=0.002 m..0.006/4", "t_rnn", (2e-3, 6e-3), 4),
        ("h_max=.5..1.5/3", "h_max", (0.5e-3, 1.5e-3), 3),
        ("theta_parl=90..180", "theta_parl", (np.pi / 2.0, np.pi), 12),
    ],
)
def test_values_are_evenly_spaced_from_end_to_end_and_bare_ones_are_degrees_and_millimetres(text, name, ends, count):
    got, values = read_sweep(text, "--sweep")
    assert got == name
    assert (values[0], values[-1]) == pytest.approx(ends, abs=1e-15)
    assert len(values) == count
    assert np.ptp(np.diff(values)) < 1e-12
    for value in values:
        replace(GraspParameters(), **{name: value})


def test_numbers_of_rotations_are_whole_and_differ():
    assert read_sweep("n_da=4..8", "--sweep") == ("n_da", [4, 5, 6, 7, 8])
    assert read_sweep("n_da=4..16/3", "--sweep") == ("n_da", [4, 10, 16])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "theta_parl",
        "theta_parl=120",
        "theta=120..175",
        "theta_parl=175..120",
        "theta_parl=120..120",
        "theta_parl=120..175 mm",
        "theta_parl=120..inf",
        "theta_parl=120..175/1",
        "theta_parl=120..175/101",
        "theta_parl=120..175/2.5",
        "t_dct=0..6 deg",
        "t_dct=a..6",
        "n_da=4..8.5",
        "n_da=4 mm..8",
    ],
)
def test_what_is_no_range_is_told_with_its_place(text):
    with pytest.raises(InputError, match="--sweep: "):
        read_sweep(text, "--sweep")


def test_values_are_shown_as_a_user_writes_them():
    assert shown("theta_parl", radians(160.0)) == "160 deg"
    assert shown("t_dct", 3e-3) == "3 mm"
    assert shown("n_da", 8) == "8"


def test_each_row_is_what_planning_at_that_value_gives(ball, hand, flatness):
    """The size of the facets is that of the segmentation."""
    for i, value in enumerate(flatness.values):
        chosen = replace(COARSE, theta_pln=value)
        grasps, facets = plan_grasps(ball, hand, chosen), segment(ball, chosen.theta_pln, chosen.theta_fct)
        kept = {stage.name: stage.kept for stage in grasps.record}
        assert flatness.grasps[i] == len(grasps)
        assert flatness.contacts[i] == kept["refinement 2"]
        assert flatness.pairs[i] == kept["contact pairs"]
        assert flatness.facets[i] == len(facets)
        assert flatness.triangles[i] == pytest.approx(np.mean([len(facets[k]) for k in range(len(facets))]))
    assert (flatness.seconds > 0.0).all()
    assert flatness.grasps.any()


def test_flatter_facets_are_smaller(flatness):
    """At 1 deg each of the ball's triangles is a facet of its own."""
    assert flatness.facets[0] == 80
    assert flatness.triangles[0] == 1.0
    assert (np.diff(flatness.triangles) > 0.0).all()


def test_a_cup_has_no_pairs(ball):
    assert swept(ball, load_hand("suction_cup"), COARSE, "n_da", [4, 8]).pairs is None


def test_a_value_out_of_range_is_told_before_anything_is_planned(ball, hand):
    seen = []
    with pytest.raises(InputError, match="theta_parl"):
        swept(ball, hand, COARSE, "theta_parl", [radians(160.0), radians(60.0)], seen.append)
    assert not seen


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_the_plot_is_drawn_by_its_suffix(flatness, tmp_path, suffix):
    """Dollars in a name are no mathematics."""
    path = tmp_path / f"plot{suffix}"
    plot_sweep(flatness, path)
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    assert path.read_bytes().startswith(starts[suffix])
    if suffix == ".png":
        assert (imread(path)[..., :3] < 0.5).any()


def test_a_plot_without_any_grasp_is_a_plot(flatness, tmp_path):
    none = replace(flatness, pairs=None, grasps=np.zeros_like(flatness.grasps))
    plot_sweep(none, tmp_path / "none.png")
    assert imread(tmp_path / "none.png").size
