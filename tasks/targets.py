"""Where a goal allows a part to be: one pose, a pose at any turn about an axis, or anywhere in an area."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..errors import InputError, NoRegraspError
from ..regrasp.nodes import spots_for
from ..regrasp.placements import find_placements
from ..regrasp.reach import Node, Reacher
from ..regrasp.supports import Support
from ..transforms import Array, compose, invert, pose, rotation_about, transform_points
from .job import Job
from .task import Area, At, Axis, HandOver, Place

MOST_SPOTS = 16  # of an area that are goals of one search
_TURNS = 12  # evenly over a full one, where any will do
_SPACING = 0.02  # m between spots in an area
_INSET = 5e-3  # m that `find_spots` keeps from the edge of what it is given
_ROUNDING = 1e-9  # m
_REACH = 1e-3  # m; a support lies no farther below a part
_UPRIGHT = float(np.cos(np.radians(1.0)))


def turned(at: At, axis: Axis | None) -> Array:
    """Poses (n, 4, 4) that ``at`` allows: itself first, then it turned about ``axis``, if there is one."""
    wanted = pose(at.xyz, at.rpy)
    if axis is None:
        return wanted[None]
    turns = rotation_about(_unit(axis), 2.0 * np.pi * np.arange(_TURNS) / _TURNS)
    return np.asarray(wanted @ compose(turns, np.zeros(3)))


def place_nodes(job: Job, goal: Place) -> list[Node]:
    """Where the part of ``goal``, or what it is assembled to, may be put down.

    Raises:
        InputError: Nothing is there that it could rest on, or the area is not on the support.
        NoRegraspError: It fits nowhere in the area.
    """
    if goal.area is not None:
        return _in_area(job, goal.part, goal.area)
    assert goal.at is not None
    part = job.root(goal.part)
    wanted = turned(goal.at, goal.any_turn) @ invert(job.pose(goal.part)) @ job.pose(part)
    support = _support_below(job, part, wanted[0])
    return [Node(f"{part} at its goal{_number(i, wanted)}", entry, support) for i, entry in enumerate(wanted)]


def hold_nodes(job: Job, goal: HandOver) -> list[Node]:
    """Where the part of ``goal``, or what it is assembled to, may be held in the end."""
    part = job.root(goal.part)
    wanted = turned(goal.at, goal.any_turn) @ invert(job.pose(goal.part)) @ job.pose(part)
    words = f"{part} held by the {goal.to} arm"
    return [Node(words + _number(i, wanted), entry, None, to_leave=False) for i, entry in enumerate(wanted)]


def lies_in(job: Job, part: str, area: Area) -> bool:
    """Whether ``part``, with what it is assembled to, rests in ``area`` as that asks."""
    root = job.root(part)
    if job.rests_on(root) != area.on:
        return False
    if area.up is not None and job.pose(part)[2, :3] @ _unit(area.up) < _UPRIGHT:
        return False
    rectangle = _rectangle(job, area)
    around = transform_points(invert(rectangle.world_from_support) @ job.pose(root), job.whole(root).part.mesh.vertices)
    return bool((np.abs(around[:, :2]) <= rectangle.size / 2.0).all())


def _in_area(job: Job, part: str, area: Area) -> list[Node]:
    root, rectangle = job.root(part), _rectangle(job, area)
    whole = job.whole(root)
    stable = find_placements(whole.part)
    if area.up is not None:
        up = (invert(job.pose(root)) @ job.pose(part))[:3, :3] @ _unit(area.up)
        stable = stable.take(np.flatnonzero(stable.surface_from_part[:, 2, :3] @ up >= _UPRIGHT))
    # The whole outline shall lie within, not only what the part stands on.
    stable = replace(stable, support=stable.outline)
    within = Support(rectangle.name, rectangle.world_from_support, rectangle.size + 2.0 * _INSET + _ROUNDING)
    reacher = Reacher(job.cell.scene, job.motions.state, root, whole.holders)
    start = Node("start", job.pose(root), job.rests_on(root))
    middle = Node("the area", rectangle.world_from_support, None)
    spots = spots_for(reacher, stable, start, [middle], [within], _SPACING)[:MOST_SPOTS]
    if not spots:
        room = "the area has no room for it" if len(stable) else "it does not rest stably with that direction up"
        raise NoRegraspError(root, room, [f"{len(stable)} stable placements in an area on {area.on}, no spot is free"])
    return spots


def _rectangle(job: Job, area: Area) -> Support:
    """The rectangle of ``area``.

    Raises:
        InputError: It does not lie on its support.
    """
    whole = next((support for support in job.cell.supports if support.name == area.on), None)
    if whole is None:
        raise InputError("goal: area", f"the top of {area.on} is no level rectangle", "give a pose in place of an area")
    if area.corners is None:
        return whole
    low, high = np.min(area.corners, axis=0), np.max(area.corners, axis=0)
    height = whole.world_from_support[2, 3]
    corners = np.array([[x, y, height] for x in (low[0], high[0]) for y in (low[1], high[1])])
    beyond = np.abs(transform_points(invert(whole.world_from_support), corners)[:, :2]) - whole.size / 2.0
    if beyond.max() > 0.0:
        problem = f"the rectangle reaches {1e3 * beyond.max():.0f} mm beyond the top of {area.on}"
        raise InputError("goal: area", problem, "give corners that lie on it")
    return Support(area.on, compose(np.eye(3), [*(low + high) / 2.0, height]), high - low)


def _support_below(job: Job, part: str, wanted: Array) -> str:
    """What ``part``, with what it is assembled to, rests on at ``wanted`` (4, 4): it touches it a millimetre lower."""
    lower = wanted.copy()
    lower[2, 3] -= _REACH
    scene, state, members = job.cell.scene, job.motions.state, job.whole(part).bodies()
    carriers = {*job.cell.parts, *(entry.name for entry in job.cell.task.cell if entry.support)}
    below = [
        name
        for name, body in scene.bodies.items()
        if name not in dict(members) and not state.carrier(name)[0]
        for member, at in members
        if scene.bodies[member].touches(body, invert(lower @ at) @ scene.world_from_body(state, name))
    ]
    for name in below:
        if name in carriers:
            return name
    if below:
        raise InputError(
            f"goal: place {part}", f"{below[0]} below it is no support", "add support: true to it in the cell"
        )
    raise InputError(f"goal: place {part}", "nothing is below it there", "give a pose at which it rests on something")


def _unit(direction: Axis) -> Array:
    given: Array = np.asarray(direction, dtype=float)
    return np.asarray(given / np.linalg.norm(given))


def _number(i: int, wanted: Array) -> str:
    return f", turn {i + 1}" if len(wanted) > 1 else ""
