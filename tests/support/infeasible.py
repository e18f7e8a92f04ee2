"""Tasks without a plan, on a Nextage at its table, each with what stands in the way and with what would cure it.

Those of `ONE` have one cause, those of `TWO` two that compete.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import pi
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import trimesh
from msgspec.structs import replace

from kumitate.tasks.planner import plan
from kumitate.tasks.reasons import NoPlanError
from kumitate.tasks.task import Area, At, Attach, Goal, Grasping, Insert, Obstacle, PartEntry, Place, Task

_TOP = -0.05  # m, of the table
_COARSE = Grasping(t_rnn=0.006)  # enough grasps
_FEW = Grasping(t_rnn=0.02, n_da=4)  # so that few motions are tried


@dataclass(frozen=True)
class Infeasible:
    """A task without a plan.

    Attributes:
        task: The task; its paths are relative to `folder`.
        where: What does not work.
        causes: What stands in the way, the gravest first: words, and bodies.
        cured: The task with enough of them taken away for a plan.
    """

    task: Task
    where: str
    causes: tuple[tuple[str, tuple[str, ...]], ...]
    cured: Task


# Meshes ---------------------------------------------------------------------------------------------------------------


def _barred() -> trimesh.Trimesh:
    """A tube with a bar across its bore."""
    return trimesh.boolean.union([MESHES["tube"](), trimesh.creation.box([0.004, 0.03, 0.004])], engine="manifold")


def _post() -> trimesh.Trimesh:
    """A post with a head, from z = 0 upwards."""
    post, head = (trimesh.creation.cylinder(r, h, sections=32) for r, h in ((0.010, 0.096), (0.026, 0.004)))
    post.apply_translation([0.0, 0.0, 0.048])
    head.apply_translation([0.0, 0.0, 0.094])
    return trimesh.boolean.union([post, head], engine="manifold")


MESHES: dict[str, Callable[[], trimesh.Trimesh]] = {
    "block": lambda: trimesh.creation.box([0.03, 0.03, 0.12]),
    "slab": lambda: trimesh.creation.box([0.1, 0.1, 0.1]),
    "plate": lambda: trimesh.creation.box([0.07, 0.07, 0.004]),
    "puck": lambda: trimesh.creation.box([0.06, 0.06, 0.03]),
    "ring": lambda: trimesh.creation.annulus(0.022, 0.030, 0.04, sections=32),
    "peg": lambda: trimesh.creation.cylinder(0.009, 0.09, sections=32),
    "pin": lambda: trimesh.creation.cylinder(0.009, 0.03, sections=32),
    "tube": lambda: trimesh.creation.annulus(0.011, 0.025, 0.05, sections=32),
    "stand": lambda: trimesh.creation.cylinder(0.05, 0.02, sections=48),
    "barred": _barred,
    "post": _post,
}


@cache
def _made() -> TemporaryDirectory[str]:
    made = TemporaryDirectory()
    for name, make in MESHES.items():
        make().export(Path(made.name) / f"{name}.stl")
    return made


def folder() -> Path:
    """Folder with the meshes; it lasts as long as the process."""
    return Path(_made().name)


@cache
def refusal(name: str) -> NoPlanError:
    """The error with which planning a task of `ONE` or `TWO` ends."""
    with pytest.raises(NoPlanError) as caught:
        plan((ONE | TWO)[name].task, folder(), time_limit=600.0)
    return caught.value


# Tasks ----------------------------------------------------------------------------------------------------------------


def _above(z: float) -> float:
    return round(_TOP + z, 6)


def _box(name: str, x: float, y: float, z: float, *sides: float, support: bool = False) -> Obstacle:
    """A box with its middle ``z`` above the table."""
    return Obstacle(name, At((x, y, _above(z))), box=sides, support=support)


def _part(mesh: str, x: float, y: float, z: float, mass: float = 0.1) -> PartEntry:
    return PartEntry(f"{mesh}.stl", "m", At((x, y, _above(z))), mass=mass, grasps=_COARSE)


def _place(part: str, x: float, y: float, z: float, roll: float = 0.0) -> Goal:
    return Goal(place=Place(part, At((x, y, _above(z)), (roll, 0.0, 0.0))))


TABLE = _box("table", 0.4, 0.0, -0.01, 0.3, 1.32, 0.02, support=True)
BLOCK = _part("block", 0.4, 0.25, 0.06)
ASIDE = _place("block", 0.4, 0.35, 0.06)


def moving(part: str, entry: PartEntry, goal: Goal, *cell: Obstacle) -> Task:
    """One part on the table goes elsewhere, among obstacles."""
    hands = {"left": "robotiq_2f85", "right": "robotiq_2f85"}
    return Task("nextage", hands, {part: entry}, (goal,), cell=(TABLE, *cell))


def _joining(part: str, height: float, to: str, z: float, rpy: tuple[float, float, float]) -> Task:
    """A part of some height goes into a tube, in the air or where that stands."""
    attach = Attach(part, to, At((0.0, 0.0, z), rpy), Insert((0.0, 0.0, 1.0), 0.04))
    parts = {part: _part(part, 0.35, 0.35, height / 2.0), to: _part(to, 0.35, -0.2, 0.025)}
    return replace(moving(part, parts[part], Goal(attach=attach)), parts=parts)


PUT_ASIDE = moving("block", BLOCK, ASIDE)
_SLAB = moving("slab", _part("slab", 0.4, 0.25, 0.05), _place("slab", 0.4, 0.35, 0.05))
_PLATE = moving("plate", _part("plate", 0.4, 0.25, 0.002), _place("plate", 0.4, 0.35, 0.002))
_PUCK = moving("puck", replace(_part("puck", 0.4, 0.25, 0.015), grasps=_FEW), _place("puck", 0.4, 0.38, 0.015))
_STANDS = tuple(
    Obstacle(name, At((0.4, y, _TOP + 0.01)), mesh="stand.stl", unit="m", support=True)
    for name, y in (("stand", 0.25), ("other_stand", 0.4))
)
_TURNED_OVER = replace(
    moving("puck", _part("puck", 0.4, 0.25, 0.035), _place("puck", 0.4, 0.4, 0.035, pi)),
    hands={"left": "robotiq_2f85"},
    cell=(replace(TABLE, support=False), *_STANDS, _box("shelf", 0.45, -0.2, 0.01, 0.03, 0.03, 0.02, support=True)),
)
_CORNER = Goal(place=Place("block", area=Area("table", ((0.37, 0.35), (0.43, 0.41)))))
_CRATE = _box("crate", 0.4, 0.38, 0.05, 0.1, 0.1, 0.1)
_JOINED = _joining("peg", 0.09, "tube", -0.045, (pi, 0.0, 0.0))
_RING = replace(
    moving(
        "ring",
        replace(_part("ring", 0.4, 0.25, 0.12), grasps=Grasping(t_rnn=0.01)),
        _place("ring", 0.4, 0.38, 0.12),
        _box("bench", 0.4, 0.33, 0.05, 0.05, 0.26, 0.1, support=True),
    ),
    hands={"left": "robotiq_2f85"},
)
_AT_START, _AT_GOAL = "no grasp of {} works where it is", "no grasp of {} works at its goal"
_NO_IK = "no inverse kinematics at the grasp"


def _with(task: Task, *cell: Obstacle) -> Task:
    return replace(task, cell=(*task.cell, *cell))


ONE = {
    "a part wider than the hand": Infeasible(
        _SLAB,
        _AT_START.format("slab"),
        (("robotiq_2f85 has no grasp, wider than the hand opens:", ("slab",)),),
        replace(
            _SLAB,
            parts={"slab": replace(_SLAB.parts["slab"], mesh="puck.stl", at=At((0.4, 0.25, -0.035)))},
            goals=(_place("slab", 0.4, 0.35, 0.015),),
        ),
    ),
    "a part too heavy": Infeasible(
        moving("block", replace(BLOCK, mass=8.0), ASIDE),
        _AT_START.format("block"),
        (("robotiq_2f85 has no grasp, turns under gravity:", ("block",)),),
        PUT_ASIDE,
    ),
    "a goal out of reach": Infeasible(
        moving("block", BLOCK, _place("block", 0.5, 0.6, 0.06)), _AT_GOAL.format("block"), ((_NO_IK, ()),), PUT_ASIDE
    ),
    "a start out of reach": Infeasible(
        moving("block", _part("block", 0.5, 0.6, 0.06), ASIDE), _AT_START.format("block"), ((_NO_IK, ()),), PUT_ASIDE
    ),
    "a lid over the part": Infeasible(
        _with(PUT_ASIDE, _box("lid", 0.4, 0.25, 0.13, 0.2, 0.2, 0.01)),
        _AT_START.format("block"),
        (("against", ("lid",)),),
        PUT_ASIDE,
    ),
    "a goal that is occupied": Infeasible(
        _with(PUT_ASIDE, _CRATE), _AT_GOAL.format("block"), (("part against", ("crate",)),), PUT_ASIDE
    ),
    "an area that is occupied": Infeasible(
        replace(_with(PUT_ASIDE, _CRATE), goals=(_CORNER,)),
        "no way was found",
        (("the area has no room for it", ()),),
        replace(PUT_ASIDE, goals=(_CORNER,)),
    ),
    "a part too flat": Infeasible(
        _PLATE,
        _AT_START.format("plate"),
        (("hand against", ("table",)),),
        replace(_PLATE, hands={"left": "suction_cup", "right": "suction_cup"}),
    ),
    "a bar over the part": Infeasible(
        _with(_PUCK, _box("bar", 0.4, 0.25, 0.036, 0.2, 0.006, 0.006)),
        "no motion was found",
        (("motion blocked by", ("bar",)),),
        _PUCK,
    ),
    "a bar across the bore": Infeasible(
        _joining("peg", 0.09, "barred", -0.045, (pi, 0.0, 0.0)),
        "peg is not joined to barred",
        (("parts touch on the straight way:", ("peg", "barred")),),
        _JOINED,
    ),
    "a pin that goes in whole": Infeasible(
        _joining("pin", 0.03, "tube", 0.0, (pi, 0.0, 0.0)),
        "pin is not joined to tube",
        (("every hand on pin is in the way of", ("tube",)),),
        _joining("pin", 0.03, "tube", -0.03, (pi, 0.0, 0.0)),
    ),
    "an assembly pose too low": Infeasible(
        replace(_JOINED, goals=(Goal(attach=replace(_JOINED.goals[0].attach, where=At((0.4, 0.0, -0.02)))),)),
        _AT_GOAL.format("peg"),
        (("part against", ("table",)),),
        _JOINED,
    ),
    "no grasp shared, and no way to regrasp": Infeasible(
        _TURNED_OVER,
        "no way was found",
        (("no grasp is shared by start and goal, and there is no support to put it down on", ()),),
        replace(_TURNED_OVER, goals=(_place("puck", 0.4, 0.4, 0.035),)),
    ),
    "a ring on a post with a head": Infeasible(  # takes long: many searches for motions come to their end
        _with(_RING, Obstacle("post", At((0.4, 0.25, _TOP + 0.1)), mesh="post.stl", unit="m")),
        "no motion was found",
        (("motion blocked by", ("post",)),),
        _RING,
    ),
}

_WALL_X = _box("wall_x", 0.424, 0.25, 0.06, 0.01, 0.1, 0.12)
_WALL_Y = _box("wall_y", 0.4, 0.274, 0.06, 0.03, 0.01, 0.12)
_LEFT, _RIGHT = (_box(f"{side}_wall", 0.4, y, 0.15, 0.3, 0.01, 0.3) for side, y in (("left", 0.12), ("right", -0.12)))
_BETWEEN = moving("block", _part("block", 0.4, 0.0, 0.06), _place("block", 0.4, 0.05, 0.06))
_TO_THE_RIGHT = moving("block", _part("block", 0.4, -0.2, 0.06), _place("block", 0.4, -0.45, 0.06))
_HEAVY_SLAB = replace(
    moving("slab", _part("slab", 0.4, 0.25, 0.05, mass=6.0), _place("slab", 0.4, 0.35, 0.05)),
    hands={"left": "robotiq_2f85", "right": "suction_cup"},
)

TWO = {
    "two walls, each before half of the grasps": Infeasible(
        _with(PUT_ASIDE, _WALL_X, _WALL_Y),
        _AT_START.format("block"),
        (("hand against", ("wall_x",)), ("hand against", ("wall_y",))),
        _with(PUT_ASIDE, _WALL_Y),
    ),
    "a wall before either arm": Infeasible(
        _with(_BETWEEN, _LEFT, _RIGHT),
        _AT_GOAL.format("block"),
        (("against", ("left_wall",)), ("against", ("right_wall",))),
        _with(_BETWEEN, _RIGHT),
    ),
    "a lid before one arm, out of reach of the other": Infeasible(
        _with(_TO_THE_RIGHT, _box("lid", 0.4, -0.45, 0.13, 0.2, 0.2, 0.01)),
        _AT_GOAL.format("block"),
        (("against", ("lid",)), (_NO_IK, ())),
        _TO_THE_RIGHT,
    ),
    "a crate on the goal, and a lid over it": Infeasible(
        _with(PUT_ASIDE, _CRATE, _box("lid", 0.4, 0.38, 0.17, 0.2, 0.1, 0.01)),
        _AT_GOAL.format("block"),
        (("part against", ("crate",)), ("against", ("lid",))),
        PUT_ASIDE,
    ),
    "too wide for one hand, too heavy for the other": Infeasible(
        _HEAVY_SLAB,
        _AT_START.format("slab"),
        (
            ("suction_cup has no grasp, turns under gravity:", ("slab",)),
            ("robotiq_2f85 has no grasp, wider than the hand opens:", ("slab",)),
        ),
        replace(_HEAVY_SLAB, parts={"slab": replace(_HEAVY_SLAB.parts["slab"], mass=0.02)}),
    ),
}
