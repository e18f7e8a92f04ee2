"""A plan as one HTML page that plays offline: the robot, its hands and the parts move, the steps stand beside."""

from __future__ import annotations

import html
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from ..errors import InputError, UnknownNameError
from ..robots.robot import Robot
from ..transforms import Array, pose
from .cell import robot_of
from .document import Plan
from .film import Film, film
from .page import Command, backdrop, group, material, mesh_geometry, packed_commands, write_page
from .player import CONTROLS, STYLE, packed_motion, player_script
from .task import Task
from .task_file import task_of

_RATE = 30.0  # moments a second
_MOST_MOMENTS = 36_000  # 20 minutes at that rate
_SHARES = (1.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16)  # of the moments
_MOST_MOTION, _MOST_GEOMETRY = 3_000_000, 1_900_000  # bytes of the page; the viewer takes 0.9 MB
_CELLS = (0.0, 0.25e-3, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, 16e-3)  # m, of the grids that thin meshes
_ROBOT, _HAND, _OBSTACLE, _FIXTURE = 0xF0F2F5, 0x59616E, 0x9AA4AD, 0xC8D4E0
_PARTS = (0xE8801A, 0x2378C3, 0x36A345, 0xC9342F, 0x8A5FC0, 0xE0B000, 0xD8619F, 0x18A7B5, 0x8C5A3C, 0x7F8F22)
_ANGLE = 35.0  # deg
_MARGIN = 0.6  # m
_FROM = np.array([0.86, 0.27, 0.43])  # unit vector from what the camera sees to the camera: robots look along +x


class _Body(NamedTuple):
    """What the page shows of a rigid body: its path in the scene, its triangles, its colour and where these are."""

    path: str
    mesh: trimesh.Trimesh
    color: int
    placement: Array


def write_replay(plan: Plan, path: str | Path) -> None:
    """Write a page of at most 6 MB that plays ``plan`` in a browser, offline.

    Long plans are drawn at fewer moments and fine meshes thinned, so that the page keeps to its size.

    Raises:
        InputError: The plan has no action, or its robot or task are not to be had as they were.
        OSError: The page cannot be written.
    """
    task = task_of(plan.task)
    robot = robot_of(task, plan.folder)
    moving, motion = _motion(plan, robot)
    parts = list(plan.actions[0].start.poses)
    bodies = list(_moving(plan, robot, parts))
    commands = _geometry([*bodies, *_standing(plan, task)]) + backdrop()
    camera, target = _view(moving, robot, parts)
    paths = [body.path for body in bodies]
    script = player_script(moving.names, paths, motion, camera, target, _ANGLE)
    title = html.escape(f"{robot.name}: {', '.join(parts)}")
    write_page(path, title, _panel(title, plan, robot, parts), commands, script)


def _motion(plan: Plan, robot: Robot) -> tuple[Film, str]:
    """The film of ``plan``, and its motion as the page has it: at as many moments as there is room for."""
    rate = min(_RATE, _MOST_MOMENTS / max(plan.duration, 1.0))
    for share in _SHARES:
        moving = film(plan, robot, rate * share)
        motion = packed_motion(moving.times, moving.poses)
        if len(motion) <= _MOST_MOTION:
            break
    return moving, motion


def _moving(plan: Plan, robot: Robot, parts: Sequence[str]) -> Iterator[_Body]:
    """The bodies of the film, in its order."""
    here = np.eye(4)
    for i, link in enumerate(robot.links):
        yield _Body(f"robot/{i}", link.mesh, _ROBOT, here)
    for j, hand in enumerate(robot.hands.values()):
        for i, piece in enumerate(hand.pieces):
            yield _Body(f"hands/{j}/{i}", piece.mesh, _HAND, here)
    for i, part in enumerate(parts):
        yield _Body(f"parts/{i}", _mesh(plan, part), _PARTS[i % len(_PARTS)], here)


def _standing(plan: Plan, task: Task) -> Iterator[_Body]:
    """The obstacles of the cell."""
    for i, entry in enumerate(task.cell):
        color = _OBSTACLE if entry.mesh is None else _FIXTURE  # which stands out from the table that it is on
        yield _Body(f"cell/{i}", _mesh(plan, entry.name), color, pose(entry.at.xyz, entry.at.rpy))


def _mesh(plan: Plan, name: str) -> trimesh.Trimesh:
    if name not in plan.meshes:
        raise UnknownNameError("plan: meshes", "mesh", name, tuple(plan.meshes))
    try:
        mesh = plan.meshes[name].trimesh()
    except ValueError:
        mesh = trimesh.Trimesh()
    if not len(mesh.faces) or mesh.faces.max() >= len(mesh.vertices) or not np.isfinite(mesh.vertices).all():
        raise InputError(f"plan: meshes.{name}", "no triangles", "plan the task again")
    return mesh


def _geometry(bodies: Sequence[_Body]) -> list[Command]:
    """What draws ``bodies``, as finely as the page has room for."""
    for cell in _CELLS:
        thin = [_thinned(body.mesh, cell) for body in bodies]
        commands = [
            group(body.path, [("Mesh", mesh_geometry(mesh.vertices, mesh.faces), material(body.color), body.placement)])
            for body, mesh in zip(bodies, thin, strict=True)
        ]
        if len(packed_commands(commands)) <= _MOST_GEOMETRY:
            break
    return commands


def _thinned(mesh: trimesh.Trimesh, cell: float) -> trimesh.Trimesh:
    """``mesh`` with all corners within a cube of side ``cell`` [m] drawn together."""
    if cell == 0.0:
        return mesh
    _, first, which = np.unique(np.rint(mesh.vertices / cell), axis=0, return_index=True, return_inverse=True)
    faces = which.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    return trimesh.Trimesh(mesh.vertices[first], faces[(a != b) & (b != c) & (c != a)], process=False)


def _view(moving: Film, robot: Robot, parts: Sequence[str]) -> tuple[Array, Array]:
    """Place of the camera and what it looks at (3,) [m]: from the robot's front at all that hands and parts do."""
    bases = [f"{arm}/{hand.pieces[0].name}" for arm, hand in robot.hands.items()]
    places = np.concatenate([moving.of(name)[:, :3, 3] for name in (*bases, *parts)])
    low, high = places.min(axis=0), places.max(axis=0)
    target = (low + high) / 2.0
    far = float(np.linalg.norm(high - low)) / 2.0 / np.tan(np.radians(_ANGLE / 2.0)) + _MARGIN
    return target + far * _FROM, target


def _panel(title: str, plan: Plan, robot: Robot, parts: Sequence[str]) -> str:
    """HTML of what stands beside the scene."""
    starts = np.cumsum([0.0, *(action.motion.duration for action in plan.actions)])
    steps = "".join(
        f'<li data-start="{start:.6f}"><span>{number}</span><span>{html.escape(action.words)}</span>'
        f"<time>{start:.1f} s + {action.motion.duration:.1f} s</time></li>"
        for number, (start, action) in enumerate(zip(starts, plan.actions, strict=False), start=1)
    )
    shown = [("robot", robot.name, _ROBOT), ("hands", "hands", _HAND)]
    shown += [("cell", "cell", _OBSTACLE)] if len(plan.meshes) > len(parts) else []
    shown += [(f"parts/{i}", part, _PARTS[i % len(_PARTS)]) for i, part in enumerate(parts)]
    legend = "".join(
        f'<label><input type="checkbox" data-path="{path}" checked> <b style="color:#{color:06x}">&#9632;</b> '
        f"{html.escape(name)}</label>"
        for path, name, color in shown
    )
    about = f"{len(plan.actions)} step{'s' if len(plan.actions) > 1 else ''}, {plan.duration:.1f} s"
    return f'{STYLE}<h1>{title}</h1><p>{about}</p>{CONTROLS}<ol id="steps">{steps}</ol><div id="legend">{legend}</div>'
