"""The picture of trials: every trial is in it once, where it went, and the curve counts what was held."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Circle

from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.physics.chart import plot_trials
from kumitate.physics.trials import Trials
from kumitate.robots.library import load_hand

RED = (209, 36, 47)


@pytest.fixture(scope="module")
def grasps():
    block = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.05, name="block$_$\udcff")
    return plan_grasps(block, load_hand("robotiq_2f85"), GraspParameters(t_rnn=8e-3, n_da=4))


@pytest.fixture
def trials(grasps, rng):
    """Thirty that moved by up to a few millimetres, the last three farther, and lost."""
    shift = np.zeros((30, 3))
    shift[:, :2] = rng.normal(0.0, 1e-3, (30, 2))
    shift[-3:, 0] = 0.05
    held = np.arange(30) < 27
    zeros = np.zeros(30)
    return Trials(
        grasp=np.sort(rng.permutation(len(grasps))[:30]), placement=np.zeros(30, dtype=np.int64), shift=shift,
        turn=zeros, slip=zeros, slip_turn=zeros, lifted=held, held=held, seconds=zeros + 0.1,
    )  # fmt: skip


@pytest.fixture
def axes(trials, grasps, monkeypatch):
    """The three parts of the picture, as they are when it is saved."""
    seen: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, path: seen.append(figure))
    plot_trials(trials, grasps, "nowhere.png")
    (figure,) = seen
    return figure.axes


def points(axes):
    """Positions of what was held and of what failed."""
    held, failed = axes.collections
    return np.asarray(held.get_offsets()), np.asarray(failed.get_offsets())


def test_the_first_part_shows_where_the_parts_went_in_millimetres(axes, trials):
    held, failed = points(axes[0])
    assert held == pytest.approx(trials.shift[:27, :2] * 1e3)
    reach = axes[0].get_xlim()[1]
    assert np.abs(held).max() < reach < 50.0
    assert failed[:, 0] == pytest.approx(reach)
    assert sorted(patch.radius for patch in axes[0].patches if isinstance(patch, Circle)) == [1.0, 2.0]


def test_the_second_part_counts_what_was_held_within_a_displacement(axes, trials):
    curve, *bars = axes[1].lines
    way, share = curve.get_data()
    for bar, line in zip((1.0, 2.0), bars, strict=True):
        assert set(line.get_xdata()) == {bar}
        within = (trials.held & (trials.displacement <= bar * 1e-3)).mean() * 100.0
        assert share[np.searchsorted(way, bar) - 1] == pytest.approx(within)
    assert share[-1] == pytest.approx(90.0)


def test_the_third_part_sets_displacement_against_quality(axes, trials, grasps):
    held, failed = points(axes[2])
    both = np.concatenate([held, failed])
    assert both[:, 0] == pytest.approx(grasps.quality[trials.grasp])
    assert both[:, 1] == pytest.approx(trials.displacement * 1e3)


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_it_is_drawn_by_its_suffix(trials, grasps, tmp_path, suffix):
    """Dollars in a name are no mathematics, and what cannot be printed is no error."""
    path = tmp_path / f"plot{suffix}"
    plot_trials(trials, grasps, path)
    starts = {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}
    assert path.read_bytes().startswith(starts[suffix])


@pytest.mark.parametrize(("held", "red"), [(True, False), (False, True)])
def test_failures_alone_are_red(trials, grasps, tmp_path, held, red):
    """All that stood still to a micrometre, and were held or not."""
    all_or_none = np.full(30, held)
    still = replace(trials, shift=np.zeros((30, 3)), lifted=all_or_none, held=all_or_none)
    plot_trials(still, grasps, tmp_path / "plot.png")
    picture = np.round(imread(tmp_path / "plot.png")[..., :3] * 255.0)
    middle = picture[:, : picture.shape[1] // 3][150:400, 150:350]  # around the origin of the first part, no legend
    assert (np.abs(middle - RED).max(axis=-1) < 60.0).any() == red
