"""A page that shows the candidate nearest to working, with what is in its way in red."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ..robots.rigid import Rigid
from ..transforms import Array
from .film import still
from .page import Command, backdrop, group, material, mesh_geometry, write_page
from .reasons import Blocked, Report

_ROBOT, _HAND, _OBSTACLE, _PART, _BLOCKING = 0xF0F2F5, 0x59616E, 0x9AA4AD, 0xE8801A, 0xD0021B
_GHOST = 0.6  # opacity of a hand that no arm brings there
_FROM = np.array([0.7, 0.35, 0.45])  # m from what the camera sees to the camera


def write_blocked_page(path: str | Path, report: Report, helps: Sequence[str] = ()) -> None:
    """Write the page: the report, the changes that would help, and the scene if there is a candidate to show.

    Raises:
        OSError: The page cannot be written.
    """
    panel, script = [_heading(report.title)], ""
    commands: list[Command] = []
    if report.blocked is not None:
        red = ", ".join(sorted(report.blocked.bodies))
        panel += [_line(f"in the way, red: {red}")] if red else []
        commands = list(_drawn(report.blocked))
        script = _camera(report.blocked.place)
    panel += map(_line, report)
    if helps:
        panel += [_heading("what would help, one thing at a time"), *map(_line, helps)]
    write_page(path, "no plan", "".join(panel), [*commands, *backdrop()], script)


def _heading(text: str) -> str:
    return f"<h1>{html.escape(text)}</h1>"


def _line(text: str) -> str:
    return f"<p>{html.escape(text)}</p>"


def _camera(target: Array) -> str:
    """What lets the viewer, whose y axis points up, look at ``target`` (3,)."""
    place, at = (f"{x:.4f}, {z:.4f}, {-y:.4f}" for x, y, z in (target + _FROM, target))
    return f"viewer.camera.position.set({place}); viewer.controls.target.set({at}); viewer.controls.update();"


def _drawn(blocked: Blocked) -> Iterator[Command]:
    scene, state, red = blocked.scene, blocked.state, blocked.bodies
    poses = still(scene.robot, state.q, state.openings)
    for i, link in enumerate(scene.robot.links):
        yield _body(f"robot/{i}", link, poses[link.name], _BLOCKING if link.name in red else _ROBOT)
    for arm, hand in scene.robot.hands.items():
        for i, piece in enumerate(hand.pieces):
            name = f"{arm}/{piece.name}"
            yield _body(f"hands/{arm}/{i}", piece, poses[name], _BLOCKING if name in red else _HAND)
    for i, (name, body) in enumerate(scene.bodies.items()):
        color = _BLOCKING if name in red else _OBSTACLE if body.fixed else _PART
        yield _body(f"bodies/{i}", body, scene.world_from_body(state, name), color)
    if blocked.hand is not None:
        arm, base = blocked.hand
        hand = scene.robot.hands[arm]
        pieces = base @ hand.base_from_piece(np.array([state.openings[arm]]))[0]
        for i, (piece, at) in enumerate(zip(hand.pieces, pieces, strict=True)):
            yield _body(f"hand/{i}", piece, at, _HAND, opacity=_GHOST)


def _body(path: str, body: Rigid, at: Array, color: int, opacity: float = 1.0) -> Command:
    geometry = mesh_geometry(body.mesh.vertices, body.mesh.faces)
    return group(path, [("Mesh", geometry, material(color, opacity=opacity), at)])
