"""The examples' parts: the files are what the script makes, and they have the figures that the tasks count on."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import fcl
import numpy as np
import pytest
import trimesh

from kumitate.grasping.interlock import facing_grasps
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.placements import find_placements
from kumitate.robots.library import load_hand
from kumitate.tasks.cell import build_cell
from kumitate.tasks.task_file import read_task
from kumitate.transforms import Array, invert, pose, transform_points

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
FOLDER = EXAMPLES / "parts"
TASKS = sorted(path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.glob("*/*.yaml") if "limits" not in path.name)
BOUNDS = {  # [mm]
    "wheel": ([-30, 0, -30], [30, 30, 30]),
    "support": ([-15, -61, 0], [15, 61, 102]),
    "fastener": ([-17, -17, 0], [17, 17, 165]),
    "bolt_plate": ([-70, -30, 0], [70, 30, 40]),
    "drill": ([-50, -38, 0], [80, 38, 220]),
    "channel": ([-40, -28, 0], [40, 28, 25]),
    "block": ([-30, -20, 0], [30, 20, 50]),
    "peg": ([-12, -12, 0], [12, 12, 60]),
    "ring": ([-20, -20, 0], [20, 20, 40]),
    "bar": ([-12, -70, 0], [12, 70, 24]),
    "tray": ([-76, -80, 0], [92, 80, 54]),
    "base": ([-18, -57, 0], [18, 57, 68]),
    "small_wheel": ([-20, 0, -20], [20, 24, 20]),
    "cover": ([-16, -28, 0], [16, 28, 22]),
}
MASSES = {  # [kg]
    "wheel": 0.05,
    "support": 0.06,
    "fastener": 0.2,
    "drill": 1.0,
    "channel": 0.1,
    "block": 0.1,
    "peg": 0.03,
    "ring": 0.04,
    "bar": 0.08,
    "base": 0.08,
    "small_wheel": 0.025,
    "cover": 0.02,
}
# Where the wheels go on the support, and the side that they come from [mm].
GOALS = [(pose([0, 32, 10]), 1.0), (pose([0, -32, 10], [0, 0, np.pi]), -1.0)]


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("make_parts", FOLDER / "make_parts.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def meshes():
    return {name: trimesh.load(FOLDER / f"{name}.stl") for name in BOUNDS}  # mm


@pytest.fixture(scope="module")
def parts():
    return {name: Part.load(FOLDER / f"{name}.stl", unit="mm", mass=mass) for name, mass in MASSES.items()}


def test_every_file_has_its_maker(script):
    assert {path.stem for path in FOLDER.glob("*.stl")} == {make.__name__ for make in script.PARTS} == set(BOUNDS)


@pytest.mark.parametrize("name", BOUNDS)
def test_the_file_is_what_the_script_makes(script, meshes, tmp_path, name):
    made = getattr(script, name)()
    script.write(made, tmp_path / "made.stl")
    assert made.volume == pytest.approx(meshes[name].volume, rel=1e-5)
    assert _triangles(trimesh.load(tmp_path / "made.stl")) == _triangles(meshes[name])


def _triangles(mesh: trimesh.Trimesh) -> set[frozenset[tuple[float, ...]]]:
    return {frozenset(map(tuple, corners)) for corners in mesh.triangles.round(3).tolist()}


@pytest.mark.parametrize("name", BOUNDS)
def test_they_are_sound_and_not_too_fine(meshes, name):
    mesh = meshes[name]
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert len(mesh.faces) < (4000 if name == "support" else 3000)


@pytest.mark.parametrize("name", MASSES)
def test_nothing_about_them_needs_repair(parts, name):
    assert parts[name].watertight
    assert not parts[name].repairs
    assert not parts[name].warnings


@pytest.mark.parametrize("name", BOUNDS)
def test_sizes(meshes, name):
    np.testing.assert_allclose(meshes[name].bounds, BOUNDS[name], atol=1e-3)


@pytest.mark.parametrize(("y", "radii"), [(3, [8, 10, 28, 30]), (8.5, [8, 30]), (20, [20, 30])])
def test_the_wheel_is_round_about_y(meshes, y, radii):
    assert _radii(meshes["wheel"], y, [0, 0]) == pytest.approx(radii, abs=0.05)


@pytest.mark.parametrize(("y", "radius"), [(32, 7), (43.5, 7), (45, 6.5), (60, 6.5)])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_axles_are_round_about_y_at_z_10(meshes, y, radius, side):
    assert _radii(meshes["support"], side * y, [0, 10]) == pytest.approx([radius], abs=0.05)


def _radii(mesh: trimesh.Trimesh, y: float, center: list[float]) -> list[float]:
    """Radii of the circles in which the plane at ``y`` cuts ``mesh``, from within outwards."""
    outlines = mesh.section(plane_origin=[0, y, 0], plane_normal=[0, 1, 0]).discrete
    distances = [np.linalg.norm(points[:, [0, 2]] - center, axis=1) for points in outlines]
    assert all(np.ptp(d) < 0.05 for d in distances)
    return sorted(float(d.mean()) for d in distances)


def test_the_support_is_symmetric_in_y(meshes):
    mirrored = meshes["support"].copy().apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))
    assert {tuple(v) for v in mirrored.vertices.round(3)} == {tuple(v) for v in meshes["support"].vertices.round(3)}
    rays = np.random.default_rng(1).uniform([-20, -60, -5], [20, 60, 110], (500, 3))
    assert (meshes["support"].contains(rays) == meshes["support"].contains(rays * [1, -1, 1])).all()


@pytest.mark.parametrize(("goal", "side"), GOALS)
def test_the_wheel_goes_on_the_axle_with_a_millimetre_of_play(meshes, goal, side):

    def clearance(along: float, aside: tuple[float, float] = (0.0, 0.0)) -> float:
        at = goal @ pose([aside[0], 0, aside[1]])
        at[1, 3] += side * along
        return _distance(meshes["support"], meshes["wheel"], at)

    assert clearance(0.0) == pytest.approx(1.0, abs=0.02)
    way = [clearance(along) for along in np.linspace(0.0, 70.0, 36)]
    assert min(way) > 0.97
    assert way[-1] > 40.0
    for direction in np.radians(np.arange(0, 360, 45)):
        aside = np.array([np.cos(direction), np.sin(direction)])
        assert clearance(0.0, 0.95 * aside) > 0.0
        assert clearance(0.0, 1.05 * aside) == 0.0


def test_two_wheels_fit_at_once(meshes):
    (first, _), (second, _) = GOALS
    assert _distance(meshes["wheel"], meshes["wheel"], invert(first) @ second) == pytest.approx(64.0, abs=0.01)


def _distance(mesh: trimesh.Trimesh, other: trimesh.Trimesh, at: Array) -> float:
    """How far apart two meshes are, the other one at a pose (4, 4) in the frame of the first; 0 where they touch."""
    placed = fcl.CollisionObject(_solid(other), fcl.Transform(at[:3, :3], at[:3, 3]))
    first = fcl.CollisionObject(_solid(mesh))
    if fcl.collide(first, placed, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return float(fcl.distance(first, placed, fcl.DistanceRequest(), fcl.DistanceResult()))


def _solid(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return model


def test_wheels_and_cover_go_on_the_base_with_a_millimetre_of_play(meshes):
    base = meshes["base"]
    for goal in read_task(EXAMPLES / "four_parts/task.yaml").goals[:3]:
        at, insert = pose(1e3 * np.array(goal.attach.at.xyz), goal.attach.at.rpy), goal.attach.insert
        part = meshes["cover" if goal.attach.part == "cover" else "small_wheel"]
        lifted = pose(-1e-3 * np.array(insert.direction)) @ at  # what lies on a shoulder is not to count as touching it
        aside = np.eye(3)[np.abs(insert.direction) < 0.5]
        for direction in (*aside, *-aside):
            assert _distance(base, part, pose(0.95 * direction) @ lifted) > 0.0
            assert _distance(base, part, pose(1.05 * direction) @ lifted) == 0.0
        back = [pose(-along * np.array(insert.direction)) @ at for along in np.linspace(0.5, 1e3 * insert.distance, 20)]
        assert min(_distance(base, part, where) for where in back) > 0.4
        assert _distance(base, part, back[-1]) > 10.0


def test_a_base_with_wheels_stands_on_its_own_foot(meshes):
    goals = read_task(EXAMPLES / "four_parts/task.yaml").goals[:2]
    poses = [pose(1e3 * np.array(goal.attach.at.xyz), goal.attach.at.rpy) for goal in goals]
    lowest = [transform_points(at, meshes["small_wheel"].vertices)[:, 2].min() for at in poses]
    assert lowest == pytest.approx([6.0, 6.0], abs=1e-3)


@pytest.mark.parametrize("turn", np.radians([0, 20, 90, 200]))
@pytest.mark.parametrize("x", [-40, 0, 40])
def test_the_tool_s_tip_ends_on_a_bolt_s_head(meshes, x, turn):
    task = read_task(EXAMPLES / "bolt/task.yaml")
    use, tip = task.goals[0].use, task.parts["fastener"].frames["tip"]
    assert np.degrees(use.at.rpy) == pytest.approx([180.0, 0.0, 0.0])
    assert 1e3 * np.array(use.at.xyz) == pytest.approx([0.0, 0.0, 40.0])
    for above in (0.1, 1.0, 1e3 * use.approach.distance):
        at = pose([x, 0, 40 + above], use.at.rpy) @ pose(rpy=[0, 0, turn]) @ invert(pose(1e3 * np.array(tip.xyz)))
        assert _distance(meshes["bolt_plate"], meshes["fastener"], at) == pytest.approx(above, abs=1e-3)


def _kit() -> dict[str, tuple[str, Array]]:
    """The mesh of each part that goes into the tray, and its pose there [mm]."""
    task = read_task(EXAMPLES / "kitting/task.yaml")
    tray = next(entry for entry in task.cell if entry.name == "tray")
    placed = {}
    for goal in task.goals:
        at, name = goal.place.at, goal.place.part
        mesh = Path(task.parts[name].mesh).stem
        placed[name] = mesh, pose(1e3 * (np.array(at.xyz) - tray.at.xyz), at.rpy)
    return placed


@pytest.mark.parametrize("name", _kit())
def test_parts_stand_in_the_tray_with_three_millimetres_of_play(meshes, name):
    mesh, at = _kit()[name]
    tray, part, lifted = meshes["tray"], meshes[mesh], pose([0, 0, 0.01]) @ at
    assert _distance(tray, part, lifted) == pytest.approx(0.01, abs=1e-3)
    for direction in np.vstack([np.eye(3)[:2], -np.eye(3)[:2]]):
        assert _distance(tray, part, pose(2.9 * direction) @ lifted) > 0.0
        if name != "bar" or direction[0]:  # nothing holds the bar along its own length
            assert _distance(tray, part, pose(3.1 * direction) @ lifted) == 0.0


def test_the_bar_lies_over_both_rings(meshes):
    kit = _kit()
    bar, at = kit["bar"]
    for ring in ("ring", "ring2"):
        part, lying = kit[ring][0], invert(at) @ kit[ring][1]
        assert _distance(meshes[bar], meshes[part], lying) == pytest.approx(6.0, abs=1e-3)
        assert _distance(meshes[bar], meshes[part], pose([0, 0, 25]) @ lying) == 0.0


def test_what_lies_in_the_tray_keeps_apart(meshes):
    placed = [(meshes[mesh], at) for mesh, at in _kit().values()]
    for i, (mesh, at) in enumerate(placed):
        for other, there in placed[:i]:
            assert _distance(mesh, other, invert(at) @ there) > 4.0


@pytest.mark.parametrize(
    ("name", "up", "margin"),
    [
        ("wheel", [0, 1, 0], 60),
        ("wheel", [0, -1, 0], 60),
        ("support", [0, 0, 1], 20),
        ("support", [1, 0, 0], 45),
        ("fastener", [1, 0, 0], 30),
        ("drill", [0, 0, 1], 15),
        ("channel", [0, 0, 1], 45),
        ("channel", [0, 0, -1], 60),
        ("block", [0, 0, 1], 35),
        ("block", [0, 0, -1], 25),
        ("peg", [0, 0, 1], 20),
        ("ring", [0, 0, 1], 40),
        ("bar", [0, 0, 1], 40),
        ("base", [0, 0, 1], 20),
        ("small_wheel", [0, 1, 0], 50),
        ("cover", [0, 0, 1], 45),
    ],
)
def test_they_stand_stably(parts, name, up, margin):
    placements = find_placements(parts[name])
    which = _standing(placements.surface_from_part, up)
    assert np.degrees(placements.margin[which]) > margin


def _standing(surface_from_part: Array, up: list[int]) -> int:
    (which,) = np.flatnonzero(surface_from_part[:, 2, :3] @ up > 0.9999)
    return int(which)


@pytest.mark.parametrize(
    ("name", "up", "least"),
    [
        ("wheel", [0, 1, 0], 200),
        ("support", [0, 0, 1], 200),
        ("support", [1, 0, 0], 50),
        ("fastener", [1, 0, 0], 200),
        ("block", [0, 0, 1], 200),
        ("small_wheel", [0, -1, 0], 50),
        ("cover", [0, 0, 1], 50),
    ],
)
def test_a_two_finger_hand_gets_hold_of_them_on_a_table(parts, name, up, least):
    part, hand = parts[name], load_hand("robotiq_2f85")
    grasps = plan_grasps(part, hand)
    placements = find_placements(part)
    surface_from_part = placements.surface_from_part[_standing(placements.surface_from_part, up)]
    pieces = (surface_from_part @ grasps.part_from_hand)[:, None] @ hand.hand_from_piece(grasps.opening)
    lowest = np.full(len(grasps), np.inf)
    for i, piece in enumerate(hand.pieces):
        heights = pieces[:, i, 2, :3] @ piece.mesh.vertices.T + pieces[:, i, 2, 3:]
        lowest = np.minimum(lowest, heights.min(axis=1))
    assert (lowest > 0.0).sum() >= least


def test_a_cup_gets_hold_of_the_channel_s_face(parts):
    channel = parts["channel"]
    grasps = plan_grasps(channel, load_hand("suction_cup"))
    onto_the_face = (grasps.part_from_hand[:, 2, 2] < -0.999) & (np.abs(grasps.part_from_hand[:, 2, 3] - 0.025) < 1e-4)
    assert onto_the_face.sum() >= 200


@pytest.mark.slow
def test_two_hands_interlock_on_the_drill_s_handle(parts):
    drill, hand, parameters = parts["drill"], load_hand("hrp5p_three_finger"), GraspParameters()
    given = plan_grasps(drill, hand, parameters)
    across = np.abs(given.part_from_hand[:, 2, 1]) > 0.999  # the fingers of the pair one above the other
    assert len(facing_grasps(drill, hand, given[np.flatnonzero(across)], parameters)) >= 200


@pytest.mark.parametrize("file", TASKS)
def test_the_tasks_are_read(file):
    task = read_task(EXAMPLES / file)
    assert set(task.parts) == {part for goal in task.goals for part in _named(goal)}


def _named(goal) -> set[str]:
    (kind,) = (getattr(goal, kind) for kind in goal.__struct_fields__ if getattr(goal, kind) is not None)
    return {kind.part, getattr(kind, "to", kind.part)} if goal.attach else {kind.part}


@pytest.mark.slow
@pytest.mark.parametrize("file", TASKS)
def test_the_tasks_start_soundly(file):
    cell = build_cell(read_task(EXAMPLES / file), (EXAMPLES / file).parent)
    assert {contact.second for contact in cell.state.contacts} == set(cell.parts)
