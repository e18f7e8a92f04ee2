"""Task files: what they say is what is read, every mistake is told with its place, and nothing is lost on the way."""

from __future__ import annotations

import json
import os
import re
from math import pi, radians
from pathlib import Path

import pytest
import trimesh
import yaml

from kumitate.errors import InputError
from kumitate.tasks.task import (
    Area,
    At,
    Attach,
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
from kumitate.tasks.task_file import checked_task, in_file, read_task, task_of, task_schema, task_to_builtins

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "wheel_support"
FILES = sorted(EXAMPLES.glob("*.yaml"))

TEXT = """\
robot: nextage
hands:
  left: robotiq_2f85
  right: {hand: robotiq_2f85, mount: {xyz: [0, 0, 5 mm], rpy: [0, 0, 90 deg]}}
speed: 0.5
cell:
  - {name: table, box: [300 mm, 1.32, 20 mm], at: {xyz: [0.40, 0, -0.06]}, support: true}
parts:
  support: {mesh: ../parts/support.stl, unit: mm, mass: 60 g, at: {rpy: [0, -90 deg, 0]}}
  wheel:
    mesh: ../parts/wheel.stl
    unit: mm
    density: 2.7 g/cm3
    at: {xyz: [1, 2 in, -5e-2]}
    grasps: {theta_pln: 10 deg, n_da: 4}
    frames:
      rim: {xyz: [0, 22 mm, 0]}
      hub: {rpy: [0, 90 deg, 0]}
    no_touch:
      - {box: [5 mm, 1 cm, 0.02], at: {xyz: [0, 0, 3 mm]}}
goals:
  - attach:
      part: wheel
      to: support
      at: {xyz: [0, 32 mm, 10 mm]}
      insert: {direction: [0, -1, 0], distance: 70 mm}
  - place: {part: support, at: {}, arm: left}
  - hand_over: {part: wheel, to: right, at: {}}
  - place: {part: wheel, area: {on: table, corners: [[30 cm, -0.2], [0.5, 0.2]], up: [0, 0, -1]}}
  - place: {part: wheel, at: {rpy: [0, -90 deg, 0]}, any_turn: [-2, 0, 0]}
  - hand_over: {part: wheel, to: left, at: {}, any_turn: [0, 1, 0], interlocked: true}
  - use: {part: wheel, frame: rim, at: {}, of: table, approach: {direction: [0, 0, -1], distance: 5 cm}, arm: right}
  - use: {part: wheel, frame: hub, at: {}, approach: {direction: [1, 0, 0], distance: 0.1}, any_turn: [0, 0, 1]}
start: {LARM_JOINT0: 20 deg, RARM_JOINT0: 0.1}
end: stay
order: free
"""
TASK = Task(
    robot="nextage",
    hands={"left": "robotiq_2f85", "right": Mounted("robotiq_2f85", At((0, 0, 0.005), (0, 0, pi / 2)))},
    speed=0.5,
    cell=(Obstacle("table", At((0.4, 0, -0.06)), box=(0.3, 1.32, 0.02), support=True),),
    parts={
        "support": PartEntry("../parts/support.stl", "mm", At(rpy=(0, -pi / 2, 0)), mass=0.06),
        "wheel": PartEntry(
            "../parts/wheel.stl",
            "mm",
            At((1, 0.0508, -0.05)),
            density=2700,
            grasps=Grasping(radians(10), n_da=4),
            frames={"rim": At((0, 0.022, 0)), "hub": At(rpy=(0, pi / 2, 0))},
            no_touch=(Region((0.005, 0.01, 0.02), At((0, 0, 0.003))),),
        ),
    },
    goals=(
        Goal(attach=Attach("wheel", "support", At((0, 0.032, 0.01)), Insert((0, -1, 0), 0.07))),
        Goal(place=Place("support", At(), arm="left")),
        Goal(hand_over=HandOver("wheel", "right", At())),
        Goal(place=Place("wheel", area=Area("table", ((0.3, -0.2), (0.5, 0.2)), (0, 0, -1)))),
        Goal(place=Place("wheel", At(rpy=(0, -pi / 2, 0)), any_turn=(-2, 0, 0))),
        Goal(hand_over=HandOver("wheel", "left", At(), any_turn=(0, 1, 0), interlocked=True)),
        Goal(use=Use("wheel", "rim", At(), Insert((0, 0, -1), 0.05), of="table", arm="right")),
        Goal(use=Use("wheel", "hub", At(), Insert((1, 0, 0), 0.1), any_turn=(0, 0, 1))),
    ),
    start={"LARM_JOINT0": radians(20), "RARM_JOINT0": 0.1},
    end="stay",
    order="free",
)


@pytest.fixture
def task_file(tmp_path):
    """Writes a task beside the meshes that it names."""
    for folder in ("parts", "task"):
        (tmp_path / folder).mkdir()
    for name in ("wheel", "support"):
        trimesh.creation.box([40, 30, 20]).export(tmp_path / "parts" / f"{name}.stl")

    def write(text):
        path = tmp_path / "task" / "task.yaml"
        path.write_text(text)
        return path

    return write


def test_what_is_written_is_what_is_read(task_file):
    read = task_to_builtins(read_task(task_file(TEXT)))
    wanted = task_to_builtins(TASK)
    assert _plain(read) == _plain(wanted)
    assert set(read) == set(Task.__struct_fields__)


def _plain(value):
    """``value`` with numbers rounded: a unit's factor may cost the last digit."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    return round(value, 12) if isinstance(value, float) else value


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_task_survives_the_way_through_json(path):
    task = read_task(path)
    assert task_of(json.loads(json.dumps(task_to_builtins(task)))) == task


def test_every_field_survives_the_way_through_json(task_file):
    task = read_task(task_file(TEXT))
    assert task_of(json.loads(json.dumps(task_to_builtins(task)))) == task
    assert _accepts(SCHEMA, task_to_builtins(task))


def test_builtins_are_plain(task_file):
    def kinds(value):
        yield type(value)
        for entry in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
            yield from kinds(entry)

    assert set(kinds(task_to_builtins(read_task(task_file(TEXT))))) <= {dict, list, str, float, int, bool, type(None)}


MISTAKES = [  # what is replaced in the text, by what, and what the message says: line, field, problem, cure
    ("speed: 0.5", "sped: 0.5", ":5: sped: ", "did you mean 'speed'"),
    ("speed: 0.5", "speed: 1.5", ":5: speed: ", "at most 1"),
    ("speed: 0.5", "speed: 0", ":5: speed: ", "more than 0"),
    ("speed: 0.5", "speed: .nan", ":5: speed: ", "nan"),
    ("speed: 0.5", "speed: fast", ":5: speed: ", "expected float, got str"),
    ("speed: 0.5", "speed: true", ":5: speed: ", "expected float, got bool"),
    ("speed: 0.5", "speed: 0.5\nspeed: 0.6", ":6: ", "'speed' is there twice"),
    ("  support: {mesh", "  wheel: {mesh", ":10: ", "'wheel' is there twice"),
    ("speed: 0.5", "speed: &half 0.5\nend: *half", ":6: ", "alias (*half)"),
    ("speed: 0.5", "speed: !!python/name:os.system 0.5", ":5: ", "YAML tag"),
    ("speed: 0.5", "speed: 0.5\n<<: {end: home}", ":6: ", "no text"),
    ("speed: 0.5", "speed: 0.5\ntrue: 1", ":6: ", "put it in quotes"),
    ("speed: 0.5", "speed: yes", ":5: speed: ", "expected float, got str"),
    ("support: true", "support: yes", ":7: cell[0].support: ", "expected bool, got str"),
    ("speed: 0.5", "speed: 0.5\n? [a]\n: 1", ":6: ", "no text"),
    ("speed: 0.5", "speed: [", ":7: ", "no valid YAML"),
    ("speed: 0.5", "speed: 0.5\n---\na: 1", ":6: ", "another document"),
    ("end: stay", "end: work", ":35: end: ", "give one of home, stay"),
    ("20 deg, RARM", "20 mm, RARM", ":34: start.LARM_JOINT0: ", "'20 mm' has no unit of angle"),
    ("20 deg, RARM", ".inf, RARM", ":34: start.LARM_JOINT0: ", "inf is no angle"),
    ("2.7 g/cm3", "2.7 mm", ":13: parts.wheel.density: ", "units: kg/m3, g/cm3"),
    ("2.7 g/cm3", "-1", ":13: parts.wheel.density: ", "more than 0"),
    ("2.7 g/cm3", "0", ":13: parts.wheel.density: ", "more than 0"),
    ("density", "densty", ":13: parts.wheel.densty: ", "did you mean 'density'"),
    ("    density: 2.7 g/cm3\n", "", ":10: parts.wheel: ", "neither mass nor density"),
    ("mass: 60 g", "mass: 60 g, density: 1000", ":9: parts.support: ", "mass and density are both given"),
    ("    unit: mm\n", "", ":10: parts.wheel: ", "the field 'unit' is missing"),
    ("    unit: mm", "    unit: ft", ":12: parts.wheel.unit: ", "give one of mm, cm, m, in"),
    ("[1, 2 in, -5e-2]", "[1, 2 in]", ":14: parts.wheel.at.xyz: ", "length 3, got 2"),
    ("[1, 2 in, -5e-2]", "[1, two in, 0]", ":14: parts.wheel.at.xyz[1]: ", "write a length such as"),
    ("[1, 2 in, -5e-2]", "[1, .nan, 0]", ":14: parts.wheel.at.xyz[1]: ", "no length"),
    ("[1, 2 in, -5e-2]", "[1, true, 0]", ":14: parts.wheel.at.xyz[1]: ", "True is no length"),
    ("[1, 2 in, -5e-2]", "5", ":14: parts.wheel.at.xyz: ", "expected list, got int"),
    ("../parts/wheel.stl", "../../parts/wheel.stl", ":11: parts.wheel.mesh: ", "at most one folder up"),
    ("../parts/wheel.stl", "a/../../parts/wheel.stl", ":11: parts.wheel.mesh: ", "at most one folder up"),
    ("../parts/wheel.stl", "/etc/passwd", ":11: parts.wheel.mesh: ", "relative to the task file"),
    ("../parts/wheel.stl", "C:\\wheel.stl", ":11: parts.wheel.mesh: ", "relative to the task file"),
    ("../parts/wheel.stl", "..\\..\\wheel.stl", ":11: parts.wheel.mesh: ", "at most one folder up"),
    ("../parts/wheel.stl", "''", ":11: parts.wheel.mesh: ", "no path"),
    ("../parts/wheel.stl", "../parts/weel.stl", ":11: parts.wheel.mesh: ", "weel.stl; check the path"),
    ("../parts/wheel.stl", "w" * 300 + ".stl", ":11: parts.wheel.mesh: ", "check the path"),
    ("n_da: 4", "n_da: 0", ":15: parts.wheel.grasps.n_da: ", "from 1 to 360"),
    ("n_da: 4", "n_da: 4.5", ":15: parts.wheel.grasps.n_da: ", "got float"),
    ("10 deg", "200 deg", ":15: parts.wheel.grasps.theta_pln: ", "out of range"),
    ("name: table", "name: wheel", ":10: parts.wheel: ", "taken"),
    ("name: table", "name: left", ":7: cell[0].name: ", "taken"),
    ("name: table", "name: ''", ":7: cell[0].name: ", "empty"),
    ("support: true}", "support: true}\n  - {name: table, box: [1, 1, 1], at: {}}", ":8: cell[1].name: ", "taken"),
    ("[300 mm, 1.32, 20 mm]", "[300 mm, 1.32, 0]", ":7: cell[0].box: ", "above 0"),
    ("box: [300 mm, 1.32, 20 mm], ", "", ":7: cell[0]: ", "neither box nor mesh"),
    ("box: [", "mesh: ../parts/wheel.stl, unit: mm, box: [", ":7: cell[0]: ", "both given"),
    ("box: [300 mm, 1.32, 20 mm]", "mesh: ../parts/wheel.stl", ":7: cell[0]: ", "without a unit"),
    ("box: [", "unit: mm, box: [", ":7: cell[0]: ", "without a mesh"),
    ("part: wheel\n", "part: weel\n", ":23: goals[0].attach.part: ", "did you mean 'wheel'"),
    ("to: support", "to: rack", ":24: goals[0].attach.to: ", "known: support, wheel"),
    ("to: support", "to: wheel", ":24: goals[0].attach.to: ", "itself"),
    ("to: support\n", "to: support\n      arm: middle\n", ":25: goals[0].attach.arm: ", "known: left, right"),
    (
        "to: support\n",
        "to: support\n      arm: left\n      to_arm: left\n",
        ":26: goals[0].attach.to_arm: ",
        "two arms",
    ),
    ("to: right", "to: wheel", ":28: goals[2].hand_over.to: ", "no arm with a hand named 'wheel'"),
    ("arm: left}", "arm: lift}", ":27: goals[1].place.arm: ", "did you mean 'left'"),
    ("[0, -1, 0]", "[0, 0, 0]", ":26: goals[0].attach.insert.direction: ", "no direction"),
    ("[0, -1, 0]", "[0, .inf, 0]", ":26: goals[0].attach.insert.direction: ", "no direction"),
    ("distance: 70 mm", "distance: 0", ":26: goals[0].attach.insert.distance: ", "more than 0"),
    ("distance: 70 mm", "distance: -70 mm", ":26: goals[0].attach.insert.distance: ", "more than 0"),
    (
        "  - place: {part",
        "  - hand_over: {part: wheel, to: left, at: {}}\n    place: {part",
        ":27: goals[1]: ",
        "one of",
    ),
    ("  - place: {", "  - {}\n  - place: {", ":27: goals[1]: ", "says nothing"),
    ("hub: {", "'': {", ":16: parts.wheel.frames: ", "empty"),
    ("hub: {rpy", "hub: {rpi", ":18: parts.wheel.frames.hub.rpi: ", "did you mean 'rpy'"),
    ("hub: {rpy: [0,", "hub: {rpy: [0 mm,", ":18: parts.wheel.frames.hub.rpy[0]: ", "no unit of angle"),
    ("rim: {xyz: [0, 22 mm, 0]}", "rim: 22 mm", ":17: parts.wheel.frames.rim: ", "expected mapping, got str"),
    ("[5 mm, 1 cm, 0.02]", "[5 mm, 1 cm, -0.02]", ":20: parts.wheel.no_touch[0].box: ", "above 0"),
    ("[5 mm, 1 cm, 0.02]", "[5 mm, 1 cm]", ":20: parts.wheel.no_touch[0].box: ", "length 3, got 2"),
    ("order: free", "order: any", ":36: order: ", "give one of fixed, free"),
    ("area: {on: table", "at: {}, area: {on: table", ":29: goals[3].place: ", "at and area are both given"),
    ("{part: support, at: {}, arm", "{part: support, arm", ":27: goals[1].place: ", "neither at nor area"),
    ("[0, 0, -1]}}", "[0, 0, -1]}, any_turn: [0, 0, 1]}", ":29: goals[3].place.any_turn: ", "leave it out"),
    ("area: {on: table", "area: {on: tabel", ":29: goals[3].place.area.on: ", "did you mean 'table'"),
    ("area: {on: table", "area: {on: wheel", ":29: goals[3].place.area.on: ", "known: table"),
    (", support: true", "", ":29: goals[3].place.area.on: ", "add support: true"),
    ("[[30 cm, -0.2]", "[[50 cm, -0.2]", ":29: goals[3].place.area.corners: ", "differ in x and in y"),
    ("[[30 cm, -0.2]", "[[30 cm, 0.2]", ":29: goals[3].place.area.corners: ", "differ in x and in y"),
    ("[[30 cm, -0.2]", "[[30 cm, far]", ":29: goals[3].place.area.corners[0][1]: ", "write a length such as"),
    ("up: [0, 0, -1]", "up: [0, 0, 0]", ":29: goals[3].place.area.up: ", "no direction"),
    ("any_turn: [-2, 0, 0]", "any_turn: [0, 0, 0]", ":30: goals[4].place.any_turn: ", "no direction"),
    ("any_turn: [-2, 0, 0]", "any_turn: [0, 0, 1]", ":30: goals[4].place.any_turn: ", "vertical there: [1, 0, 0]"),
    ("any_turn: [0, 1, 0]", "any_turn: [0, .inf, 0]", ":31: goals[5].hand_over.any_turn: ", "no direction"),
    ("frame: rim", "frame: rum", ":32: goals[6].use.frame: ", "did you mean 'rim'"),
    ("use: {part: wheel", "use: {part: support", ":32: goals[6].use.frame: ", "support has no frame named 'rim'"),
    ("use: {part: wheel", "use: {part: weel", ":32: goals[6].use.part: ", "did you mean 'wheel'"),
    ("of: table", "of: tables", ":32: goals[6].use.of: ", "did you mean 'table'"),
    ("of: table", "of: wheel", ":32: goals[6].use.of: ", "the tool itself"),
    ("of: table", "of: left", ":32: goals[6].use.of: ", "known: table, support"),
    ("arm: right}", "arm: write}", ":32: goals[6].use.arm: ", "did you mean 'right'"),
    ("[0, 0, -1], distance", "[0, 0, 0], distance", ":32: goals[6].use.approach.direction: ", "no direction"),
    ("distance: 5 cm", "distance: 0", ":32: goals[6].use.approach.distance: ", "more than 0"),
    ("any_turn: [0, 0, 1]}", "any_turn: [0, 0, .nan]}", ":33: goals[7].use.any_turn: ", "no direction"),
    ("left: robotiq_2f85", "left: {hnd: x}", ":3: hands.left.hnd: ", "did you mean 'hand'"),
    ("left: robotiq_2f85", "left: 5", ":3: hands.left: ", "got int"),
    ("left: robotiq_2f85", r'left: "\ud800"', ":3: ", "half a character; write the character itself"),
    ("  wheel:", r'  "wh\ud83d\ude00":', ":10: ", "half a character; write the character itself"),
    ("left: robotiq_2f85", "left: own.yaml", ":3: hands.left: ", "own.yaml; check the path"),
    ("hand: robotiq_2f85", "hand: ../../own.yaml", ":4: hands.right.hand: ", "at most one folder up"),
    ("robot: nextage", "robot: {urdf: /my.urdf, srdf: my.srdf}", ":1: robot.urdf: ", "relative to the task file"),
    ("robot: nextage", "robot: {urdf: my.urdf}", ":1: robot: ", "'srdf' is missing"),
    ("robot: nextage\n", "", ":1: task: ", "'robot' is missing"),
]


@pytest.mark.parametrize(("old", "new", "place", "words"), MISTAKES)
def test_a_mistake_is_told_with_line_field_and_cure(task_file, old, new, place, words):
    assert old in TEXT
    path = task_file(TEXT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_task(path)
    message = str(caught.value)
    assert message.startswith(str(path) + place)
    assert words in message.replace("\\\\", "\\")
    assert "\n" not in message
    assert caught.value.cure


@pytest.mark.parametrize(
    "text", ["", "5", "- a", "word", "\0", "{" * 3000, "a: 2001-01-01", "'" + "x" * 300_000 + "'", "robot: !<x> y"]
)
def test_what_is_no_task_is_told_with_the_file(task_file, text):
    path = task_file(text)
    with pytest.raises(InputError) as caught:
        read_task(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_a_folder_whose_name_no_plan_can_tell_is_refused(tmp_path):
    folder = tmp_path / os.fsdecode(b"\xff")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("no such names here")
    (folder / "task.yaml").write_text("robot: nextage")
    with pytest.raises(InputError, match="no UTF-8"):
        read_task(folder / "task.yaml")


def test_words_that_yaml_once_took_for_truth_values_are_names(task_file):
    read = read_task(task_file(TEXT.replace("wheel:", "no:").replace(": wheel", ": no").replace("table", "off")))
    assert set(read.parts) == {"support", "no"}
    assert read.goals[3].place == Place("no", area=Area("off", ((0.3, -0.2), (0.5, 0.2)), (0, 0, -1)))


def test_the_entry_that_is_named_is_the_wrong_one_among_others_alike(task_file):
    right, wrong = "frames: {tip: {xyz: [0, 0, 0]}, end: {xyz: 5}}", "frames: {end: {xyz: [0, 0, 0]}, tip: {xyz: 5}}"
    for first, second, place in (
        (right, wrong, ":9: parts.support.frames.end.xyz: "),
        (wrong, right, "support.frames.tip.xyz: "),
    ):
        text = TEXT.replace("mass: 60 g", f"mass: 60 g, {first}").replace("    density:", f"    {second}\n    density:")
        i = text.index("    frames:\n")
        text = text[:i] + text[text.index("    no_touch:") :]
        with pytest.raises(InputError, match=re.escape(place)):
            read_task(task_file(text))


def test_aliases_that_would_blow_up_are_refused_at_the_first(task_file):
    lines = ["a0: &a0 [x, x]", *(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 40))]
    with pytest.raises(InputError, match=r":2: it uses a YAML alias \(\*a0\)"):
        read_task(task_file("\n".join(lines)))


def test_a_missing_file_and_a_folder_are_told(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(InputError, match=re.escape(str(path))):
            read_task(path)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([("a", "b"), ("b", "a")], "to: b is a itself|to: a is b itself or attached to it"),
        ([("a", "b"), ("b", "c"), ("c", "a")], "attached to it"),
        ([("a", "b"), ("a", "c")], "part: a is attached to b already"),
        ([("a", "b"), ("c", "b"), ("b", "d"), ("e", "a")], None),
    ],
)
def test_parts_are_attached_once_and_in_no_ring(pairs, words):
    entry = PartEntry("mesh.stl", "mm", At(), mass=1.0)
    insert = Insert((1.0, 0.0, 0.0), 0.1)
    goals = tuple(Goal(attach=Attach(part, to, At(), insert)) for part, to in pairs)
    task = Task(robot="nextage", hands={"left": "robotiq_2f85"}, parts=dict.fromkeys("abcde", entry), goals=goals)
    if words is None:
        assert checked_task(task) is task
    else:
        with pytest.raises(InputError, match=words):
            checked_task(task)


def test_a_task_built_in_code_is_checked_alike(tmp_path):
    assert checked_task(TASK) is TASK
    with pytest.raises(InputError, match=r"parts\.support\.mesh: there is no"):
        checked_task(TASK, tmp_path)
    with pytest.raises(InputError, match=r"^speed: "):
        checked_task(Task(robot="nextage", hands={}, parts={}, goals=(), speed=2.0))


def test_files_of_a_robot_of_ones_own_are_looked_for(tmp_path):
    own = OwnRobot("a.urdf", "a.srdf", "limits.yaml", ("packages",))
    for name, missing in (("a.urdf", "srdf"), ("a.srdf", "limits"), ("limits.yaml", r"packages\[0\]")):
        (tmp_path / name).touch()
        with pytest.raises(InputError, match=rf"^robot\.{missing}: "):
            checked_task(Task(robot=own, hands={}, parts={}, goals=()), tmp_path)


@pytest.mark.parametrize(("data", "words"), [({}, "^task: .*'robot'"), ([], "^task: "), ({"speed": 2}, "robot")])
def test_a_plan_with_no_task_in_it_is_an_input_error(data, words):
    with pytest.raises(InputError, match=words):
        task_of(data)


def test_an_error_about_a_field_gets_file_and_line(task_file):
    path = task_file(TEXT)
    told = in_file(InputError("parts.wheel.at", "it floats", "lower it"), path)
    assert (told.place, told.problem, told.cure) == (f"{path}:14: parts.wheel.at", "it floats", "lower it")
    other = InputError("mesh.stl", "is empty", "export it again")
    assert in_file(other, path) is other


SCHEMA = task_schema()


def _data(text):
    """What ``text`` says in YAML 1.2, in which ``on`` is no truth value."""
    return yaml.safe_load(re.sub(r"\bon:", '"on":', text))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_schema_accepts_the_examples(path):
    assert _accepts(SCHEMA, _data(path.read_text()))
    assert _accepts(SCHEMA, task_to_builtins(read_task(path)))


TYPE_MISTAKES = [
    ("speed: 0.5", "sped: 0.5"),
    ("speed: 0.5", "speed: fast"),
    ("end: stay", "end: work"),
    ("20 deg, RARM", "20 mm, RARM"),
    ("2.7 g/cm3", "2.7 mm"),
    ("[1, 2 in, -5e-2]", "[1, 2 in]"),
    ("[1, 2 in, -5e-2]", "[1, two in, 0]"),
    ("    unit: mm\n", ""),
    ("left: robotiq_2f85", "left: {hnd: x}"),
    ("robot: nextage\n", ""),
    ("hub: {rpy", "hub: {rpi"),
    ("rim: {xyz: [0, 22 mm, 0]}", "rim: 22 mm"),
    ("[5 mm, 1 cm, 0.02]", "[5 mm, 1 cm]"),
    ("area: {on: table, ", "area: {"),
    ("[[30 cm, -0.2], [0.5, 0.2]]", "[[30 cm, -0.2]]"),
    ("[[30 cm, -0.2]", "[[30 deg, -0.2]"),
    ("up: [0, 0, -1]", "up: [0, 0]"),
    ("any_turn: [-2, 0, 0]", "any_turn: 1"),
    ("interlocked: true", "interlocked: 1"),
    ("frame: rim, ", ""),
    ("direction: [1, 0, 0], ", ""),
    ("order: free", "order: any"),
]


@pytest.mark.parametrize(("old", "new"), TYPE_MISTAKES)
def test_the_schema_refuses_what_the_reader_refuses_for_its_type(old, new):
    assert _accepts(SCHEMA, _data(TEXT))
    assert not _accepts(SCHEMA, _data(TEXT.replace(old, new, 1)))


_KINDS = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def _accepts(schema, value):
    """As much of JSON Schema as task files need."""
    known = {"$ref", "$defs", "title", "description", "default", "type", "properties", "required", "enum", "pattern"}
    assert set(schema) <= known | {"additionalProperties", "anyOf", "items", "prefixItems", "minItems", "maxItems"}
    if "$ref" in schema:
        return _accepts(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]], value)
    if "anyOf" in schema:
        return any(_accepts(option, value) for option in schema["anyOf"])
    if "enum" in schema:
        return value in schema["enum"]
    kinds = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
    inside = {str: _accepts_text, list: _accepts_list, dict: _accepts_mapping}.get(type(value))
    return any(_is(value, kind) for kind in kinds) and (inside is None or inside(schema, value))


def _accepts_text(schema, text):
    return re.search(schema.get("pattern", ""), text) is not None


def _accepts_list(schema, entries):
    first = schema.get("prefixItems", [])
    schemas = [*first, *[schema["items"]] * (len(entries) - len(first))]
    fits = schema.get("minItems", 0) <= len(entries) <= schema.get("maxItems", len(entries))
    return fits and all(_accepts(inner, entry) for inner, entry in zip(schemas, entries, strict=True))


def _accepts_mapping(schema, entries):
    schemas = {key: schema.get("properties", {}).get(key, schema["additionalProperties"]) for key in entries}
    complete = set(schema.get("required", ())) <= set(entries)
    return complete and all(inner is not False and _accepts(inner, entries[key]) for key, inner in schemas.items())


def _is(value, kind):
    if kind in ("number", "integer"):
        return isinstance(value, int if kind == "integer" else int | float) and not isinstance(value, bool)
    return isinstance(value, _KINDS[kind])
