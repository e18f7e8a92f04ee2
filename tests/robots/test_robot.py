"""Robots from URDF and SRDF: the shipped ones, one of a user's own, and what wrong files get."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import trimesh

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots import library
from kumitate.robots.library import load_hand, load_robot
from kumitate.robots.robot import Robot
from kumitate.robots.scene import Scene
from kumitate.transforms import pose, pose_distance

FOLDER = Path(library.__file__).parent
SHIPPED = {"nextage": "robotiq_2f85", "ur3_dual": "robotiq_2f85", "hrp5p": "hrp5p_three_finger"}


def robot_data() -> Path:
    shares = (Path(entry) / "cmeel.prefix/share/example-robot-data/robots" for entry in sys.path)
    return next(folder for folder in shares if folder.is_dir())


@pytest.fixture(scope="module")
def pandas(tmp_path_factory) -> Robot:
    """Two Pandas without their own hands on one base, as a user would bring them: a URDF, a short SRDF, 2F-85 hands."""
    folder = tmp_path_factory.mktemp("pandas")
    arm = ElementTree.parse(robot_data() / "panda_description/urdf/panda.urdf").getroot()
    kept = {f"panda_link{i}" for i in range(9)}
    both = ElementTree.Element("robot", name="pandas")
    ElementTree.SubElement(both, "link", name="base")
    for side, y in (("left", 0.3), ("right", -0.3)):
        text = ElementTree.tostring(arm, encoding="unicode").replace('"panda_', f'"{side}_panda_')
        for element in ElementTree.fromstring(text):
            links = (
                [element.get("name", "")]
                if element.tag == "link"
                else [e.get("link", "") for e in element.findall("*")]
            )
            if element.tag in ("link", "joint") and all(not x or x.removeprefix(f"{side}_") in kept for x in links):
                both.append(element)
        mount = ElementTree.SubElement(both, "joint", name=f"{side}_mount", type="fixed")
        ElementTree.SubElement(mount, "parent", link="base")
        ElementTree.SubElement(mount, "child", link=f"{side}_panda_link0")
        ElementTree.SubElement(mount, "origin", xyz=f"0 {y} 0", rpy="0 0 0")
    urdf, srdf = folder / "pandas.urdf", folder / "pandas.srdf"
    urdf.write_text(ElementTree.tostring(both, encoding="unicode"))
    home = {1: 0.0, 2: -0.785, 3: 0.0, 4: -2.356, 5: 0.0, 6: 1.571, 7: 0.785}
    groups = [
        f'<group name="{side}"><chain base_link="base" tip_link="{side}_panda_link8"/></group>'
        f'<group_state name="home" group="{side}">'
        + "".join(f'<joint name="{side}_panda_joint{i}" value="{value}"/>' for i, value in home.items())
        + "</group_state>"
        for side in ("left", "right")
    ]
    srdf.write_text(f'<robot name="pandas">{"".join(groups)}</robot>')
    robot = Robot.load(urdf, srdf, package_dirs=[robot_data().parents[1]])
    hand = load_hand("robotiq_2f85")
    turned = pose(rpy=[0.0, 0.0, np.pi / 4])
    return robot.with_hand("left", hand, turned).with_hand("right", hand, turned)


def test_a_robot_of_the_users_own_comes_in_with_a_hand_on_it(pandas, rng):
    assert list(pandas.arms) == ["left", "right"]
    assert pandas.arms["left"].chain.dof == 7
    scene = Scene.of(pandas, [])
    state = scene.state({})
    assert scene.touching(state) == ()
    joints = pandas.arms["left"].chain.random(rng, 50)
    hands = pandas.arms["left"].chain.forward(joints) @ pandas.arms["left"].flange_from_hand(0.04)
    solutions = pandas.arms["left"].solve_ik(hands, 0.04)
    assert solutions.solved.mean() >= 0.96
    for q, target in zip(solutions.q, solutions.target, strict=True):
        whole = pandas.home.copy()
        whole[pandas.arms["left"].indices] = q
        distance, angle = pose_distance(pandas.hand_pose("left", whole, 0.04), hands[target])
        assert distance < 1e-6
        assert angle < 1e-6


def test_pairs_that_need_no_check_are_sampled_where_the_srdf_has_none(pandas):
    assert frozenset(("left_panda_link1", "left_panda_link2")) in pandas.disabled
    across = [pair for pair in pandas.disabled if len({name.split("_")[0] for name in pair}) > 1]
    assert not [pair for pair in across if any("link7" in name for name in pair)]


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_robots_stand_free_at_home_with_hands(name):
    robot = load_robot(name, dict.fromkeys(("left", "right"), SHIPPED[name]))
    scene = Scene.of(robot, [])
    assert scene.touching(scene.state({})) == ()
    np.testing.assert_array_equal(robot.checked_configuration(robot.home), robot.home)


def test_nextage_limits_are_mirrored_and_speeds_real():
    robot = load_robot("nextage")
    left, right = (robot.joint_names.index(f"{side}ARM_JOINT3") for side in "LR")
    assert (robot.lower[left], robot.upper[left]) == pytest.approx((-robot.upper[right], -robot.lower[right]))
    assert robot.velocity[robot.joint_names.index("CHEST_JOINT0")] == pytest.approx(1.92, abs=0.01)
    assert robot.acceleration == pytest.approx(np.full(15, 5.0))


def test_the_base_moves_the_whole_robot():
    base = pose([1.0, -2.0, 0.5], [0.1, 0.2, 0.3])
    here, there = load_robot("nextage"), load_robot("nextage", base=base)
    np.testing.assert_allclose(there.flange("left", there.home), base @ here.flange("left", here.home), atol=1e-9)
    np.testing.assert_allclose(
        there.arms["left"].chain.forward(there.home[None, there.arms["left"].indices])[0],
        base @ here.flange("left", here.home),
        atol=1e-9,
    )
    fixed = [(a, b) for a, b in zip(here.links, there.links, strict=True) if a.joint == 0]
    assert fixed
    for a, b in fixed:
        np.testing.assert_allclose(b.placements, base @ a.placements, atol=1e-12)


def test_a_chest_turned_stays_so_and_carries_the_arms(rng):
    robot = load_robot("nextage", {"left": "robotiq_2f85"})
    home = robot.home.copy()
    home[robot.joint_names.index("CHEST_JOINT0")] = 0.4
    with pytest.raises(InputError, match="CHEST_JOINT0 belongs to no arm"):
        robot.checked_configuration(home)
    turned = robot.with_home(home)
    np.testing.assert_array_equal(turned.checked_configuration(home), home)
    arm = turned.arms["left"]
    np.testing.assert_allclose(arm.chain.forward(home[None, arm.indices])[0], turned.flange("left", home), atol=1e-9)
    assert np.abs(turned.flange("left", home) - robot.flange("left", robot.home)).max() > 0.05


def test_hand_pose_chains_flange_mount_and_opening():
    robot = load_robot("nextage", {"left": "robotiq_2f85"})
    hand = load_hand("robotiq_2f85")
    expected = robot.flange("left", robot.home) @ hand.base_from_hand([0.03])[0]
    np.testing.assert_allclose(robot.hand_pose("left", robot.home, 0.03), expected, atol=1e-12)
    with pytest.raises(InputError, match="no hand"):
        robot.hand_pose("right", robot.home)


@pytest.mark.parametrize("q", [np.zeros(3), np.full(15, 9.0), np.full(15, np.nan)])
def test_what_is_no_configuration_is_refused(q):
    with pytest.raises(InputError, match=r"15 numbers|outside its limits"):
        load_robot("nextage").checked_configuration(q)


def test_unknown_robots_and_arms_are_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="nextage"):
        load_robot("nextagee")
    with pytest.raises(UnknownNameError, match="left"):
        load_robot("nextage").arm("lef")


def edited(tmp_path: Path, suffix: str, old: str, new: str) -> dict[str, Path]:
    """The Nextage's files, one of them changed."""
    files = {}
    for kind, name in (("urdf", "nextage.urdf"), ("srdf", "nextage.srdf"), ("limits", "nextage_limits.yaml")):
        text = (FOLDER / name).read_text()
        if name.endswith(suffix):
            assert old in text
            text = text.replace(old, new)
        files[kind] = tmp_path / name
        files[kind].write_text(text)
    return files


@pytest.mark.parametrize(
    ("suffix", "old", "new", "message"),
    [
        (".urdf", "<robot", "<robo", "well-formed|<robot"),
        (".urdf", "</robot>", "", "well-formed"),
        (".urdf", "revolute", "floating", "floating"),
        (".urdf", 'parent link="', 'parent link="no_such_', "valid URDF"),
        (".urdf", "<geometry>", '<geometry><mesh filename="package://nowhere/none.stl"/></geometry><geometry>', "mesh"),
        (".srdf", "LARM_JOINT0", "LARM_JOIND0", "LARM_JOIND0"),
        (".srdf", 'tip_link="left_flange"', 'tip_link="left_flang"', "left_flang'"),
        (".srdf", 'link1="', 'link1="no_such_', "no_such_"),
        (".srdf", 'value="', 'value="x', "give a number"),
        (".srdf", 'value="', 'value="9', "outside its limits|number"),
        ("limits.yaml", "LARM_JOINT0", "LARM_JOIND0", "LARM_JOIND0"),
        ("limits.yaml", "max_acceleration: 5.0", "max_acceleration: -5.0", "no positive"),
        ("limits.yaml", "max_acceleration: 5.0", "max_acceleration: fast", "max_acceleration"),
        ("limits.yaml", "max_acceleration: 5.0", "min_position: .nan", "JOINT0: a limit is no number"),
        (".urdf", "<parent ", '<mimic joint="LARM_JOINT0" multiplier="x"/><parent ', "mimic: .*no finite number"),
        (".urdf", "<parent ", '<origin xyz="1e308 0 0"/><parent ', "a joint has a number"),
    ],
)
def test_what_is_wrong_in_a_robots_files_is_named(tmp_path, suffix, old, new, message):
    files = edited(tmp_path, suffix, old, new)
    with pytest.raises(InputError, match=message):
        Robot.load(files["urdf"], files["srdf"], files["limits"])


def test_a_chain_too_long_for_the_parser_is_refused(tmp_path):
    links = "".join(f'<link name="l{i}"/>' for i in range(6000))
    joint = '<joint name="j{1}" type="fixed"><parent link="l{0}"/><child link="l{1}"/></joint>'
    joints = "".join(joint.format(i - 1, i) for i in range(1, 6000))
    (tmp_path / "long.urdf").write_text(f'<robot name="r">{links}{joints}</robot>')
    with pytest.raises(InputError, match="6000 link elements, and 500 are the most"):
        Robot.load(tmp_path / "long.urdf", tmp_path / "long.urdf")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.urdf.*does not exist"):
        Robot.load(tmp_path / "none.urdf", tmp_path / "none.srdf")


def test_entities_that_could_blow_up_are_refused(tmp_path):
    path = tmp_path / "bomb.urdf"
    path.write_text('<!DOCTYPE r [<!ENTITY a "aaaa">]><robot name="r"><link name="&a;"/></robot>')
    with pytest.raises(InputError, match="entities"):
        Robot.load(path, path)


def test_a_continuous_joint_gets_one_turn(tmp_path):
    files = edited(tmp_path, ".urdf", 'name="LARM_JOINT5" type="revolute"', 'name="LARM_JOINT5" type="continuous"')
    robot = Robot.load(files["urdf"], files["srdf"], files["limits"])
    i = robot.joint_names.index("LARM_JOINT5")
    assert (robot.lower[i], robot.upper[i]) == pytest.approx((-np.pi, np.pi))


def test_kinematics_of_the_whole_robot_agree_with_pinocchio(rng):
    robot = load_robot("hrp5p")
    data = robot.model.createData()
    for _ in range(20):
        q = rng.uniform(robot.lower, robot.upper)
        pin.framesForwardKinematics(robot.model, data, q)
        for name, arm in robot.arms.items():
            expected = data.oMf[robot.model.getFrameId(f"{name}_flange")].homogeneous
            np.testing.assert_allclose(robot.flange(name, q), expected, atol=1e-12)
            np.testing.assert_allclose(arm.chain.forward(q[None, arm.indices])[0], expected, atol=1e-10)


BOX = '<collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision>'
CHAIN_SRDF = '<robot name="r"><group name="arm"><chain base_link="l0" tip_link="l3"/></group>{}</robot>'


def own(tmp_path: Path, shape: str = BOX, srdf: str = CHAIN_SRDF.format(""), limits: str | None = None, **options):
    """A robot of three joints about z and x."""
    links = "".join(f'<link name="l{i}">{shape}</link>' for i in range(4))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/><origin xyz="0.1 0 0"/>'
        f'<axis xyz="{axis}"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i, axis in enumerate(("0 0 1", "1 0 0", "0 0 1"))
    )
    files = {"r.urdf": f'<robot name="r">{links}{joints}</robot>', "r.srdf": srdf, "limits.yaml": limits or ""}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    return Robot.load(tmp_path / "r.urdf", tmp_path / "r.srdf", tmp_path / "limits.yaml" if limits else None, **options)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"0.05 0.05 0.05"', '"0.05 0.05"', "0 of 4 collision shapes"),
        ("<collision>", '<collision><origin xyz="a 0 0"/>', "0 of 4 collision shapes"),
        ('<box size="0.05 0.05 0.05"/>', "", "0 of 4 collision shapes"),
        (BOX, "", "no link has a collision shape"),
        ('"0.05 0.05 0.05"', '"0.05 -0.05 0.05"', "link l0: box.*above 0"),
        ('"0.05 0.05 0.05"', '"nan 0.05 0.05"', "link l0: box.*above 0"),
        ('box size="0.05 0.05 0.05"', 'cylinder radius="0" length="0.1"', "link l0: cylinder.*above 0"),
        (
            'box size="0.05 0.05 0.05"',
            'mesh filename="part.stl" scale="0 0 0"',
            "link l0: its collision mesh has no size",
        ),
        ('box size="0.05 0.05 0.05"', 'mesh filename="nan.stl"', "link l0: its collision mesh.*within 1000 m"),
        ('"0.05 0.05 0.05"', '"1e308 1e308 1e308"', "link l0: box.*below 1000 m"),
        ("<collision>", '<collision><origin xyz="1e308 0 0"/>', "origin of a collision shape"),
        (BOX, BOX * 600, "2400 link/collision elements"),
    ],
)
def test_no_collision_shape_is_left_out_in_silence(tmp_path, old, new, message):
    stl = trimesh.creation.box([0.05] * 3).export(file_type="stl")
    (tmp_path / "part.stl").write_bytes(stl)
    (tmp_path / "nan.stl").write_bytes(stl[:96] + np.float32(np.nan).tobytes() + stl[100:])
    with pytest.raises(InputError, match=message):
        own(tmp_path, BOX.replace(old, new))


def test_a_mesh_used_at_two_scales_has_two_sizes(tmp_path):
    (tmp_path / "part.stl").write_bytes(trimesh.creation.box([0.02] * 3).export(file_type="stl"))
    pair = "".join(
        f'<collision><geometry><mesh filename="part.stl" scale="{s} {s} {s}"/></geometry></collision>' for s in (1, 2)
    )
    sizes = [shape.mesh.extents for shape in own(tmp_path, pair).links[0].shapes]
    np.testing.assert_allclose(sizes, [[0.02] * 3, [0.04] * 3], atol=1e-6)


def test_pairs_that_need_no_check_are_the_same_wherever_the_base_stands(tmp_path):
    bare = re.sub("<disable_collisions[^>]*/>", "", (FOLDER / "nextage.srdf").read_text())
    (tmp_path / "nextage.srdf").write_text(bare)
    files = (FOLDER / "nextage.urdf", tmp_path / "nextage.srdf", FOLDER / "nextage_limits.yaml")
    here, there = Robot.load(*files), Robot.load(*files, base=pose([3.0, 0.0, 0.5], [0.0, 0.0, 1.0]))
    assert here.disabled == there.disabled


def test_limits_files_narrow_positions_and_set_velocities(tmp_path):
    text = "joint_limits:\n  j1: {has_position_limits: true, min_position: -0.5, max_position: 2.0}\n"
    robot = own(tmp_path, limits=text + "  j2: {has_velocity_limits: true, max_velocity: 0.25}\n")
    np.testing.assert_array_equal(robot.lower, [-1.0, -0.5, -1.0])
    np.testing.assert_array_equal(robot.upper, [1.0, 1.0, 1.0])
    np.testing.assert_array_equal(robot.velocity, [1.0, 1.0, 0.25])
    np.testing.assert_array_equal(robot.arms["arm"].chain.lower, robot.lower)
    with pytest.raises(InputError, match="j1 has no position"):
        own(tmp_path, limits=text.replace("-0.5", "1.5"))
    with pytest.raises(InputError, match="no valid YAML"):
        own(tmp_path, limits="joint_limits: 2020-13-45")


@pytest.mark.parametrize("value", ["nan", "3"])
def test_a_home_that_is_no_configuration_is_refused(tmp_path, value):
    state = f'<group_state name="home" group="arm"><joint name="j1" value="{value}"/></group_state>'
    with pytest.raises(InputError, match="j1 is outside its limits"):
        own(tmp_path, srdf=CHAIN_SRDF.format(state))


def test_a_robot_comes_in_with_the_srdf_that_ships_with_it(caplog):
    folder = robot_data() / "panda_description"
    files = folder / "urdf/panda.urdf", folder / "srdf/panda.srdf"
    panda = Robot.load(*files, home="default")
    assert panda.home[panda.joint_names.index("panda_joint4")] == -2.35619
    # The group lists joints 1 to 7: its flange is what joint 7 carries, not something farther out.
    assert panda.arms["arm"].flange == "panda_link7"
    scene = Scene.of(panda, [])
    assert scene.touching(scene.state({})) == ()
    with pytest.raises(UnknownNameError, match="default"):
        Robot.load(*files, home="ready")
    caplog.clear()
    Robot.load(*files)
    assert "no state 'home' (it has ['default'])" in caplog.text


def test_a_hand_stands_where_it_is_mounted():
    mount = pose([0.01, 0.02, 0.03], [0.4, 0.5, 0.6])
    robot = load_robot("nextage").with_hand("left", load_hand("robotiq_2f85"), mount)
    expected = robot.flange("left", robot.home) @ mount @ load_hand("robotiq_2f85").base_from_hand(0.04)[0]
    np.testing.assert_allclose(robot.hand_pose("left", robot.home, 0.04), expected, atol=1e-12)
    answers = robot.arms["left"].solve_ik(expected, 0.04).q
    for q in robot.with_joints(robot.home, "left", answers):
        np.testing.assert_allclose(robot.hand_pose("left", q, 0.04), expected, atol=2e-6)
    assert len(answers)


@pytest.mark.parametrize("arms", [[], "left", ["left", "left"], ["lef"]])
def test_arms_are_a_list_of_different_ones(arms):
    with pytest.raises(InputError, match="arm"):
        load_robot("nextage").indices(arms)


@pytest.mark.parametrize("wrong", [np.zeros((2, 4, 4)), np.zeros((4, 4)), "here", [1, 2, 3]])
def test_a_base_or_a_mount_that_is_not_one_pose_is_refused(wrong):
    with pytest.raises(InputError, match="base"):
        load_robot("nextage", base=wrong)
    with pytest.raises(InputError, match="flange_from_base"):
        load_robot("nextage").with_hand("left", load_hand("robotiq_2f85"), wrong)


def test_numbers_of_the_wrong_shape_are_refused():
    robot = load_robot("nextage", {"left": "robotiq_2f85"})
    with pytest.raises(InputError, match="joints of left"):
        robot.with_joints(robot.home, "left", np.zeros((2, 3)))
    with pytest.raises(InputError, match="15 numbers"):
        robot.hand_pose("left", np.zeros(3), 0.04)
    with pytest.raises(InputError, match="2 openings for 3 targets"):
        robot.arms["left"].solve_ik(np.tile(np.eye(4), (3, 1, 1)), [0.01, 0.02])
