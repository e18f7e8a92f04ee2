"""Cells: what a task names is loaded, stands where the task says, and what cannot be is told."""

from __future__ import annotations

from hashlib import sha256
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots import library
from kumitate.tasks.cell import build_cell, robot_of
from kumitate.tasks.task import At, Grasping, Mounted, Obstacle, OwnRobot, PartEntry, Task
from kumitate.tasks.task_checks import grasp_parameters
from kumitate.tasks.task_file import read_task
from kumitate.transforms import pose

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "wheel_support"
PARTS = EXAMPLES.parent / "parts"
HANDS = {"left": "robotiq_2f85", "right": "robotiq_2f85"}
TABLE = Obstacle("table", At((0.4, 0, -0.06)), box=(0.3, 1.32, 0.02), support=True)
WHEEL = PartEntry("../parts/wheel.stl", "mm", At((0.4, 0.35, -0.05), (pi / 2, 0, 0)), mass=0.05)
ONE_WHEEL = Task(robot="nextage", hands=HANDS, parts={"wheel": WHEEL}, goals=(), cell=(TABLE,))


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("lying", "two_wheels")]


@pytest.fixture(scope="module", params=["task", "two_wheels_lying", *SLOW])
def cell(request):
    return build_cell(read_task(EXAMPLES / f"{request.param}.yaml"), EXAMPLES)


def test_everything_stands_where_the_task_says_and_touches_nothing(cell):
    task = cell.task
    for name, entry in {"table": task.cell[0], **task.parts}.items():
        np.testing.assert_allclose(cell.state.poses[name], pose(entry.at.xyz, entry.at.rpy), atol=1e-12)
        assert cell.scene.bodies[name].fixed == (name == "table")
    assert (cell.state.q == cell.robot.home).all()
    assert cell.state.openings == {"left": 0.085, "right": 0.085}
    assert not cell.state.attached
    assert cell.scene.touching(cell.state) == ()
    # The contacts with the table are all that is excused.
    assert set(cell.scene.touching(cell.state.with_contacts([]))) == {("table", name) for name in task.parts}


def test_each_part_rests_on_the_table_to_a_tenth_of_a_millimetre(cell):
    assert [(c.first, c.second) for c in cell.state.contacts] == [("table", name) for name in cell.task.parts]
    for name, part in cell.parts.items():
        bottom = (part.mesh.vertices @ cell.state.poses[name][2, :3]).min() + cell.state.poses[name][2, 3]
        assert bottom == pytest.approx(-0.05, abs=1e-4)


def test_parts_have_their_names_and_weights(cell):
    for name, part in cell.parts.items():
        assert part.name == name
        assert part.mass == cell.task.parts[name].mass
        assert cell.scene.bodies[name].mesh.volume == pytest.approx(part.mesh.volume)


def test_the_plan_gets_the_triangles_of_the_files(cell):
    assert set(cell.meshes) == set(cell.scene.bodies)
    for name, entry in cell.task.parts.items():
        file = EXAMPLES / entry.mesh
        given = trimesh.load(file, process=False)
        packed = cell.meshes[name].trimesh()
        np.testing.assert_allclose(packed.triangles, given.triangles * 1e-3, rtol=1e-12)
        assert cell.meshes[name].digest == sha256(file.read_bytes()).hexdigest()
    box = cell.meshes["table"]
    assert box.digest == ""
    np.testing.assert_allclose(box.trimesh().extents, [0.3, 1.32, 0.02])


def test_the_table_is_a_support(cell):
    (support,) = cell.supports
    assert support.name == "table"
    np.testing.assert_allclose(support.world_from_support[:3, 3], [0.4, 0, -0.05], atol=1e-12)
    np.testing.assert_allclose(support.size, [0.3, 1.32])


def test_grasp_parameters_are_the_papers_but_for_those_given():
    wheel = replace(WHEEL, grasps=Grasping(theta_pln=radians(10), n_da=4))
    parameters = grasp_parameters(wheel)
    assert (parameters.theta_pln, parameters.n_da) == (radians(10), 4)
    assert parameters.t_rnn == 3e-3


def test_density_gives_the_mass_and_a_mesh_may_be_an_obstacle_and_a_support(tmp_path):
    trimesh.creation.box([4, 6, 2]).export(tmp_path / "block.stl")
    block = PartEntry("block.stl", "cm", At((0.4, 0.3, 0.02)), density=2700)
    stand = Obstacle("stand", At((0.4, 0.3, 0.0)), mesh="block.stl", unit="cm", support=True)
    cell = build_cell(_task(hands={}, cell=(stand,), parts={"block": block}), tmp_path)
    assert cell.parts["block"].mass == pytest.approx(2700 * 48e-6)
    assert [(c.first, c.second) for c in cell.state.contacts] == [("stand", "block")]
    assert cell.supports[0].size == pytest.approx([0.04, 0.06])
    np.testing.assert_allclose(cell.meshes["stand"].trimesh().extents, [0.04, 0.06, 0.02], rtol=1e-6)


def test_a_tray_carries_parts_and_has_no_free_spots_of_its_own(tmp_path):
    hollow = trimesh.creation.box([6, 6, 2], transform=pose([0, 0, 1]))
    tray = trimesh.boolean.difference([trimesh.creation.box([8, 8, 2]), hollow])
    tray.export(tmp_path / "tray.stl")
    trimesh.creation.box([2, 2, 2]).export(tmp_path / "cube.stl")
    cube = PartEntry("cube.stl", "cm", At((0.4, 0.3, 0.01)), mass=0.02)
    stand = Obstacle("tray", At((0.4, 0.3, 0.0)), mesh="tray.stl", unit="cm", support=True)
    cell = build_cell(_task(hands={}, cell=(stand,), parts={"cube": cube}), tmp_path)
    assert [(c.first, c.second) for c in cell.state.contacts] == [("tray", "cube")]
    assert cell.supports == ()
    with pytest.raises(InputError, match="rests on tray, which is no support"):
        build_cell(_task(hands={}, cell=(replace(stand, support=False),), parts={"cube": cube}), tmp_path)


def _task(**changes):
    return replace(ONE_WHEEL, **changes)


def _wheel(**changes):
    return {"wheel": replace(WHEEL, **changes)}


@pytest.mark.parametrize(
    ("task", "place", "words"),
    [
        (_task(robot="nextag"), "robot", "known: nextage, ur3_dual, hrp5p"),
        (_task(hands={"middle": "robotiq_2f85"}), "hands.middle", "known: left, right"),
        (_task(hands={"left": "robotiq"}), "hands.left", "known: robotiq_2f85, hrp5p_three_finger, suction_cup"),
        (_task(hands={"left": Mounted("robotiq")}), "hands.left", "known: robotiq_2f85"),
        (_task(start={"LARM_JOINT9": 0.0}), "start", "LARM_JOINT0"),
        (_task(start={"LARM_JOINT0": 3.0}), "start.LARM_JOINT0", "stay between"),
        (_task(start={"CHEST_JOINT0": 3.0}), "start.CHEST_JOINT0", "stay between"),
        (_task(speed=0.0), "speed", "more than 0"),
        (_task(parts=_wheel(mesh="/etc/wheel.stl")), "parts.wheel.mesh", "relative to the task file"),
        (_task(parts=_wheel(unit="m")), str(EXAMPLES / "../parts/wheel.stl"), "the unit is likely mm"),
        (_task(parts=_wheel(at=At((0.4, 0.35, 0.0), (pi / 2, 0, 0)))), "parts.wheel.at", "floats 50.00 mm above table"),
        (_task(parts=_wheel(at=At((0.4, 0.35, -0.02)))), "parts.wheel.at", "tilted by 90.0 deg"),
        (
            _task(parts={"wheel": WHEEL, "wheel2": replace(WHEEL, at=At((0.41, 0.35, -0.05), (pi / 2, 0, 0)))}),
            "parts.wheel.at",
            "overlaps wheel2",
        ),
        (
            _task(cell=(TABLE, Obstacle("post", At((0.4, 0.35, 0.0)), box=(0.02, 0.02, 0.2)))),
            "parts.wheel.at",
            "overlaps post",
        ),
        (_task(cell=(TABLE, Obstacle("block", At((0.4, 0, 0.2)), box=(0.3, 1, 0.1)))), "start", "block"),
        (_task(cell=(replace(TABLE, at=At((0.4, 0, -0.06), (0.1, 0, 0))),), parts={}), "cell[0].support", "level"),
        (_task(cell=(replace(TABLE, name="chest"),), parts={}), "scene", "taken"),
    ],
)
def test_what_cannot_be_is_told_with_its_place(task, place, words):
    with pytest.raises(InputError) as caught:
        build_cell(task, EXAMPLES)
    assert caught.value.place == place
    assert words in str(caught.value)


def test_a_part_that_touches_the_robot_at_the_start_is_told():
    robot = robot_of(ONE_WHEEL, EXAMPLES)
    x, y, z = robot.hand_pose("left", robot.home, 0.085)[:3, 3]
    under = Obstacle("stand", At((x, y, z - 0.11)), box=(0.1, 0.1, 0.2), support=True)
    wheel = replace(WHEEL, at=At((x, y, z - 0.01), (pi / 2, 0, 0)))
    with pytest.raises(InputError, match=r"at the start these touch: .*left/") as caught:
        build_cell(_task(cell=(under,), parts={"wheel": wheel}), EXAMPLES)
    assert caught.value.place in ("parts.wheel.at", "start")


def test_the_start_is_where_the_task_says_and_a_chest_stays_there():
    start = {"LARM_JOINT0": 0.3, "CHEST_JOINT0": 0.2}
    task = _task(start=start)
    robot = robot_of(task, EXAMPLES)
    plain = robot_of(ONE_WHEEL, EXAMPLES)
    names = robot.joint_names
    assert robot.home[names.index("CHEST_JOINT0")] == 0.2
    assert robot.home[names.index("LARM_JOINT0")] == plain.home[names.index("LARM_JOINT0")]
    q = build_cell(replace(task, hands={}, cell=(), parts={}), EXAMPLES).state.q
    wanted = dict(zip(names, plain.home, strict=True)) | start
    assert dict(zip(names, q, strict=True)) == wanted


def test_hands_sit_where_they_are_mounted():
    mount = At((0.0, 0.0, 0.01), (0, 0, pi / 2))
    mounted = robot_of(_task(hands={"left": Mounted("robotiq_2f85", mount)}), EXAMPLES)
    plain = robot_of(ONE_WHEEL, EXAMPLES)
    assert set(mounted.hands) == {"left"}
    flange = plain.flange("left", plain.home)
    flange_from_hand = np.linalg.inv(flange) @ plain.hand_pose("left", plain.home, 0.04)
    wanted = flange @ pose(mount.xyz, mount.rpy) @ flange_from_hand
    np.testing.assert_allclose(mounted.hand_pose("left", plain.home, 0.04), wanted, atol=1e-9)


def test_a_robot_and_a_hand_of_ones_own_come_from_their_files(tmp_path):
    shipped = Path(library.__file__).parent
    for name in ("ur3_dual.urdf", "ur3_dual.srdf", "ur3_dual_limits.yaml", "suction_cup.yaml", "suction_cup.urdf"):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    base = At((0.0, 0.0, 0.5))
    own = OwnRobot("ur3_dual.urdf", "ur3_dual.srdf", "ur3_dual_limits.yaml", base=base)
    robot = robot_of(_task(robot=own, hands={"left": "suction_cup.yaml"}), tmp_path)
    same = library.load_robot("ur3_dual", {"left": "suction_cup"}, base=pose(base.xyz, base.rpy))
    assert set(robot.arms) == set(same.arms)
    np.testing.assert_allclose(robot.hand_pose("left", robot.home), same.hand_pose("left", same.home), atol=1e-12)
    with pytest.raises(UnknownNameError, match="ready"):
        robot_of(_task(robot=replace(own, home="ready"), hands={}), tmp_path)
