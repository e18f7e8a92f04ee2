"""The shipped models against their published figures, by pinocchio and coal alone."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin
import pytest
import trimesh
import yaml

import kumitate.robots.library
from kumitate.robots.library import make_models

LIBRARY = Path(kumitate.robots.library.__file__).parent
SHARE = str(make_models.SHARE)
ROBOTS = {"nextage": "robotiq_2f85", "ur3_dual": "robotiq_2f85", "hrp5p": "hrp5p_three_finger"}
HANDS = ("robotiq_2f85", "hrp5p_three_finger", "suction_cup")
MIRROR = np.diag([1.0, -1.0, 1.0])


@dataclass
class Loaded:
    model: pin.Model
    geometry: pin.GeometryModel
    data: pin.Data

    def index(self, joint: str) -> int:
        return int(self.model.joints[self.model.getJointId(joint)].idx_q)

    def frame(self, q: np.ndarray, link: str) -> pin.SE3:
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.model.getFrameId(link)].copy()


def load(name: str) -> Loaded:
    path = str(LIBRARY / f"{name}.urdf")
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(model, path, pin.COLLISION, package_dirs=[SHARE])
    return Loaded(model, geometry, model.createData())


@pytest.fixture(scope="module")
def robots() -> dict[str, Loaded]:
    return {name: load(name) for name in ROBOTS}


@pytest.fixture(scope="module")
def hands() -> dict[str, Loaded]:
    return {name: load(name) for name in HANDS}


def home_of(name: str, robot: Loaded) -> np.ndarray:
    pin.loadReferenceConfigurations(robot.model, str(LIBRARY / f"{name}.srdf"), False)
    return np.array(robot.model.referenceConfigurations["home"])


def description(hand: str) -> dict:
    return yaml.safe_load((LIBRARY / f"{hand}.yaml").read_text())


def hand_configuration(hand: str, loaded: Loaded, driver: float) -> np.ndarray:
    """Joint positions of a hand with its mimics, read from the XML, at a position of the driving joint."""
    q = np.zeros(loaded.model.nq)
    root = ElementTree.fromstring((LIBRARY / f"{hand}.urdf").read_bytes())
    for joint in root.iter("joint"):
        if joint.get("type") == "revolute":
            mimic = joint.find("mimic")
            factor = 1.0 if mimic is None else float(mimic.get("multiplier"))
            q[loaded.index(joint.get("name"))] = factor * driver
    return q


# ------------------------------------------------------------------------------------------------------------- files


def test_hand_and_robot_files_are_those_the_generator_writes():
    for name, text in (make_models.hand_files() | make_models.robot_files()).items():
        assert (LIBRARY / name).read_text() == text, f"{name} is stale: run python -m {make_models.__name__}"


@pytest.mark.parametrize("make", make_models.ROBOTS, ids=lambda make: make.__name__)
def test_srdf_files_are_those_the_generator_writes(make):
    model = make()
    assert (LIBRARY / f"{model.robot.name}.srdf").read_text() == make_models.srdf_text(model)


def test_every_robot_has_arms_limits_and_shapes(robots):
    for name, robot in robots.items():
        assert len(robot.geometry.geometryObjects) > 10
        assert robot.model.existFrame("left_flange")
        assert robot.model.existFrame("right_flange")
        limits = yaml.safe_load((LIBRARY / f"{name}_limits.yaml").read_text())["joint_limits"]
        assert list(limits) == [joint.name for joint in _moving(name)]
        for joint, entry in limits.items():
            assert entry["has_velocity_limits"]
            assert entry["has_acceleration_limits"]
            assert entry["max_acceleration"] > 0
            assert robot.model.velocityLimit[robot.index(joint)] == pytest.approx(entry["max_velocity"])


def _moving(name: str) -> list:
    make = next(make for make in make_models.ROBOTS if make().robot.name == name)
    return [joint for joint in make().robot.joints if joint.axis is not None]


# ------------------------------------------------------------------------------------------------------------- robots


@pytest.mark.parametrize(
    ("left_arm", "expected"),
    [
        (np.radians([15, 0, -143, 0, 0, 0]), (0.3765, 0.2971, 0.1681)),
        ([0.010472, 0, -1.745329, -0.26529, 0.164061, -0.055851], (0.3259, 0.1823, -0.1304)),
    ],
)
def test_nextage_reaches_the_published_tool_points(robots, left_arm, expected):
    robot = robots["nextage"]
    q = np.zeros(robot.model.nq)
    for i, (angle, sign) in enumerate(zip(left_arm, (-1, 1, 1, -1, 1, -1), strict=True)):
        q[robot.index(f"LARM_JOINT{i}")] = angle
        q[robot.index(f"RARM_JOINT{i}")] = sign * angle
    for side, sign in (("left", 1), ("right", -1)):
        flange = robot.frame(q, f"{side}_flange")
        point = flange.act(np.array([0, 0, 0.145]))
        np.testing.assert_allclose(point, np.multiply(expected, (1, sign, 1)), atol=6e-5)


def test_hrp5p_reaches_the_published_tool_point_at_home(robots):
    robot = robots["hrp5p"]
    q = home_of("hrp5p", robot)
    for side, sign in (("left", 1), ("right", -1)):
        point = robot.frame(q, f"{side}_flange").act(np.array([0, 0, 0.1727]))
        np.testing.assert_allclose(point, (0.4443, sign * 0.3288, 0.4481), atol=6e-5)


@pytest.mark.parametrize(
    ("side", "base"), [("left", (0.258485, np.pi)), ("right", (-0.258485, 0.0))], ids=["left", "right"]
)
def test_ur3_arms_move_as_the_makers(robots, rng, side, base):
    robot = robots["ur3_dual"]
    reference = pin.buildModelFromUrdf(f"{SHARE}/example-robot-data/robots/ur_description/urdf/ur3_robot.urdf")
    data = reference.createData()
    mount = pin.SE3(pin.rpy.rpyToMatrix(0.75 * np.pi, 0, base[1]), np.array([0, base[0], 1.610515]))
    for _ in range(20):
        arm = rng.uniform(-np.pi, np.pi, 6)
        q = np.zeros(robot.model.nq)
        for name, angle in zip(reference.names[1:], arm, strict=True):
            q[robot.index(f"{side}_{name}")] = angle
        pin.framesForwardKinematics(reference, data, arm)
        tool = mount * data.oMf[reference.getFrameId("tool0")]
        np.testing.assert_allclose(robot.frame(q, f"{side}_tool0").homogeneous, tool.homogeneous, atol=1e-8)
        offset = robot.frame(q, f"{side}_tool0").actInv(robot.frame(q, f"{side}_flange"))
        np.testing.assert_allclose(offset.translation, (0, 0, 0.0484), atol=1e-12)


@pytest.mark.parametrize(("name", "left", "right"), [("nextage", "LARM", "RARM"), ("hrp5p", "left_", "right_")])
def test_mirrored_arms_mirror_limits_and_poses(robots, rng, name, left, right):
    robot = robots[name]
    model = robot.model
    pairs = [(n, right + n.removeprefix(left)) for n in model.names if n.startswith(left)]
    assert len(pairs) in (6, 9)
    for _ in range(20):
        q = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        if name == "nextage":
            q[robot.index("CHEST_JOINT0")] = 0.0
        for a, b in pairs:
            about_y = model.joints[model.getJointId(a)].shortname() == "JointModelRY"
            low, high = model.lowerPositionLimit[robot.index(a)], model.upperPositionLimit[robot.index(a)]
            expected = (low, high) if about_y else (-high, -low)
            found = (model.lowerPositionLimit[robot.index(b)], model.upperPositionLimit[robot.index(b)])
            np.testing.assert_allclose(found, expected)
            q[robot.index(b)] = q[robot.index(a)] if about_y else -q[robot.index(a)]
        _assert_mirrored(robot, q)


def _assert_mirrored(robot: Loaded, q: np.ndarray) -> None:
    left, right = robot.frame(q, "left_flange"), robot.frame(q, "right_flange")
    np.testing.assert_allclose(MIRROR @ left.translation, right.translation, atol=1e-7)
    np.testing.assert_allclose(MIRROR @ left.rotation @ MIRROR, right.rotation, atol=1e-7)


@pytest.mark.parametrize("name", ROBOTS)
def test_home_is_symmetric_within_limits_and_free_with_hands(robots, hands, name):
    robot, hand = robots[name], hands[ROBOTS[name]]
    q = home_of(name, robot)
    margin = np.minimum(q - robot.model.lowerPositionLimit, robot.model.upperPositionLimit - q)
    assert margin.min() > 0.2
    _assert_mirrored(robot, q)

    geometry = pin.GeometryModel(robot.geometry)
    geometry.addAllCollisionPairs()
    pin.removeCollisionPairs(robot.model, geometry, str(LIBRARY / f"{name}.srdf"))
    assert len(geometry.collisionPairs) > 100
    assert not pin.computeCollisions(robot.model, robot.data, geometry, pin.GeometryData(geometry), q, False)

    bodies = _placed(robot, q, pin.SE3.Identity())
    driver = description(ROBOTS[name])["driver"]
    opened = hand_configuration(ROBOTS[name], hand, driver["open"])
    wrist = {
        side: robot.model.frames[robot.model.getFrameId(f"{side}_flange")].parentJoint for side in ("left", "right")
    }
    placed = {side: _placed(hand, opened, robot.frame(q, f"{side}_flange")) for side in wrist}
    for side, pieces in placed.items():
        others = [body for body in bodies if body[0] != wrist[side]] + placed["right" if side == "left" else "left"]
        gap = min(_distance(piece, other) for piece in pieces for other in others)
        assert gap > 0.01


def _placed(loaded: Loaded, q: np.ndarray, base: pin.SE3) -> list[tuple[int, object, pin.SE3]]:
    data = loaded.geometry.createData()
    pin.updateGeometryPlacements(loaded.model, loaded.data, loaded.geometry, data, q)
    objects = loaded.geometry.geometryObjects
    return [(int(o.parentJoint), o.geometry, base * data.oMg[i]) for i, o in enumerate(objects)]


def _distance(a: tuple[int, object, pin.SE3], b: tuple[int, object, pin.SE3]) -> float:
    """A lower bound where it is large: between the boxes that hold both; else the true distance."""
    places = [coal.Transform3s(p[2].rotation, p[2].translation) for p in (a, b)]
    for part in (a, b):
        part[1].computeLocalAABB()
    centres = [p[2].act(np.array(p[1].aabb_center)) for p in (a, b)]
    bound = np.linalg.norm(centres[0] - centres[1]) - a[1].aabb_radius - b[1].aabb_radius
    if bound > 0.05:
        return float(bound)
    return coal.distance(a[1], places[0], b[1], places[1], coal.DistanceRequest(), coal.DistanceResult())


# -------------------------------------------------------------------------------------------------------------- hands


@pytest.mark.parametrize(
    ("gap", "tip", "centre"),
    [(85, 149.0, 135.0), (60, 157.3, 143.3), (40, 161.0, 147.0), (20, 162.8, 148.8), (0, 162.9, 148.9)],
)
def test_2f85_advances_as_published(hands, gap, tip, centre):
    hand = hands["robotiq_2f85"]
    angle = np.arccos((gap / 2 - 4.9) / np.hypot(37.6, 43.04)) - np.arctan2(43.04, 37.6)
    spec = description("robotiq_2f85")
    assert spec["driver"]["open"] - 1e-9 <= angle <= spec["driver"]["closed"] + 1e-6
    q = hand_configuration("robotiq_2f85", hand, angle)
    left, right = hand.frame(q, "left_pad"), hand.frame(q, "right_pad")
    half = spec["pads"][0]["size"][1] / 2
    assert 1e3 * (right.translation[0] - left.translation[0]) == pytest.approx(gap, abs=0.1)
    assert 1e3 * (left.translation[2] + half) == pytest.approx(tip, abs=0.1)
    assert 1e3 * (left.translation[2] + half - spec["contact_depth"]) == pytest.approx(centre, abs=0.1)


def test_2f85_linkage_closes_and_keeps_the_pads_parallel(hands):
    hand = hands["robotiq_2f85"]
    coupling = {"left": [], "right": []}
    for angle in np.linspace(0.0, description("robotiq_2f85")["driver"]["closed"], 25):
        q = hand_configuration("robotiq_2f85", hand, angle)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            np.testing.assert_allclose(hand.frame(q, f"{side}_pad").rotation, np.diag([sign, sign, 1]), atol=1e-9)
            c = hand.frame(q, f"{side}_outer_finger").act(np.array([-sign * 0.0376, 0, 0.04304]))
            d = hand.frame(q, f"{side}_inner_finger").translation
            coupling[side].append(np.linalg.norm(c - d))
    for lengths in coupling.values():
        np.testing.assert_allclose(lengths, 0.01905, atol=2e-6)


def test_three_finger_hand_opens_as_published(hands):
    hand, spec = hands["hrp5p_three_finger"], description("hrp5p_three_finger")
    above = spec["pads"][0]["size"][1] / 2 - spec["contact_depth"]
    for angle in np.linspace(0.0, spec["driver"]["closed"], 30):
        q = hand_configuration("hrp5p_three_finger", hand, angle)
        points = [hand.frame(q, pad["link"]).act(np.array([0, 0, above])) for pad in spec["pads"]]
        opening = np.mean([p[0] for p in points[1:]]) - points[0][0]
        published = 0.082 - 0.149 * np.sin(angle)
        assert opening == pytest.approx(published, abs=1.5e-3)
        np.testing.assert_allclose([p[1] for p in points], (0, 0.030, -0.030), atol=1e-12)
        if angle == 0.0:
            assert opening == pytest.approx(spec["stroke"][1])
            assert points[0][2] == pytest.approx(0.1727)
    assert opening == pytest.approx(spec["stroke"][0], abs=1e-8)


@pytest.mark.parametrize("name", ["robotiq_2f85", "hrp5p_three_finger"])
def test_nothing_of_a_finger_stands_before_its_pad_or_above_its_tip(hands, name):
    hand, spec = hands[name], description(name)
    model = hand.model
    for angle in np.linspace(spec["driver"]["open"], spec["driver"]["closed"], 7):
        q = hand_configuration(name, hand, angle)
        data = hand.geometry.createData()
        pin.updateGeometryPlacements(model, hand.data, hand.geometry, data, q)
        for pad in spec["pads"]:
            frame = hand.frame(q, pad["link"])
            finger = pad["link"].removesuffix("_pad")
            seen = 0
            for i, item in enumerate(hand.geometry.geometryObjects):
                link = model.frames[item.parentFrame].name
                if not link.startswith(finger):
                    continue
                points = trimesh.transform_points(_surface(item.geometry), (frame.inverse() * data.oMg[i]).homogeneous)
                beside = np.abs(points[:, 2]) < pad["size"][1] / 2 - 1e-6
                assert points[:, 2].max() <= pad["size"][1] / 2 + 1e-9
                assert (points[beside, 0] <= 1e-9).all()
                seen += int(beside.any())
            assert seen > 0


def _surface(shape: object) -> np.ndarray:
    if isinstance(shape, coal.Box):
        mesh = trimesh.creation.box(2 * np.array(shape.halfSide))
    else:
        mesh = trimesh.creation.cylinder(shape.radius, 2 * shape.halfLength, sections=48)
    return np.asarray(mesh.subdivide_to_size(0.004).vertices)


def test_suction_cup_ends_at_its_lip(hands):
    hand, spec = hands["suction_cup"], description("suction_cup")
    q = np.zeros(hand.model.nq)
    lip = hand.frame(q, spec["lip"]["link"])
    np.testing.assert_allclose(lip.rotation, np.eye(3))
    data = hand.geometry.createData()
    pin.updateGeometryPlacements(hand.model, hand.data, hand.geometry, data, q)
    tops = []
    for i, item in enumerate(hand.geometry.geometryObjects):
        points = trimesh.transform_points(_surface(item.geometry), data.oMg[i].homogeneous)
        tops.append((points[:, 2].max(), np.linalg.norm(points[:, :2], axis=1).max()))
    height, radius = max(tops)
    assert height == pytest.approx(lip.translation[2])
    assert radius == pytest.approx(spec["lip"]["radius"])
