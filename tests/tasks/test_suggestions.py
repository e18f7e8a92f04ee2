"""What would help: single changes, each tried; the words say what to write."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np
import pytest
import trimesh
import yaml
from infeasible import ONE, PUT_ASIDE, TABLE, folder, refusal
from msgspec.structs import asdict, replace

from kumitate.errors import InputError, PlanningError, TimeLimitError
from kumitate.regrasp.diagnosis import Cause, Diagnosis
from kumitate.regrasp.reach import Node
from kumitate.tasks import suggestions as module
from kumitate.tasks.cell import build_cell
from kumitate.tasks.quantities import parse_quantity
from kumitate.tasks.reasons import NoPlanError, Report
from kumitate.tasks.suggestions import suggestions
from kumitate.tasks.task import Task
from kumitate.tasks.verify import verify
from kumitate.transforms import pose, transform_points

LID = "a lid over the part"
SUNK = Cause("hand against", ("table",))


def let_work(monkeypatch, works):
    """Let planning succeed for the tasks that ``works`` accepts; the tasks that were tried, in their order."""
    tasks: list[Task] = []

    def answer(task, folder, **more):
        tasks.append(task)
        if not works(task):
            raise PlanningError("no plan")

    monkeypatch.setattr(module, "plan", answer)
    return tasks


def helps(task, error, **more):
    return list(suggestions(task, folder(), error, **{"seed": 0, "time_limit": 60.0, **more}))


def tries(task, error):
    """What is tried where nothing helps: the words, and the task so changed."""
    words: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        tasks = let_work(patch, lambda task: False)
        assert helps(task, error, progress=words.append) == []
    begin = "whether there is a plan "
    assert all(line.startswith(begin) for line in words)
    return list(zip([line.removeprefix(begin) for line in words], tasks, strict=True))


@pytest.fixture(scope="module")
def under_lid():
    """What is tried for the block under the lid."""
    return tries(ONE[LID].task, refusal(LID))


def differences(task, changed):
    """The entries of a task that differ, by field and name or number."""
    found = set()
    for field, value in asdict(task).items():
        there = getattr(changed, field)
        if isinstance(value, dict):
            found |= {(field, name) for name in {*value, *there} if value.get(name) != there.get(name)}
        elif field == "cell":
            before, after = ({entry.name: entry for entry in cell} for cell in (value, there))
            found |= {(field, name) for name in before if before[name] != after.get(name)}
        elif field == "goals":
            found |= {(field, i) for i, pair in enumerate(zip(value, there, strict=True)) if pair[0] != pair[1]}
        elif value != there:
            found.add((field, ""))
    return found


def written(words):
    """The numbers in words such as ``xyz: [0.4, 0.1, 0], rpy: [90 deg, 0 deg, 0 deg]``, read as a task file is."""
    read = yaml.safe_load("{" + re.search(r"\((.*)\)", words).group(1) + "}")
    return read["xyz"], [parse_quantity(angle, "angle", "rpy") for angle in read.get("rpy", [])]


# What is tried --------------------------------------------------------------------------------------------------------


def test_one_thing_is_changed_at_a_time(under_lid):
    assert len(under_lid) > 15
    for said, changed in under_lid:
        found = differences(ONE[LID].task, changed)
        if " and " in said:
            assert found == {("hands", "left"), ("hands", "right")}
        else:
            assert len(found) == 1, said


def test_obstacles_in_the_way_go_first_the_gravest_before_the_others(under_lid):
    (first, without_lid), (second, without_table) = under_lid[:2]
    assert (first, second) == ("without the obstacle lid", "without the obstacle table")
    assert [entry.name for entry in without_lid.cell] == ["table"]
    assert [entry.name for entry in without_table.cell] == ["lid"]


def test_a_part_that_no_goal_speaks_of_may_go_too():
    block = PUT_ASIDE.parts["block"]
    crate = replace(block, at=replace(block.at, xyz=(0.4, -0.3, 0.01)))
    report = Report(0, "", ((Cause("part against", ("crate", "block")), 3),))
    found = tries(replace(PUT_ASIDE, parts={"block": block, "crate": crate}), NoPlanError(report, PlanningError()))
    assert found[0] == ("without the part crate", PUT_ASIDE)
    assert not any("without the part block" in said for said, _ in found)


def test_start_and_goal_come_nearer_to_the_hands_as_the_words_say(under_lid):
    task = ONE[LID].task
    robot = build_cell(task, folder()).robot
    hands = np.array([robot.hand_pose(arm, robot.home)[:3, 3] for arm in robot.hands])
    (first, start), (second, goal) = ((said, changed) for said, changed in under_lid if "nearer" in said)
    assert first.startswith("with block 5 cm nearer (")
    assert second.startswith("with goal 1 5 cm nearer (")
    for said, before, after in (
        (first, task.parts["block"].at, start.parts["block"].at),
        (second, task.goals[0].place.at, goal.goals[0].place.at),
    ):
        xyz, rpy = written(said)
        assert xyz == pytest.approx(after.xyz, abs=1e-9)
        assert rpy == []
        assert (after.rpy, after.xyz[2]) == (before.rpy, before.xyz[2])
        old, new = np.array(before.xyz), np.array(after.xyz)
        assert np.linalg.norm(new - old) == pytest.approx(0.05, abs=2e-4)
        away = [np.linalg.norm((hands - at)[:, :2], axis=1).min() for at in (old, new)]
        assert away[0] - away[1] == pytest.approx(0.05, abs=2e-4)


def test_parts_stand_otherwise_above_the_same_place_as_the_words_say(under_lid):
    body, seen = trimesh.load_mesh(folder() / "block.stl").vertices, []
    for said, changed in under_lid:
        if "standing otherwise" in said:
            at = changed.parts["block"].at
            xyz, rpy = written(said)
            assert xyz == pytest.approx(at.xyz, abs=1e-9)
            assert rpy == pytest.approx(at.rpy, abs=1e-9)
            assert not re.search(r"e-|-0[ ,\]]", said)
            corners = transform_points(pose(at.xyz, at.rpy), body)
            assert corners[:, 2].min() == pytest.approx(-0.05, abs=1e-4)
            assert np.ptp(corners[:, 2]) == pytest.approx(0.12 if abs(at.rpy[0]) > 3.0 else 0.03, abs=1e-4)
            assert corners[:, :2].mean(axis=0) == pytest.approx([0.4, 0.25], abs=1e-4)
            seen.append(at)
    assert len(seen) == 10  # on its four sides and on its other end, each at two turns
    lying = replace(PUT_ASIDE, parts={"block": replace(PUT_ASIDE.parts["block"], at=seen[0])})
    build_cell(lying, folder())  # where it would be told if the part did not rest there


def test_supports_grow_where_they_are(under_lid):
    said, changed = under_lid[-1]
    assert said == "with 30 cm more of table on all sides (box: [0.9, 1.92, 0.02])"
    (table,) = (entry for entry in changed.cell if entry.name == "table")
    assert table.box == pytest.approx((0.9, 1.92, 0.02))
    assert table.at == TABLE.at


def test_parts_at_which_nothing_fails_stay_where_they_are():
    found = Diagnosis(Node("where it is", np.eye(4), None), "peg", "left", 9, 9, Counter({frozenset({SUNK}): 9}), None)
    error = NoPlanError(Report(0, "", (), (found,)), PlanningError())
    words = [said for said, _ in tries(ONE["a bar across the bore"].task, error)]
    assert any(said.startswith("with peg ") for said in words)
    assert not any(said.startswith("with barred ") for said in words)


# What helps -----------------------------------------------------------------------------------------------------------


def test_only_what_was_planned_is_told(monkeypatch):
    let_work(monkeypatch, lambda task: len(task.cell) == 1 and task.cell[0].name == "table")
    assert helps(ONE[LID].task, refusal(LID)) == ["without the obstacle lid there is a plan"]


def test_of_alternatives_the_first_that_helps_will_do(monkeypatch):
    tasks = let_work(monkeypatch, lambda task: "suction_cup" in task.hands.values() or task.parts["block"].at.rpy[0])
    told = helps(ONE[LID].task, refusal(LID))
    assert [words.split(" (")[0] for words in told] == [
        "with suction_cup on left there is a plan",
        "with block standing otherwise",
    ]
    assert sum("suction_cup" in task.hands.values() for task in tasks) == 1
    assert sum(task.parts["block"].at.rpy != (0.0, 0.0, 0.0) for task in tasks) == 1


def test_hands_that_are_on_an_arm_already_are_not_tried_there():
    task = replace(PUT_ASIDE, hands={"left": "suction_cup", "right": "robotiq_2f85"})
    found = tries(task, PlanningError("nothing known"))
    hands = [tuple(changed.hands.values()) for _, changed in found if changed.hands != task.hands]
    assert hands == [
        ("robotiq_2f85", "robotiq_2f85"),
        ("hrp5p_three_finger", "robotiq_2f85"),
        ("suction_cup", "hrp5p_three_finger"),
        ("hrp5p_three_finger", "hrp5p_three_finger"),
        ("suction_cup", "suction_cup"),
    ]


def test_a_change_that_makes_the_task_unsound_does_not_help(monkeypatch):
    def refuse(task, folder, **more):
        raise InputError("cell", "wrong", "give another")

    monkeypatch.setattr(module, "plan", refuse)
    assert helps(ONE[LID].task, refusal(LID)) == []


@pytest.mark.parametrize(("enough", "expected"), [(200.0, ["with 240 s of time there is a plan"]), (250.0, [])])
def test_where_time_was_short_more_of_it_is_tried_and_nothing_else(monkeypatch, enough, expected):
    asked = []

    def answer(task, folder, *, time_limit, **more):
        asked.append((task, time_limit))
        if time_limit < enough:
            raise TimeLimitError(time_limit, "this")

    monkeypatch.setattr(module, "plan", answer)
    assert helps(PUT_ASIDE, TimeLimitError(60.0, "that"), time_limit=60.0) == expected
    assert asked == [(PUT_ASIDE, 240.0)]


# In earnest -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (LID, [r"without the obstacle lid"]),
        ("a goal out of reach", [r"with goal 1 5 cm nearer \(xyz: \[0\.48\d*, 0\.55\d*, 0\.01\]\)"]),
        ("a part too flat", [r"with suction_cup on left"]),
        (
            "no grasp shared, and no way to regrasp",
            [
                r"with puck standing otherwise \(xyz: .*, rpy: .* deg\]\)",
                r"with 30 cm more of shelf on all sides \(box: \[0\.63, 0\.63, 0\.02\]\)",
            ],
        ),
        ("a part too heavy", []),
    ],
)
def test_what_helps_is_planned_and_verified(monkeypatch, name, expected):
    plans, real = [], module.plan
    monkeypatch.setattr(module, "plan", lambda *given, **more: plans.append(real(*given, **more)))
    found = helps(ONE[name].task, refusal(name))
    assert len(found) == len(plans)
    assert all(verify(made).ok for made in plans)
    assert bool(found) == bool(expected)
    for words in expected:
        assert any(re.fullmatch(f"{words} there is a plan", line) for line in found)
