"""The examples' parts: the files are what the script makes, and they have the figures that the tasks count on."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import fcl
import numpy as np
import pytest
import trimesh

from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.placements import find_placements
from kumitate.robots.library import load_hand
from kumitate.transforms import Array, pose

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "parts"
NAMES = ("wheel", "support")
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
    return {name: trimesh.load(FOLDER / f"{name}.stl") for name in NAMES}  # mm


@pytest.fixture(scope="module")
def parts():
    weights = {"wheel": 0.05, "support": 0.06}
    return {name: Part.load(FOLDER / f"{name}.stl", unit="mm", mass=weights[name]) for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_the_file_is_what_the_script_makes(script, meshes, tmp_path, name):
    made = getattr(script, name)()
    script.write(made, tmp_path / "made.stl")
    assert made.volume == pytest.approx(meshes[name].volume, rel=1e-5)
    assert _triangles(trimesh.load(tmp_path / "made.stl")) == _triangles(meshes[name])


def _triangles(mesh: trimesh.Trimesh) -> set[frozenset[tuple[float, ...]]]:
    return {frozenset(map(tuple, corners)) for corners in mesh.triangles.round(3).tolist()}


@pytest.mark.parametrize(("name", "most"), [("wheel", 2500), ("support", 4000)])
def test_they_are_sound_and_not_too_fine(meshes, parts, name, most):
    mesh = meshes[name]
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.body_count == 1
    assert len(mesh.faces) < most
    assert parts[name].watertight
    assert not parts[name].repairs
    assert not parts[name].warnings


def test_sizes(meshes):
    np.testing.assert_allclose(meshes["wheel"].bounds, [[-30, 0, -30], [30, 30, 30]], atol=1e-3)
    np.testing.assert_allclose(meshes["support"].bounds, [[-15, -61, 0], [15, 61, 102]], atol=1e-3)


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
    support, wheel = (_solid(meshes[name]) for name in ("support", "wheel"))

    def clearance(along: float, aside: tuple[float, float] = (0.0, 0.0)) -> float:
        at = goal @ pose([aside[0], 0, aside[1]])
        at[1, 3] += side * along
        placed = fcl.CollisionObject(wheel, fcl.Transform(at[:3, :3], at[:3, 3]))
        if fcl.collide(fcl.CollisionObject(support), placed, fcl.CollisionRequest(), fcl.CollisionResult()):
            return 0.0
        return fcl.distance(fcl.CollisionObject(support), placed, fcl.DistanceRequest(), fcl.DistanceResult())

    assert clearance(0.0) == pytest.approx(1.0, abs=0.02)
    way = [clearance(along) for along in np.linspace(0.0, 70.0, 36)]
    assert min(way) > 0.97
    assert way[-1] > 40.0
    for direction in np.radians(np.arange(0, 360, 45)):
        aside = np.array([np.cos(direction), np.sin(direction)])
        assert clearance(0.0, 0.95 * aside) > 0.0
        assert clearance(0.0, 1.05 * aside) == 0.0


def test_two_wheels_fit_at_once(meshes):
    a, b = (fcl.CollisionObject(_solid(meshes["wheel"]), fcl.Transform(at[:3, :3], at[:3, 3])) for at, _ in GOALS)
    assert fcl.distance(a, b, fcl.DistanceRequest(), fcl.DistanceResult()) == pytest.approx(64.0, abs=0.01)


def _solid(mesh: trimesh.Trimesh) -> fcl.BVHModel:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return model


@pytest.mark.parametrize(
    ("name", "up", "margin"),
    [("wheel", [0, 1, 0], 60), ("wheel", [0, -1, 0], 60), ("support", [0, 0, 1], 20), ("support", [1, 0, 0], 45)],
)
def test_they_stand_stably(parts, name, up, margin):
    placements = find_placements(parts[name])
    which = _standing(placements.surface_from_part, up)
    assert np.degrees(placements.margin[which]) > margin


def _standing(surface_from_part: Array, up: list[int]) -> int:
    (which,) = np.flatnonzero(surface_from_part[:, 2, :3] @ up > 0.9999)
    return int(which)


@pytest.mark.parametrize(
    ("name", "up", "least"), [("wheel", [0, 1, 0], 200), ("support", [0, 0, 1], 200), ("support", [1, 0, 0], 50)]
)
def test_a_two_finger_hand_gets_hold_of_them_on_a_table(parts, name, up, least):
    part, hand = parts[name], load_hand("robotiq_2f85")
    grasps = plan_grasps(part, hand)
    placements = find_placements(part)
    surface_from_part = placements.surface_from_part[_standing(placements.surface_from_part, up)]
    lowest = []
    for part_from_hand, opening in zip(grasps.part_from_hand, grasps.opening, strict=True):
        pieces = (surface_from_part @ part_from_hand) @ hand.hand_from_piece(opening)[0]
        heights = [piece.mesh.vertices @ at[2, :3] + at[2, 3] for piece, at in zip(hand.pieces, pieces, strict=True)]
        lowest.append(min(height.min() for height in heights))
    assert (np.array(lowest) > 0.0).sum() >= least
