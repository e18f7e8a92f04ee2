"""Nodes between start and goal: where a part may be put down, and where hands may give it to each other."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from ..grasping.part import Part
from ..robots.scene import Scene
from ..robots.state import SceneState
from ..transforms import Array, transform_points
from .handovers import sample_handovers
from .placements import Placements, find_placements
from .polygons import outline
from .reach import Node, Reacher
from .supports import Support, find_spots

_SPACING = 0.08  # m between spots
_SPOTS_EACH = 5  # for each placement, turn and support: those on the shortest way
_MOST_HANDOVERS = 64
_ABOVE = 0.25  # m above a support within which a body stands in the way of spots


def between(
    reacher: Reacher,
    part: Part,
    start: Node,
    goals: Sequence[Node],
    supports: Sequence[Support],
    rng: np.random.Generator,
) -> Iterator[Node]:
    """Placements on the supports, the shortest ways first, and handovers; in turns."""
    placements = spots_for(reacher, find_placements(part), start, goals, supports)
    handovers: list[Node] = []
    if len(reacher.holders) > 1:
        turned = [node.world_from_part[:3, :3] for node in (start, *goals[:1])]
        middle = (start.world_from_part[:3, 3] + _ends(start, goals).mean(axis=0)) / 2.0
        handovers = sample_handovers(reacher.scene.robot, list(reacher.holders), middle, turned, rng)[:_MOST_HANDOVERS]
    for placement, handover in itertools.zip_longest(placements, handovers):
        yield from (node for node in (placement, handover) if node is not None)


def spots_for(
    reacher: Reacher,
    stable: Placements,
    start: Node,
    goals: Sequence[Node],
    supports: Sequence[Support],
    spacing: float = _SPACING,
) -> list[Node]:
    """Free spots, ``spacing`` [m] apart, and turns on ``supports`` at which the part rests in ``stable`` placements.

    Those on the shortest ways to a goal are the first.
    """
    if not supports:
        return []
    scene, state = reacher.scene, reacher.state_at(start)
    at, ends = start.world_from_part[:3, 3], _ends(start, goals)
    found: list[tuple[float, Node]] = []
    for support in supports:
        occupied = _occupied(scene, state, reacher.part, support)
        spots = find_spots(stable, support, spacing=spacing, occupied=occupied)
        places = spots.world_from_part[:, :3, 3]
        way = np.linalg.norm(places - at, axis=1) + np.linalg.norm(places[:, None] - ends, axis=-1).min(axis=1)
        order = np.lexsort((way, spots.turn, spots.placement))
        kinds = np.stack([spots.placement[order].astype(float), spots.turn[order]], axis=1)
        first = np.r_[True, (np.diff(kinds, axis=0) != 0.0).any(axis=1)]
        rank = np.arange(len(order)) - np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
        for i, place in zip(order[rank < _SPOTS_EACH], rank[rank < _SPOTS_EACH], strict=True):
            words = f"placement {spots.placement[i] + 1}, turned {np.degrees(spots.turn[i]):.0f} deg, on {support.name}"
            node = Node(f"{words} ({place + 1})", spots.world_from_part[i], support.name)
            found.append((float(place + way[i]), node))  # near ones of every kind before the second of any
    return [node for _, node in sorted(found, key=lambda entry: entry[0])]


def _ends(start: Node, goals: Sequence[Node]) -> Array:
    """Positions (g, 3) of the goals, or of the start where there are none."""
    return np.array([node.world_from_part[:3, 3] for node in goals or [start]])


def _occupied(scene: Scene, state: SceneState, part: str, support: Support) -> list[Array]:
    """Outlines (k, 2) of the bodies that stand on ``support`` or reach over it."""
    outlines, top = [], support.world_from_support[2, 3]
    for name, body in scene.bodies.items():
        arm, pose = state.carrier(name)
        if name in (part, support.name) or arm:
            continue
        points = transform_points(pose, body.mesh.vertices)
        if points[:, 2].max() > top + 1e-3 and points[:, 2].min() < top + _ABOVE:
            outlines.append(outline(points))
    return outlines
