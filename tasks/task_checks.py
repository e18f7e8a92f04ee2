"""What can be wrong in a task whose fields are all of the right type: names, numbers, files that do not fit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from difflib import get_close_matches
from pathlib import Path, PureWindowsPath
from typing import NamedTuple

from ..errors import InputError
from ..grasping.parameters import GraspParameters
from ..transforms import rotation_from_rpy
from .task import (
    Area,
    At,
    Attach,
    Axis,
    HandOver,
    Insert,
    Mounted,
    Obstacle,
    OwnRobot,
    PartEntry,
    Place,
    Record,
    Region,
    Task,
    Use,
)

Keys = tuple[str | int, ...]

_HAND_FILES = (".yaml", ".yml")
_NAMED = {  # fields of the goals that name parts, and that name arms
    Attach: (("part", "to"), ("arm", "to_arm")),
    Place: (("part",), ("arm",)),
    HandOver: (("part",), ("to",)),
    Use: (("part",), ("arm",)),
}
_VERTICAL = math.radians(1.0)  # by how much an axis may lean about which a part turns where it stands


class Mistake(NamedTuple):
    """What is wrong in a task: the keys that lead there, the problem, the cure."""

    keys: Keys
    problem: str
    cure: str


def mistakes(task: Task, folder: Path | None) -> Iterator[Mistake]:
    """What is wrong in ``task``; with the folder where its paths start, also files that are not there."""
    yield from _in_files(task, folder)
    yield from _in_poses(task)
    yield from _in_cell(task)
    yield from _in_parts(task)
    yield from _in_goals(task)


def nearest(name: str, known: Sequence[str]) -> str:
    """The cure for a name that does not exist."""
    near = get_close_matches(name, known, 1)
    return f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known) or 'none'}"


def grasp_parameters(entry: PartEntry) -> GraspParameters:
    """The grasp parameters of a part: the paper's, but for those that the task gives.

    Raises:
        InputError: One is outside its range.
    """
    return GraspParameters(**entry.grasps.parameters)


def is_hand_file(hand: str) -> bool:
    """Whether ``hand`` names a YAML file of the user's, not a shipped hand."""
    return hand.endswith(_HAND_FILES)


def _in_files(task: Task, folder: Path | None) -> Iterator[Mistake]:
    for keys, name in _files(task):
        path = PureWindowsPath(name)  # reads either system's paths: a task is sound on both or on none
        if not name or path.anchor or ".." in path.parts[1:]:
            cure = "give a path relative to the task file, at most one folder up, such as ../parts/wheel.stl"
            yield Mistake(keys, f"{name!r} is no path within the task's folder or the one above", cure)
        elif folder is not None and not _exists(folder / name):
            yield Mistake(keys, f"there is no {folder / name}", "check the path; it is relative to the task file")


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # a name too long, a folder that may not be read
        return False


def _files(task: Task) -> Iterator[tuple[Keys, str]]:
    """The paths in a task, with the keys that lead there."""
    if isinstance(task.robot, OwnRobot):
        yield ("robot", "urdf"), task.robot.urdf
        yield ("robot", "srdf"), task.robot.srdf
        if task.robot.limits is not None:
            yield ("robot", "limits"), task.robot.limits
        for i, package in enumerate(task.robot.packages):
            yield ("robot", "packages", i), package
    for arm, hand in task.hands.items():
        name = hand.hand if isinstance(hand, Mounted) else hand
        if is_hand_file(name):
            yield ("hands", arm, "hand") if isinstance(hand, Mounted) else ("hands", arm), name
    for i, obstacle in enumerate(task.cell):
        if obstacle.mesh is not None:
            yield ("cell", i, "mesh"), obstacle.mesh
    for name, part in task.parts.items():
        yield ("parts", name, "mesh"), part.mesh
        for i, file in enumerate(part.grasps.measured):
            yield ("parts", name, "grasps", "measured", i), file


def _in_poses(value: object, keys: Keys = ()) -> Iterator[Mistake]:
    """Poses that are not finite: files have none, tasks built in code may."""
    entries: Iterable[tuple[str | int, object]] = ()
    if isinstance(value, At):
        if not all(map(math.isfinite, (*value.xyz, *value.rpy))):
            yield Mistake(keys, "a number in this pose is not finite", "give finite numbers [m, rad]")
    elif isinstance(value, Record):
        entries = ((field, getattr(value, field)) for field in value.__struct_fields__)
    elif isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, tuple):
        entries = enumerate(value)
    for key, entry in entries:
        yield from _in_poses(entry, (*keys, key))


def _in_cell(task: Task) -> Iterator[Mistake]:
    if not 0.0 < task.speed <= 1.0:
        yield Mistake(("speed",), f"{task.speed:g} is no share of the joint limits", "give more than 0, at most 1")
    for joint, value in task.start.items():
        if not math.isfinite(value):
            yield Mistake(("start", joint), f"{value} is no position", "give a finite number")
    taken, cure = {"", *task.hands}, "give each thing a name of its own"
    for i, obstacle in enumerate(task.cell):
        if obstacle.name in taken:
            yield Mistake(("cell", i, "name"), f"the name {obstacle.name!r} is empty or taken", cure)
        taken.add(obstacle.name)
        yield from _below(("cell", i), _in_obstacle(obstacle))
    for name in task.parts:
        if name in taken:
            yield Mistake(("parts", name), f"the name {name!r} is empty or taken", cure)


def _in_obstacle(obstacle: Obstacle) -> Iterator[Mistake]:
    if (obstacle.box is None) == (obstacle.mesh is None):
        given = "neither box nor mesh is given" if obstacle.box is None else "box and mesh are both given"
        yield Mistake((), given, "give one: box [x, y, z] or mesh and unit")
    yield from _in_box(obstacle)
    if (obstacle.mesh is None) != (obstacle.unit is None):
        given = "a mesh without a unit" if obstacle.unit is None else "a unit without a mesh"
        yield Mistake((), given, "give both: what one unit of the mesh is, mm, cm, m or in")


def _in_box(entry: Obstacle | Region) -> Iterator[Mistake]:
    if entry.box is not None and not all(0.0 < side < math.inf for side in entry.box):
        yield Mistake(("box",), "a side is not above 0", "give three lengths above 0")


def _in_parts(task: Task) -> Iterator[Mistake]:
    for name, part in task.parts.items():
        if (part.mass is None) == (part.density is None):
            given = "neither mass nor density is given" if part.mass is None else "mass and density are both given"
            yield Mistake(("parts", name), given, "give one, such as mass: 50 g or density: 2.7 g/cm3")
        for field, value in (("mass", part.mass), ("density", part.density)):
            if value is not None and not 0.0 < value < math.inf:
                yield Mistake(("parts", name, field), f"{value:g} is no {field}", "give more than 0")
        try:
            grasp_parameters(part)
        except InputError as error:
            yield Mistake(("parts", name, "grasps", error.place), error.problem, error.cure)
        if "" in part.frames:
            yield Mistake(("parts", name, "frames"), "the name of a frame is empty", "give each frame a name")
        for i, region in enumerate(part.no_touch):
            yield from _below(("parts", name, "no_touch", i), _in_box(region))


def _in_goals(task: Task) -> Iterator[Mistake]:
    carrier: dict[str, str] = {}
    for i, goal in enumerate(task.goals):
        kinds = [kind for kind in goal.__struct_fields__ if getattr(goal, kind) is not None]
        if len(kinds) != 1:
            given = f"{' and '.join(kinds)} are one goal" if kinds else "it says nothing"
            yield Mistake(("goals", i), given, f"give one of {', '.join(goal.__struct_fields__)}")
            continue
        at: Keys = ("goals", i, kinds[0])
        yield from _below(at, _in_goal(task, getattr(goal, kinds[0])))
        if goal.attach is not None:
            part, to = goal.attach.part, goal.attach.to
            if part in carrier:
                yield Mistake((*at, "part"), f"{part} is attached to {carrier[part]} already", "attach it once")
            above = to
            while above in carrier and above != part:
                above = carrier[above]
            if above == part:
                yield Mistake((*at, "to"), f"{to} is {part} itself or attached to it", "attach to another part")
            carrier[part] = to


def _in_goal(task: Task, goal: Attach | Place | HandOver | Use) -> Iterator[Mistake]:
    parts, arms = _NAMED[type(goal)]
    for what, fields, known in (("part", parts, tuple(task.parts)), ("arm with a hand", arms, tuple(task.hands))):
        for field in fields:
            name = getattr(goal, field)
            if name is not None and name not in known:
                yield Mistake((field,), f"there is no {what} named {name!r}", nearest(name, known))
    match goal:
        case Attach():
            yield from _in_attach(goal)
        case Place():
            yield from _in_place(task, goal)
        case HandOver():
            yield from _in_hand_over(task, goal)
        case Use():
            yield from _in_use(task, goal)


def _in_attach(goal: Attach) -> Iterator[Mistake]:
    if goal.arm is not None and goal.arm == goal.to_arm:
        yield Mistake(("to_arm",), "it is the arm that holds the other part", "give two arms, or leave one out")
    yield from _below(("insert",), _in_way(goal.insert))


def _in_place(task: Task, goal: Place) -> Iterator[Mistake]:
    if (goal.at is None) == (goal.area is None):
        given = "neither at nor area is given" if goal.at is None else "at and area are both given"
        yield Mistake((), given, "give one: at, a pose, or area, such as {on: table}")
    yield from _in_direction("any_turn", goal.any_turn)
    if goal.area is not None:
        yield from _below(("area",), _in_area(task, goal.area))
        if goal.any_turn is not None:
            yield Mistake(("any_turn",), "in an area every turn is free already", "leave it out")
    elif goal.at is not None and goal.any_turn is not None:
        world_from_part = rotation_from_rpy(goal.at.rpy)
        x, y, z = world_from_part @ goal.any_turn
        if math.atan2(math.hypot(x, y), abs(z)) > _VERTICAL:
            upright = ", ".join(f"{component + 0.0:.4g}" for component in world_from_part[2].round(4))
            problem = "this axis is not vertical at the goal's pose: the part would tilt as it turns"
            yield Mistake(("any_turn",), problem, f"give the axis of the part that is vertical there: [{upright}]")


def _in_area(task: Task, area: Area) -> Iterator[Mistake]:
    supports = {obstacle.name: obstacle.support for obstacle in task.cell}
    if area.on not in supports:
        known = tuple(name for name, support in supports.items() if support)
        yield Mistake(("on",), f"there is no support named {area.on!r}", nearest(area.on, known))
    elif not supports[area.on]:
        cure = "add support: true to it in the cell, or name one that has it"
        yield Mistake(("on",), f"{area.on} is no support", cure)
    if area.corners is not None:
        sides = [abs(b - a) for a, b in zip(*area.corners, strict=True)]
        if not all(0.0 < side < math.inf for side in sides):
            problem = "these are not two opposite corners of a rectangle"
            yield Mistake(("corners",), problem, "let them differ in x and in y, such as [[0.3, -0.2], [0.5, 0.2]]")
    yield from _in_direction("up", area.up)


def _in_hand_over(task: Task, goal: HandOver) -> Iterator[Mistake]:
    yield from _in_direction("any_turn", goal.any_turn)
    if goal.interlocked and len(task.hands) < 2:
        yield Mistake(("interlocked",), "there is no other hand to give it", "give another arm a hand, or leave it out")


def _in_use(task: Task, goal: Use) -> Iterator[Mistake]:
    tool = task.parts.get(goal.part)
    if tool is not None and goal.frame not in tool.frames:
        problem = f"{goal.part} has no frame named {goal.frame!r}"
        yield Mistake(("frame",), problem, nearest(goal.frame, tuple(tool.frames)))
    things = (*(obstacle.name for obstacle in task.cell), *(name for name in task.parts if name != goal.part))
    if goal.of == goal.part:
        yield Mistake(("of",), f"{goal.part} is the tool itself", "name an obstacle or another part, or leave it out")
    elif goal.of is not None and goal.of not in things:
        yield Mistake(("of",), f"there is no obstacle or part named {goal.of!r}", nearest(goal.of, things))
    yield from _below(("approach",), _in_way(goal.approach))
    yield from _in_direction("any_turn", goal.any_turn)


def _in_way(way: Insert) -> Iterator[Mistake]:
    yield from _in_direction("direction", way.direction)
    if not 0.0 < way.distance < math.inf:
        yield Mistake(("distance",), f"{way.distance:g} m is no way", "give more than 0, such as 70 mm")


def _in_direction(field: str, direction: Axis | None) -> Iterator[Mistake]:
    if direction is not None and not (any(direction) and all(map(math.isfinite, direction))):
        yield Mistake((field,), "it is no direction", "give a vector such as [0, -1, 0]")


def _below(keys: Keys, found: Iterable[Mistake]) -> Iterator[Mistake]:
    """What was ``found`` in the entry to which ``keys`` lead, with all the keys."""
    return (mistake._replace(keys=(*keys, *mistake.keys)) for mistake in found)
