"""What does not fit together in a task built in code: every mistake has the keys that lead to it."""

from __future__ import annotations

from math import cos, inf, nan, pi, radians, sin

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from kumitate.tasks.task import (
    Area,
    At,
    Goal,
    Grasping,
    HandOver,
    Insert,
    Mounted,
    Obstacle,
    OwnRobot,
    PartEntry,
    Place,
    Region,
    Task,
    Use,
)
from kumitate.tasks.task_checks import mistakes

PEN = PartEntry("pen.stl", "mm", At(), mass=0.1, frames={"tip": At((0.0, 0.0, 0.1))})
TASK = Task(
    robot="nextage",
    hands={"left": "robotiq_2f85", "right": "robotiq_2f85"},
    parts={"pen": PEN},
    goals=(),
    cell=(Obstacle("table", At(), box=(0.3, 1.3, 0.02), support=True),),
)
WAY = Insert((0.0, 0.0, -1.0), 0.05)
ODD = At((0.0, nan, 0.0))


def _wrong(task):
    """The fields that are wrong, each as the keys that lead there."""
    return [mistake.keys for mistake in mistakes(task, None)]


def _wrong_in(task=TASK, **goal):
    """The fields that are wrong in the only goal of a task."""
    return [keys[2:] for keys in _wrong(replace(task, goals=(Goal(**goal),)))]


@pytest.mark.parametrize(
    ("field", "value", "keys"),
    [
        ("parts", {"pen": replace(PEN, at=ODD)}, ("pen", "at")),
        ("parts", {"pen": replace(PEN, frames={"tip": PEN.at, "end": ODD})}, ("pen", "frames", "end")),
        ("parts", {"pen": replace(PEN, no_touch=(Region((1.0, 1.0, 1.0), ODD),))}, ("pen", "no_touch", 0, "at")),
        ("cell", (replace(TASK.cell[0], at=At(rpy=(0.0, inf, 0.0))),), (0, "at")),
        ("hands", {"left": Mounted("robotiq_2f85", ODD)}, ("left", "mount")),
        ("robot", OwnRobot("a.urdf", "a.srdf", base=ODD), ("base",)),
        ("goals", (Goal(hand_over=HandOver("pen", "left", ODD)),), (0, "hand_over", "at")),
        ("goals", (Goal(use=Use("pen", "tip", ODD, WAY)),), (0, "use", "at")),
    ],
)
def test_a_pose_that_is_not_finite_is_found_wherever_it_is(field, value, keys):
    assert _wrong(replace(TASK, **{field: value})) == [(field, *keys)]


@pytest.mark.parametrize("side", [0.0, -1.0, inf, nan])
def test_a_region_is_a_box_with_three_finite_sides(side):
    regions = (Region((0.1, 0.1, 0.1)), Region((0.1, side, 0.1)))
    part = replace(PEN, no_touch=regions)
    assert _wrong(replace(TASK, parts={"pen": part})) == [("parts", "pen", "no_touch", 1, "box")]
    assert _wrong(replace(TASK, parts={"pen": replace(PEN, no_touch=regions[:1])})) == []


@pytest.mark.parametrize("name", ["", "/pen.npz", "../../pen.npz", "made/../pen.npz", "C:\\pen.npz", "..\\..\\pen.npz"])
def test_files_of_what_was_measured_lie_where_meshes_may(tmp_path, name):
    def wrong(*measured, mesh=PEN.mesh, folder=None):
        part = replace(PEN, mesh=mesh, grasps=Grasping(measured=measured))
        return [mistake.keys[2:] for mistake in mistakes(replace(TASK, parts={"pen": part}), folder)]

    assert wrong("pen.npz", name) == [("grasps", "measured", 1)]
    assert wrong(mesh=name) == [("mesh",)]
    assert wrong("pen.npz", "../made/pen.npz") == []
    assert wrong("pen.npz", folder=tmp_path) == [("mesh",), ("grasps", "measured", 0)]


@pytest.mark.parametrize("corner", [(0.1, 0.5), (0.5, 0.1), (nan, 0.5), (0.5, inf)])
def test_an_area_is_a_rectangle_given_by_any_two_opposite_corners(corner):
    def area(*corners):
        return _wrong_in(place=Place("pen", area=Area("table", corners)))

    assert area((0.1, 0.1), corner) == area(corner, (0.1, 0.1)) == [("place", "area", "corners")]
    assert area((0.1, 0.5), (0.5, 0.1)) == area((0.5, 0.5), (0.1, 0.1)) == []


def test_a_part_that_turns_where_it_stands_keeps_its_height():
    """Half a turn about an axis that leans by an angle lifts a point by up to twice its distance times the sine."""
    rng = np.random.default_rng(3)
    points = rng.normal(size=(100, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    for rpy in rng.uniform(-pi, pi, (20, 3)):
        world_from_part = Rotation.from_euler("xyz", rpy)
        for lean, length in ((0.0, 3.0), (0.9, -0.2), (1.3, 0.2), (90.0, -1.0)):
            across, heading = sin(radians(lean)), rng.uniform(-pi, pi)
            vertical = [across * cos(heading), across * sin(heading), cos(radians(lean))]
            axis = world_from_part.inv().apply(vertical)
            turned = world_from_part * Rotation.from_rotvec(pi * axis)
            lift = np.abs(turned.apply(points) - world_from_part.apply(points))[:, 2].max()
            found = _wrong_in(place=Place("pen", At(rpy=tuple(rpy)), any_turn=tuple(length * axis)))
            assert found == ([] if lift < 2.0 * sin(radians(1.0)) else [("place", "any_turn")])


def test_the_axis_that_the_cure_gives_is_taken():
    rng = np.random.default_rng(4)
    for rpy in rng.uniform(-pi, pi, (20, 3)):
        goal = Place("pen", At(rpy=tuple(rpy)), any_turn=(1.0, 0.1, 0.0))
        (mistake,) = mistakes(replace(TASK, goals=(Goal(place=goal),)), None)
        axis = tuple(float(number) for number in mistake.cure.partition("[")[2].strip("]").split(","))
        assert _wrong_in(place=replace(goal, any_turn=axis)) == []


def test_a_part_is_given_hand_in_hand_only_where_there_are_two_hands():
    alone = replace(TASK, hands={"left": "robotiq_2f85"})
    goal = HandOver("pen", "left", At(), interlocked=True)
    assert _wrong_in(alone, hand_over=goal) == [("hand_over", "interlocked")]
    assert _wrong_in(alone, hand_over=replace(goal, interlocked=False)) == _wrong_in(hand_over=goal) == []


def test_a_tool_may_be_used_on_any_other_thing_or_in_the_world():
    task = replace(TASK, parts={"pen": PEN, "lid": replace(PEN, frames={})})
    for of, wrong in ((None, []), ("table", []), ("lid", []), ("pen", ["of"]), ("left", ["of"])):
        assert _wrong_in(task, use=Use("pen", "tip", At(), WAY, of=of)) == [("use", key) for key in wrong]
