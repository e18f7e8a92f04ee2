"""Robots from URDF and SRDF: the shipped ones, one of a user's own, and what wrong files get."""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

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
    ],
)
def test_what_is_wrong_in_a_robots_files_is_named(tmp_path, suffix, old, new, message):
    files = edited(tmp_path, suffix, old, new)
    with pytest.raises(InputError, match=message):
        Robot.load(files["urdf"], files["srdf"], files["limits"])


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
