"""Cells to ask about collisions: shipped robots among a table, a rack and five parts."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import trimesh

from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, SceneState
from kumitate.transforms import pose


def _prism(outline: list[tuple[float, float]], tiles: list[tuple[int, ...]], height: float) -> trimesh.Trimesh:
    """A closed prism along z over a polygon, counter-clockwise, that convex ``tiles`` of its corners fill."""
    flat, n = np.array(outline), len(outline)
    vertices = np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (-height / 2.0, height / 2.0)])
    cap = np.array([(a, b, c) for a, *rest in tiles for b, c in itertools.pairwise(rest)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    sides = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    return trimesh.Trimesh(vertices, np.vstack([cap[:, ::-1], cap + n, sides]))


def _bracket(side: float, thickness: float, height: float) -> trimesh.Trimesh:
    """An L of two plates along x and y, its outer corner at the origin, ``height`` along z."""
    s, t = side, thickness
    return _prism([(0, 0), (s, 0), (s, t), (t, t), (t, s), (0, s)], [(0, 1, 2, 3), (0, 3, 4, 5)], height)


def _fork(side: float, thickness: float, height: float) -> trimesh.Trimesh:
    """A U, open along +y, about the origin; ``height`` along z."""
    a, b = side / 2.0, side / 2.0 - thickness
    outline = [(-a, -a), (a, -a), (a, a), (b, a), (b, -b), (-b, -b), (-b, a), (-a, a)]
    return _prism(outline, [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)], height)


def _wheel(bore: float, radius: float, width: float) -> trimesh.Trimesh:
    """A thin disc with a thick hub and a thick rim about z, a bore through the hub."""
    hub, rim, web = bore + 0.2 * (radius - bore), bore + 0.8 * (radius - bore), width / 4.0
    half = [(bore, width), (hub, width), (hub, web), (rim, web), (rim, width), (radius, width)]
    profile = [(r, z / 2.0) for r, z in half] + [(r, -z / 2.0) for r, z in reversed(half)]
    return trimesh.creation.revolve(np.array([*profile, profile[0]]), sections=48)


def _bossed(size: float, at: float, rise: float, height: float) -> trimesh.Trimesh:
    """A square block whose face at +x has a boss, ``rise`` high, where y is above ``at``; ``height`` along z."""
    a = size / 2.0
    outline = [(-a, -a), (a, -a), (a, at), (a + rise, at), (a + rise, a), (-a, a), (-a, at)]
    return _prism(outline, [(0, 1, 2, 6), (2, 3, 4, 5, 6)], height)


MAKERS: dict[str, Callable[..., trimesh.Trimesh]] = {
    "bracket": _bracket,
    "fork": _fork,
    "bossed": _bossed,
    "wheel": _wheel,
    "ring": lambda bore, radius, width: trimesh.creation.annulus(bore, radius, width, sections=64),
}


def _bodies(table: float) -> list[Body]:
    return [
        Body.box("table", (0.6, 1.2, 0.06), fixed=True),
        Body.from_mesh("rack", _fork(0.25, 0.03, 0.3), fixed=True),
        Body.from_mesh("bracket", _bracket(0.06, 0.012, 0.05)),
        Body.from_mesh("ring", MAKERS["ring"](0.022, 0.03, 0.06)),
        Body.from_mesh("fork", _fork(0.1, 0.015, 0.04)),
        Body.from_mesh("wheel", _wheel(0.01, 0.06, 0.03)),
        Body.box("block", (0.03, 0.05, 0.1)),
    ]


CELLS = {
    "ur3_dual": ({"left": "robotiq_2f85", "right": "robotiq_2f85"}, (0.75, 0.0, 1.05)),
    "nextage": ({"left": "robotiq_2f85", "right": "suction_cup"}, (0.5, 0.0, -0.08)),
    "hrp5p": ({"left": "hrp5p_three_finger", "right": "robotiq_2f85"}, (0.6, 0.0, 0.1)),
}


def make_cell(name: str) -> tuple[Scene, list[SceneState]]:
    """A robot with hands, a table, a rack and five parts; and states of it in which no two still bodies touch."""
    hands, table = CELLS[name]
    robot = load_robot(name, hands)
    scene = Scene.of(robot, _bodies(table[2]))
    x, y, z = table
    top = z + 0.03
    lying = scene.state(
        {
            "table": pose(table),
            "rack": pose((x + 0.05, y - 0.3, top + 0.15), (0.0, 0.0, 0.3)),
            "bracket": pose((x, y + 0.1, top + 0.027)),
            "ring": pose((x - 0.1, y, top + 0.032)),
            "fork": pose((x - 0.15, y + 0.3, top + 0.022), (0.0, 0.0, 1.0)),
            "wheel": pose((x + 0.1, y + 0.3, top + 0.017)),
            "block": pose((x + 0.15, y, top + 0.052)),
        }
    )
    floating = scene.state(
        {
            **lying.poses,
            "bracket": pose((x - 0.1, y + 0.25, top + 0.3), (0.4, 0.2, 0.1)),
            "fork": pose((x - 0.2, y, top + 0.25), (1.0, 0.3, 0.0)),
            "wheel": pose((x - 0.15, y - 0.2, top + 0.3), (0.2, 1.2, 0.0)),
        },
        openings={arm: hand.stroke[1] / 2.0 for arm, hand in robot.hands.items()},
    )
    # Parts held clear of the fingers; the wheel hangs on the ring, the ring on the right hand.
    held = lying
    grips = {
        "bracket": ("left", pose((-0.006, 0.0, 0.04), (-np.pi / 2.0, 0.0, 0.0))),
        "ring": ("right", pose((0.0, 0.0, 0.04))),
    }
    for body, (arm, hand_from_body) in grips.items():
        held = held.with_pose(body, robot.hand_pose(arm, held.q, held.openings[arm]) @ hand_from_body)
        held = scene.attach(held, body, arm)
    held = held.with_pose("wheel", scene.world_from_body(held, "ring") @ pose((0.0, 0.0, 0.05)))
    held = scene.attach(held, "wheel", "ring")
    return scene, [lying, floating, held]
