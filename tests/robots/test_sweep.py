"""Bounds on the motion of bodies hold for every point of every body, all along the way."""

from __future__ import annotations

import numpy as np
import pytest

from kumitate.robots.library import load_robot
from kumitate.robots.robot import Robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body
from kumitate.robots.sweep import Sweep
from kumitate.transforms import pose, transform_points

SUBSAMPLES = 200
HANDS = {"ur3_dual": "robotiq_2f85", "nextage": "suction_cup", "hrp5p": "hrp5p_three_finger"}


def carrying(name, make_mesh):
    """A robot that holds a long bracket in its left hand; with the vertices of what the left arm moves, by joint."""
    robot = load_robot(name, {"left": HANDS[name]})
    scene = Scene.of(robot, [Body.from_mesh("bracket", make_mesh("bracket", 0.3, 0.02, 0.05))])
    opening = robot.hands["left"].stroke[1]
    start = scene.state(
        {"bracket": robot.hand_pose("left", robot.home, opening) @ pose((0.0, 0.0, 0.1), (1.0, 0.2, 0.0))}
    )
    return scene, scene.attach(start, "bracket", "left")


def points_of(judge, state, arm, path, rng):
    """Where (k, points, 3) a path puts random vertices of everything that ``arm`` moves."""
    robot = judge.scene.robot
    bodies = [i for i, name in enumerate(judge.names) if name in judge.scene.bodies or name.startswith(f"{arm}/")]
    joints = {robot.model.getJointId(joint) for joint in robot.arms[arm].chain.names}
    bodies += [judge.names.index(link.name) for link in robot.links if link.joint in joints]
    chosen = {i: rng.choice(judge.meshes[i].vertices, 20) for i in bodies}
    poses = np.array([judge.poses(state, q) for q in path])
    return np.concatenate([transform_points(poses[:, i], points) for i, points in chosen.items()], axis=1)


@pytest.mark.parametrize("name", ["ur3_dual", "nextage", "hrp5p"])
@pytest.mark.parametrize("size", [0.02, 0.3, 1.5])
def test_no_point_moves_farther_than_the_bound(name, size, make_mesh, reference, rng):
    scene, state = carrying(name, make_mesh)
    robot, judge = scene.robot, reference(scene)
    sweep, arm = Sweep(scene, state, ["left"]), robot.arms["left"]
    ratios = []
    for _ in range(3):
        path = np.tile(rng.uniform(robot.lower, robot.upper), (2, 1))
        path[1, arm.indices] += rng.normal(size=arm.chain.dof) * size * (rng.random(arm.chain.dof) < 0.6)
        (bound,) = sweep.bounds(path)
        shares = np.linspace(0.0, 1.0, SUBSAMPLES + 1)[:, None]
        moved = points_of(judge, state, "left", path[0] + shares * (path[1] - path[0]), rng)
        farthest = np.linalg.norm(moved - moved[0], axis=-1).max()
        assert farthest <= bound + 1e-9
        ratios.append(farthest / max(bound, 1e-9))
    # A bound that always said a metre would be of no use.
    if size == 0.02:
        assert max(ratios) > 0.4


@pytest.mark.parametrize("step", [0.005, 0.03])
def test_refined_paths_keep_their_waypoints_and_the_step(make_mesh, rng, step):
    scene, state = carrying("ur3_dual", make_mesh)
    robot = scene.robot
    sweep = Sweep(scene, state, ["left", "right"])
    path = np.clip(robot.home + np.cumsum(rng.normal(size=(6, robot.model.nq)), axis=0) * 0.2, robot.lower, robot.upper)
    path[3] = path[2]
    fine, shares = sweep.refined(path, np.arange(len(path), dtype=float), step)
    assert np.array_equal(fine[np.isin(shares, np.arange(len(path)))], path)
    assert (sweep.bounds(fine) <= step).all()
    places = [int(np.argmin(np.abs(fine - q).max(axis=1))) for q in path]
    assert np.array_equal(fine[places], path)
    assert places == sorted(places)
    assert np.array_equal(fine[[0, -1]], path[[0, -1]])
    # Between two waypoints it stays on the segment.
    for q, before, after in zip(fine[:-1], *_ends(path, places, len(fine)), strict=True):
        span = after - before
        share = np.clip((q - before) @ span / max(span @ span, 1e-12), 0.0, 1.0)
        assert np.allclose(q, before + share * span, atol=1e-9)
    lengths = np.linalg.norm(np.diff(fine, axis=0), axis=1).sum(), np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert np.isclose(*lengths)


def _ends(path, places, n):
    segment = np.searchsorted(places, np.arange(n - 1), side="right") - 1
    segment = np.minimum(segment, len(path) - 2)
    return path[segment], path[segment + 1]


def test_a_path_that_stands_still_needs_no_more(make_mesh):
    scene, state = carrying("ur3_dual", make_mesh)
    path = np.tile(scene.robot.home, (3, 1))
    sweep = Sweep(scene, state, ["left"])
    assert (sweep.bounds(path) == 0.0).all()
    assert np.array_equal(sweep.refined(path, np.zeros(len(path)), 0.001)[0], path)


SLIDER = """<robot name="slider"><link name="root"/>{links}{joints}</robot>"""


def slider(folder):
    """An arm that turns, slides out a metre, turns, slides and turns again."""
    kinds = ["revolute", "prismatic", "revolute", "prismatic", "revolute"]
    axes = ["0 0 1", "1 0 0", "0 1 0", "0 0 1", "1 0 0"]
    shape = '<collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision>'
    links = "".join(f'<link name="l{i}">{shape}</link>' for i in range(5))
    joints = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="{f"l{i - 1}" if i else "root"}"/><child link="l{i}"/>'
        f'<origin xyz="0.05 0 0"/><axis xyz="{axis}"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i, (kind, axis) in enumerate(zip(kinds, axes, strict=True))
    )
    (folder / "slider.urdf").write_text(SLIDER.format(links=links, joints=joints))
    group = '<group name="arm"><chain base_link="root" tip_link="l4"/></group>'
    (folder / "slider.srdf").write_text(f'<robot name="slider">{group}</robot>')
    return Robot.load(folder / "slider.urdf", folder / "slider.srdf")


def test_the_bound_holds_for_joints_that_slide(tmp_path, rng):
    robot = slider(tmp_path)
    scene = Scene.of(robot, [])
    sweep, arm = Sweep(scene, scene.state({}), ["arm"]), robot.arms["arm"]
    corner = robot.links[-1].mesh.vertices
    for _ in range(200):
        path = rng.uniform(robot.lower, robot.upper, (2, 5))
        (bound,) = sweep.bounds(path)
        shares = np.linspace(0.0, 1.0, SUBSAMPLES + 1)[:, None]
        poses = arm.chain.joint_poses(path[0] + shares * (path[1] - path[0]))[:, -1]
        moved = transform_points(poses, corner)
        assert np.linalg.norm(moved - moved[0], axis=-1).max() <= bound + 1e-9
        # The chord that the bound is made of is left by no more than the bound's other part.
        chord = moved[:1] + shares[:, None] * (moved[-1:] - moved[:1])
        excess = bound - np.linalg.norm(np.diff(sweep.positions(path), axis=0), axis=-1).max()
        assert np.linalg.norm(moved - chord, axis=-1).max() <= excess + 1e-9
