"""A picture of trials: where parts went while the fingers closed, how many were held, and what quality said of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ..grasping.grasps import GraspSet
from ..transforms import Array
from .trials import Trials

BARS = (1.0, 2.0)  # mm: what positioning is asked for in assembly
_SIZE, _DOTS = (13.0, 4.6), 120  # inches; dots an inch
_INK, _GRID, _HELD, _LOST, _BAR = "#222222", "#dddddd", "#1f6feb", "#d1242f", "#888888"
_NEAREST = 0.1  # mm: the picture shows this much around the origin at least
_LEAST = 1e-3  # mm: all that moves less is drawn there, where scales are logarithmic


def plot_trials(trials: Trials, grasps: GraspSet, path: str | Path) -> None:
    """Draw dx and dy, the share of all that was held within a displacement, and that over the quality.

    Args:
        trials: At least one.
        grasps: Those that the trials are of.
        path: PNG, PDF or SVG by its suffix.
    """
    figure = Figure(figsize=_SIZE, dpi=_DOTS, layout="constrained")
    FigureCanvasAgg(figure)
    title = f"{grasps.part} by {grasps.hand}: {trials.held.sum()} of {len(trials)} held"
    shown = "".join(letter if letter.isprintable() else "?" for letter in title)  # as names of files may not be
    figure.suptitle(shown, color=_INK, parse_math=False)
    ways, shares, qualities = figure.subplots(1, 3)
    _draw_ways(ways, trials)
    _draw_shares(shares, trials)
    _draw_qualities(qualities, trials, grasps)
    for axes in (ways, shares, qualities):
        axes.grid(color=_GRID)
        axes.set_axisbelow(True)
    figure.savefig(path)


def _draw_ways(axes: Axes, trials: Trials) -> None:
    """Where the centre of mass went along the table; failures beyond what the held ones need stand at the edge."""
    ways = trials.shift[:, :2] * 1e3
    reach = max(_NEAREST, 1.15 * np.abs(ways[trials.held]).max(initial=0.0))
    for bar in BARS:
        axes.add_patch(Circle((0.0, 0.0), bar, fill=False, color=_BAR, linestyle="--"))
    seen = np.clip(ways, -reach, reach)
    _scatter(axes, seen[:, 0], seen[:, 1], trials)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="dx [mm]", ylabel="dy [mm]")
    axes.set_title("while the fingers closed", fontsize=10, color=_INK)
    axes.locator_params(nbins=5)
    axes.legend(loc="upper right")


def _draw_shares(axes: Axes, trials: Trials) -> None:
    """The share of all trials in which the part was held and went no farther than the displacement."""
    ways = np.sort(_displacement(trials)[trials.held])
    ends = (_LEAST, max(2.0 * BARS[-1], 1.15 * ways.max(initial=0.0)))
    share = np.arange(len(ways) + 1) / len(trials) * 100.0
    axes.step([ends[0], *ways, ends[1]], [*share, share[-1]], where="post", color=_HELD)
    for bar in BARS:
        axes.axvline(bar, color=_BAR, linestyle="--")
    axes.set(xscale="log", xlim=ends, ylim=(0.0, 103.0), xlabel="displacement [mm]", ylabel="share of the trials [%]")
    axes.set_title("held, and moved by no more than", fontsize=10, color=_INK)


def _draw_qualities(axes: Axes, trials: Trials, grasps: GraspSet) -> None:
    """Displacement over quality."""
    _scatter(axes, grasps.quality[trials.grasp], _displacement(trials), trials)
    for bar in BARS:
        axes.axhline(bar, color=_BAR, linestyle="--")
    axes.set(yscale="log", xlim=(0.0, 1.0), xlabel="quality", ylabel="displacement [mm]")
    axes.set_ylim(bottom=0.8 * _LEAST)
    axes.set_title("over what the planner said of it", fontsize=10, color=_INK)


def _displacement(trials: Trials) -> Array:
    """(n,) as it is drawn where scales are logarithmic [mm]."""
    return np.maximum(trials.displacement * 1e3, _LEAST)


def _scatter(axes: Axes, x: Array, y: Array, trials: Trials) -> None:
    """Points, the failures on top of what was held."""
    for chosen, color, marker, words in ((trials.held, _HELD, "o", "held"), (~trials.held, _LOST, "x", "failed")):
        label = f"{chosen.sum()} {words}"
        axes.scatter(x[chosen], y[chosen], s=18, c=color, marker=marker, alpha=0.7, label=label, clip_on=False)
