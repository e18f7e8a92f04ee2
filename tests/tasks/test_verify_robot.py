"""The verifier's own kinematics and shapes, against pinocchio's and by construction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from kumitate.errors import InputError
from kumitate.robots.library import load_robot
from kumitate.tasks.verify_arms import adjacent, read_machine
from kumitate.tasks.verify_robot import read_tree
from kumitate.tasks.verify_task import read_task

HANDS = {
    "nextage": {"left": "robotiq_2f85", "right": "suction_cup"},
    "ur3_dual": {"left": "suction_cup", "right": "robotiq_2f85"},
    "hrp5p": {"left": "hrp5p_three_finger", "right": "robotiq_2f85"},
}


def machine_of(name, hands):
    task = {"robot": name, "hands": hands, "parts": {}, "goals": []}
    return read_machine(read_task(task), task, Path())


@pytest.mark.parametrize("name", HANDS)
def test_it_agrees_with_the_planners_robot(name, rng):
    machine, robot = machine_of(name, HANDS[name]), load_robot(name, HANDS[name])
    order = [machine.joint_names.index(joint) for joint in robot.joint_names]
    limits = [robot.lower, robot.upper, robot.velocity, robot.acceleration]
    np.testing.assert_allclose(machine.limits[:, order], limits)
    np.testing.assert_allclose(machine.home[order], robot.home)
    assert machine.disabled == robot.disabled
    assert set(machine.arms) == set(robot.arms)
    for q in rng.uniform(robot.lower, robot.upper, (20, len(order))):
        mine = np.zeros((1, len(order)))
        mine[0, order] = q
        flanges = machine.flanges(mine)
        for arm, gripper in machine.grippers.items():
            np.testing.assert_allclose(flanges[arm][0], robot.flange(arm, q), atol=1e-9)
            opening = rng.uniform(*gripper.stroke)
            hand = flanges[arm] @ gripper.hand(np.array([opening]))
            np.testing.assert_allclose(hand[0], robot.hand_pose(arm, q, opening), atol=1e-7)


@pytest.mark.parametrize("hand", ["robotiq_2f85", "hrp5p_three_finger", "suction_cup"])
def test_pieces_of_hands_stand_where_the_planners_do(hand):
    gripper = machine_of("nextage", {"left": hand}).grippers["left"]
    other = load_robot("nextage", {"left": hand}).hands["left"]
    openings = np.linspace(*other.stroke, 5)
    links, poses = gripper.links(openings), other.base_from_piece(openings)
    assert {piece.name for piece in other.pieces} == set(gripper.pieces)
    for k, piece in enumerate(other.pieces):
        link, mesh = gripper.pieces[piece.name]
        for mine, theirs in zip(links[:, link], poses[:, k], strict=True):
            ours = mesh.copy().apply_transform(mine).bounds
            np.testing.assert_allclose(ours, piece.mesh.copy().apply_transform(theirs).bounds, atol=2e-4)


def test_a_hand_sits_where_it_is_mounted():
    task = {"robot": "nextage", "parts": {}, "goals": []}
    mount = {"xyz": [0.0, 0.01, 0.02], "rpy": [0.0, 0.0, 0.5]}
    turned = {**task, "hands": {"left": {"hand": "suction_cup", "mount": mount}}}
    gripper = read_machine(read_task(turned), turned, Path()).grippers["left"]
    np.testing.assert_allclose(gripper.hand(np.zeros(1))[0, :3, 3], [0.0, 0.01, 0.12], atol=1e-12)


def urdf(tmp_path, shapes="", joints='<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint>'):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r"><link name="a">{shapes}</link><link name="b"/>{joints}</robot>')
    return path


def test_curved_shapes_are_held_by_their_triangles(tmp_path, rng):
    for shape, inner in (
        ('<sphere radius="0.1"/>', lambda p: p * 0.1 / np.linalg.norm(p, axis=1, keepdims=True)),
        (
            '<cylinder radius="0.1" length="0.4"/>',
            lambda p: np.column_stack([0.1 * p[:, :2] / np.linalg.norm(p[:, :2], axis=1, keepdims=True), p[:, 2] / 9]),
        ),
    ):
        path = urdf(tmp_path, f"<collision><geometry>{shape}</geometry></collision>")
        mesh = read_tree(path).meshes["a"]
        points = inner(rng.uniform(-1.0, 1.0, (200, 3)))
        heights = (
            np.einsum("tk,pk->tp", mesh.face_normals, points)
            - np.einsum("tk,tk->t", mesh.face_normals, mesh.triangles[:, 0])[:, None]
        )
        assert heights.max() < 1e-9  # no point of the surface lies outside of any facet
        assert mesh.volume < 1.01 * trimesh.convex.convex_hull(points).volume * 2.0


def test_meshes_are_found_in_package_folders_and_scaled(tmp_path):
    folder = tmp_path / "packages" / "cell" / "meshes"
    folder.mkdir(parents=True)
    trimesh.creation.box([2.0, 2.0, 2.0]).export(folder / "cube.stl")
    path = urdf(
        tmp_path,
        '<collision><origin xyz="1 0 0"/><geometry><mesh filename="package://cell/meshes/cube.stl" scale=".1 .1 .2"/>'
        "</geometry></collision>",
    )
    for packages in ([tmp_path / "packages"], [tmp_path / "packages" / "cell"]):
        bounds = read_tree(path, packages).meshes["a"].bounds
        np.testing.assert_allclose(bounds, [[0.9, -0.1, -0.2], [1.1, 0.1, 0.2]], atol=1e-9)
    with pytest.raises(InputError, match="no mesh"):
        read_tree(path)


def test_links_are_adjacent_through_links_without_shape():
    tree = machine_of("nextage", {}).tree
    assert frozenset(("waist", "chest")) in adjacent(tree)
    assert frozenset(("waist", "left_link0")) not in adjacent(tree)
    disabled = machine_of("nextage", {}).disabled
    assert all(pair in disabled for pair in adjacent(tree))


def test_what_is_no_urdf_is_refused(tmp_path):
    joint = '<joint name="j" type="{}"><parent link="a"/><child link="{}"/><axis xyz="{}"/></joint>'
    for shapes, joints, message in (
        ("", joint.format("floating", "b", "1 0 0"), "j is floating"),
        ("", joint.format("revolute", "c", "1 0 0"), "no parent|no URDF"),
        ("", joint.format("revolute", "b", "1 nan 0"), "no vector"),
        ("", "", "no parent"),
        ("<collision/>", joint.format("fixed", "b", "1 0 0"), "is empty"),
        (
            "<collision><geometry><box size='1 2'/></geometry></collision>",
            joint.format("fixed", "b", "1 0 0"),
            "vector",
        ),
        ("<collision><geometry><cone/></geometry></collision>", joint.format("fixed", "b", "1 0 0"), "is a cone"),
    ):
        with pytest.raises(InputError, match=message):
            read_tree(urdf(tmp_path, shapes, joints))
    links = "".join(f'<link name="l{i}"/>' for i in range(501))
    (tmp_path / "robot.urdf").write_text(f'<robot name="r">{links}</robot>')
    with pytest.raises(InputError, match="more than 500"):
        read_tree(tmp_path / "robot.urdf")
    (tmp_path / "robot.urdf").write_text("<robot")
    with pytest.raises(InputError, match="no XML"):
        read_tree(tmp_path / "robot.urdf")
    with pytest.raises(InputError, match="cannot be read"):
        read_tree(tmp_path / "nothing.urdf")
