"""Cells: what a task names is loaded, stands where the task says, and what cannot be is told."""

from __future__ import annotations

import dataclasses
import shlex
from hashlib import sha256
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from kumitate.errors import InputError, UnknownNameError
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.measured import Measured
from kumitate.grasping.part import Part
from kumitate.grasping.store import cached_grasps
from kumitate.robots import library
from kumitate.tasks.cell import build_cell, robot_of
from kumitate.tasks.cli import main
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.job import Job
from kumitate.tasks.planner import plan
from kumitate.tasks.task import At, Goal, Grasping, Mounted, Obstacle, OwnRobot, PartEntry, Place, Task
from kumitate.tasks.task_checks import grasp_parameters
from kumitate.tasks.task_file import read_task
from kumitate.transforms import pose, pose_distance

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


# What was measured of grasps ------------------------------------------------------------------------------------------

COARSE = Grasping(t_rnn=0.006, n_da=4)


@pytest.fixture
def wheel_here(tmp_path):
    """The wheel, its mesh in a folder of its own."""
    (tmp_path / "wheel.stl").write_bytes((PARTS / "wheel.stl").read_bytes())
    return replace(WHEEL, mesh="wheel.stl", grasps=COARSE)


def planned(entry, folder, hand="robotiq_2f85"):
    """The grasps of a part that are planned."""
    part = Part.load(folder / entry.mesh, unit=entry.unit, mass=entry.mass, density=entry.density)
    return cached_grasps(part, library.load_hand(hand), grasp_parameters(entry))


def saved(grasps, held, path):
    """Write ``grasps`` as if all had been tried and those of the mask ``held`` had held."""
    n = len(grasps)
    measured = Measured(np.ones(n, dtype=bool), *np.zeros((3, n)), held)
    dataclasses.replace(grasps, measured=measured).save(path)


def with_files(entry, *files, hands=HANDS):
    return _task(hands=hands, parts={"wheel": replace(entry, grasps=replace(entry.grasps, measured=files))})


@pytest.mark.parametrize(
    ("hands", "measured"),
    [
        (HANDS, {"robotiq_2f85"}),
        ({"left": "robotiq_2f85", "right": "suction_cup"}, {"suction_cup"}),
        ({"left": "robotiq_2f85", "right": "suction_cup"}, {"suction_cup", "robotiq_2f85"}),
    ],
)
def test_each_arm_has_what_was_measured_of_its_hand(wheel_here, tmp_path, hands, measured):
    for hand in measured:
        grasps = planned(wheel_here, tmp_path, hand)
        saved(grasps, np.arange(len(grasps)) % 2 == 0, tmp_path / f"{hand}.npz")
    files = [f"{hand}.npz" for hand in sorted(measured)]
    simulated = build_cell(with_files(wheel_here, *files, hands=hands), tmp_path).simulated
    assert set(simulated) == {("wheel", arm) for arm, hand in hands.items() if hand in measured}
    for (_, arm), grasps in simulated.items():
        assert (grasps.part, grasps.hand) == ("wheel", hands[arm])
        assert len(grasps.held()) == (len(grasps) + 1) // 2 > 0


def test_hands_that_differ_in_name_alone_share_a_file(wheel_here, tmp_path):
    shipped = Path(library.__file__).parent
    text = (shipped / "suction_cup.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(text.replace("name: suction_cup", "name: mine"), encoding="utf-8")
    (tmp_path / "suction_cup.urdf").write_bytes((shipped / "suction_cup.urdf").read_bytes())
    grasps = planned(wheel_here, tmp_path, "suction_cup")
    saved(grasps, np.arange(len(grasps)) % 2 == 0, tmp_path / "cup.npz")
    task = with_files(wheel_here, "cup.npz", hands={"left": "mine.yaml", "right": "suction_cup"})
    job = Job(build_cell(task, tmp_path), 0, Deadline(600.0))
    held = [job.grasps("wheel", arm) for arm in ("left", "right")]
    assert [some.hand for some in held] == ["mine", "suction_cup"]
    assert len(held[0]) == len(held[1]) == (len(grasps) + 1) // 2 > 0


def test_a_plan_takes_a_part_only_with_grasps_that_held(wheel_here, tmp_path):
    goal = Goal(place=Place("wheel", At((0.4, 0.25, -0.05), (pi / 2, 0, 0))))

    def taken(task):
        """How the hands take the part (k, 4, 4)."""
        actions = plan(replace(task, goals=(goal,)), tmp_path, seed=1).actions
        taking = [action for action in actions if any(event.kind == "attach" for event in action.events)]
        return np.array([action.grasp.part_from_hand for action in taking])

    grasps = planned(wheel_here, tmp_path)
    (freely,) = taken(_task(parts={"wheel": wheel_here}))
    held = pose_distance(grasps.part_from_hand, freely)[1] > radians(40.0)
    held &= (pose(WHEEL.at.xyz, WHEEL.at.rpy) @ grasps.part_from_hand)[:, 2, 2] < -0.5  # from above
    saved(grasps, held, tmp_path / "wheel.npz")
    found = taken(with_files(wheel_here, "wheel.npz"))
    assert len(found) > 0
    for grasp in found:
        same = np.abs(grasps.part_from_hand - grasp).max(axis=(1, 2)) < 1e-9
        assert same.any()
        assert held[same].all()


def test_files_of_other_grasps_are_refused_and_the_cure_gives_the_right_ones(wheel_here, tmp_path, monkeypatch):
    entry = replace(wheel_here, grasps=replace(COARSE, theta_parl=radians(165.0)))
    right, path = planned(entry, tmp_path), tmp_path / "wheel.npz"
    others = (
        planned(wheel_here, tmp_path),  # with other parameters
        planned(replace(entry, mass=0.06), tmp_path),
        planned(replace(entry, mesh=str(PARTS / "support.stl")), tmp_path),
        dataclasses.replace(right, key=""),
    )
    told = {}
    for grasps in (*others, right):
        saved(grasps, np.ones(len(grasps), dtype=bool), path)
        if grasps is right:
            dataclasses.replace(right).save(path)
        with pytest.raises(InputError) as caught:
            build_cell(with_files(entry, "wheel.npz"), tmp_path)
        assert caught.value.place == "parts.wheel.grasps.measured[0]"
        told[caught.value.problem] = caught.value.cure
    of_wheel, of_support, unmeasured = told
    assert of_wheel.startswith("wheel.npz has other grasps (of wheel by robotiq_2f85) than those planned here:")
    assert "(of support by robotiq_2f85)" in of_support
    assert unmeasured == "nothing was measured of the grasps in wheel.npz"
    (command,) = {cure.split("`")[1] for cure in told.values()}
    name, subject, *options = shlex.split(command)
    assert (name, subject, options[-1]) == ("kumitate", "simulate", "--output=wheel.npz")
    monkeypatch.chdir(tmp_path)
    assert main(["grasps", *options]) == 0
    assert GraspSet.load(path).key == right.key != ""


def test_files_that_no_arm_has_use_for_are_refused(wheel_here, tmp_path):
    for hand in ("suction_cup", "robotiq_2f85"):
        grasps = planned(wheel_here, tmp_path, hand)
        saved(grasps, np.ones(len(grasps), dtype=bool), tmp_path / f"{hand}.npz")
    (tmp_path / "again.npz").write_bytes((tmp_path / "robotiq_2f85.npz").read_bytes())
    for files, words in (
        (("suction_cup.npz",), "suction_cup.npz has grasps by suction_cup, which no arm has"),
        (("robotiq_2f85.npz", "again.npz"), "again.npz is a second file of wheel by robotiq_2f85"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            build_cell(with_files(wheel_here, *files), tmp_path)
        assert caught.value.place == f"parts.wheel.grasps.measured[{len(files) - 1}]"
    (tmp_path / "again.npz").write_bytes(b"PK")
    with pytest.raises(InputError, match="no grasp set") as caught:
        build_cell(with_files(wheel_here, "again.npz"), tmp_path)
    assert caught.value.place == str(tmp_path / "again.npz")
