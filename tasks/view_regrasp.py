"""A picture of a regrasp graph: the placements of a part, and how many grasps of a hand each two of them share."""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path

import networkx as nx
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..grasping.grasps import GraspSet
from ..grasping.part import Part
from ..regrasp.placements import Placements
from ..robots.hand import Hand
from ..transforms import Array, invert, rotation_from_rpy, transform_points

APPROACH = 0.05  # m that the open hand comes straight to the part
FORMATS = (".png", ".pdf", ".svg")

_SIDE, _DOTS = 9.0, 120  # inches; dots an inch
_PICTURE = 0.2  # half the side of a placement's picture at most, over the radius of the circle that they stand on
_LIGHT = np.array([0.3, -0.5, 0.8])
_CAMERA = rotation_from_rpy([-1.1, 0.0, 0.0]) @ rotation_from_rpy([0.0, 0.0, 0.6])  # from the front, above and aside
_PAPER, _INK, _STEEL, _EDGE = "#ffffff", "#222222", (0.55, 0.65, 0.78), "#1f6feb"


def feasible(hand: Hand, grasps: GraspSet, placements: Placements) -> npt.NDArray[np.bool_]:
    """Which of the n grasps work at each of the m placements on a bare plane (m, n).

    The whole hand stays above the plane: closed on the part, open around it, and open where it comes from.
    """
    base = grasps.part_from_hand @ invert(hand.base_from_hand(grasps.opening))
    back = base.copy()
    back[:, :3, 3] -= APPROACH * grasps.part_from_hand[:, :3, 2]
    corners = [piece.mesh.convex_hull.vertices.T for piece in hand.pieces]
    above = np.ones((len(placements), len(grasps)), dtype=bool)
    looks = ((base, grasps.opening), (base, grasps.approach_opening), (back, grasps.approach_opening))
    for part_from_base, openings in looks:
        poses = part_from_base[:, None] @ hand.base_from_piece(openings)
        for i, surface_from_part in enumerate(placements.surface_from_part):
            height = surface_from_part[2] @ poses  # (n, pieces, 4): the third row of each piece's pose on the surface
            for points, row in zip(corners, np.moveaxis(height, 1, 0), strict=True):
                above[i] &= (row[:, :3] @ points + row[:, 3:] > 0.0).all(axis=1)
    return above


def shared_graph(works: npt.NDArray[np.bool_]) -> nx.Graph:
    """Placements, counted from 1, with how many grasps work there; edges with how many of those two of them share.

    Args:
        works: Which grasps work at each placement (m, n).
    """
    graph = nx.Graph()
    graph.add_nodes_from((i + 1, {"grasps": int(row.sum())}) for i, row in enumerate(works))
    shared = works.astype(int) @ works.T.astype(int)
    pairs = np.argwhere(np.triu(shared, 1))
    graph.add_edges_from((int(i) + 1, int(j) + 1, {"shared": int(shared[i, j])}) for i, j in pairs)
    return graph


def write_regrasp_picture(path: str | Path, part: Part, placements: Placements, graph: nx.Graph, title: str) -> None:
    """Draw ``graph`` (see `shared_graph`) with a picture of each placement; PNG, PDF or SVG by the file's suffix."""
    figure = Figure(figsize=(_SIDE, _SIDE), dpi=_DOTS, facecolor=_PAPER)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 0.95))
    axes.set(xlim=(-1.37, 1.37), ylim=(-1.37, 1.23))
    axes.axis("off")
    shown = "".join(letter if letter.isprintable() else "?" for letter in title)  # as names of files may not be
    figure.suptitle(shown, color=_INK, parse_math=False)
    count = max(len(graph), 2)
    turns = (pi / 2.0 - 2.0 * pi * i / count for i in range(count))
    at = dict(zip(graph, ((cos(turn), sin(turn)) for turn in turns), strict=False))
    half = min(_PICTURE, sin(pi / count))
    shared = nx.get_edge_attributes(graph, "shared")
    most = max(shared.values(), default=1)
    widths = [1.0 + 5.0 * number / most for number in shared.values()]
    nx.draw_networkx_edges(graph, at, ax=axes, edgelist=list(shared), width=widths, edge_color=_EDGE, alpha=0.45)
    # A third of the way, so that the labels of lines that cross in the middle do not.
    nx.draw_networkx_edge_labels(graph, at, shared, label_pos=0.33, ax=axes, font_size=9, font_color=_INK, rotate=False)
    for (node, (x, y)), pose in zip(at.items(), placements.surface_from_part, strict=True):
        box = (x - half, y - half, 2.0 * half, 2.0 * half)
        _draw_part(axes.inset_axes(box, transform=axes.transData), part, pose)
        words, paper = f"{node}: {graph.nodes[node]['grasps']} grasps", {"facecolor": _PAPER, "edgecolor": "none"}
        axes.text(x, y - 1.25 * half, words, ha="center", va="center", color=_INK, weight="bold", bbox=paper, zorder=6)
    figure.savefig(path)


def _draw_part(axes: Axes, part: Part, surface_from_part: Array) -> None:
    """``part`` as it rests, from behind to the front."""
    axes.axis("off")
    axes.set_aspect("equal")
    triangles = transform_points(surface_from_part, part.mesh.triangles)
    normals = part.mesh.face_normals @ surface_from_part[:3, :3].T
    seen = triangles @ _CAMERA.T
    front = np.flatnonzero((normals @ _CAMERA.T)[:, 2] > 0.0)
    order = front[np.argsort(seen[front, :, 2].mean(axis=1))]
    light = 0.55 + 0.45 * np.clip(normals[order] @ _LIGHT / np.linalg.norm(_LIGHT), 0.0, 1.0)
    colors = np.clip(light[:, None] * np.array(_STEEL) * 1.25, 0.0, 1.0)
    axes.add_collection(PolyCollection(list(seen[order, :, :2]), facecolors=colors, edgecolors=colors, linewidths=0.4))
    middle = (seen.min(axis=(0, 1)) + seen.max(axis=(0, 1)))[:2] / 2.0
    half = np.linalg.norm(part.mesh.extents) / 2.0
    axes.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
