"""A chain's kinematics against pinocchio's, on arms with every kind of joint and placement."""

from __future__ import annotations

import sysconfig
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots import library
from kumitate.robots.chain import Chain

LIBRARY = Path(library.__file__).parent
EXAMPLES = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots")
ARMS = {
    "ur3": (LIBRARY / "ur3_dual.urdf", "right_", "right_flange"),
    "nextage": (LIBRARY / "nextage.urdf", "LARM_", "left_flange"),
    "hrp5p": (LIBRARY / "hrp5p.urdf", "left_", "left_flange"),
    "panda": (EXAMPLES / "panda_description/urdf/panda.urdf", "panda_joint", "panda_hand_tcp"),
}


def sliding_model() -> pin.Model:
    """Revolute and prismatic joints by turns, with tilted axes and placements."""
    rng = np.random.default_rng(7)
    model, parent = pin.Model(), 0
    for i in range(5):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        kind = pin.JointModelPrismaticUnaligned if i % 2 else pin.JointModelRevoluteUnaligned
        parent = model.addJoint(parent, kind(axis), pin.SE3.Random(), f"joint{i}")
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -1.0, 2.0
    model.addFrame(pin.Frame("tip", parent, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    return model


def arm(name: str, q_fixed: str = "random") -> tuple[pin.Model, Chain, str, np.ndarray]:
    """Model, chain, tip frame and the configuration that the rest of the model is held at."""
    if name == "sliding":
        model, tip = sliding_model(), "tip"
        joints = list(model.names)[1:]
    else:
        path, prefix, tip = ARMS[name]
        model = pin.buildModelFromUrdf(str(path))
        joints = [joint for joint in model.names if joint.startswith(prefix)]
    held = np.random.default_rng(3).uniform(model.lowerPositionLimit, model.upperPositionLimit)
    return model, Chain.from_model(model, joints, tip, held), tip, held


@pytest.mark.parametrize("name", [*ARMS, "sliding"])
def test_kinematics_agree_with_pinocchio(name: str, rng: np.random.Generator) -> None:
    model, chain, tip, held = arm(name)
    data = model.createData()
    joints = [model.getJointId(joint) for joint in chain.names]
    positions = [model.joints[joint].idx_q for joint in joints]
    columns = [model.joints[joint].idx_v for joint in joints]
    q = chain.random(rng, 40)
    world_from_tip, jacobian, poses = chain.forward(q), chain.jacobian(q), chain.joint_poses(q)
    for i, configuration in enumerate(q):
        whole = held.copy()
        whole[positions] = configuration
        pin.computeJointJacobians(model, data, whole)
        pin.updateFramePlacements(model, data)
        frame = model.getFrameId(tip)
        expected = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:, columns]
        np.testing.assert_allclose(world_from_tip[i], data.oMf[frame].homogeneous, atol=1e-10)
        np.testing.assert_allclose(jacobian[i], expected, atol=1e-10)
        np.testing.assert_allclose(poses[i], [data.oMi[joint].homogeneous for joint in joints], atol=1e-10)


def test_limits_are_those_of_the_model() -> None:
    model, chain, _, _ = arm("nextage")
    index = model.joints[model.getJointId("LARM_JOINT3")].idx_q
    assert chain.lower[3] == model.lowerPositionLimit[index]
    assert chain.upper[3] == model.upperPositionLimit[index]
    assert chain.within_limits(np.stack([chain.lower, chain.upper, chain.upper + 1e-6])).tolist() == [True, True, False]


def test_wrapping_adds_whole_turns_and_ends_as_near_the_limits_as_they_allow(rng: np.random.Generator) -> None:
    _, chain, _, _ = arm("nextage")
    q = rng.uniform(-12.0, 12.0, (500, chain.dof))
    wrapped = chain.wrapped(q)
    turns = (wrapped - q) / (2.0 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)

    def excess(values: np.ndarray) -> np.ndarray:
        return np.maximum(np.maximum(chain.lower - values, values - chain.upper), 0.0)

    for turn in range(-4, 5):
        assert (excess(wrapped) <= excess(q + turn * 2.0 * np.pi) + 1e-12).all()


def test_wrapping_leaves_sliding_joints_alone(rng: np.random.Generator) -> None:
    _, chain, _, _ = arm("sliding")
    q = rng.uniform(-9.0, 9.0, (50, chain.dof))
    assert (chain.wrapped(q)[:, chain.prismatic] == q[:, chain.prismatic]).all()


def test_names_that_do_not_exist_are_refused_with_those_that_do() -> None:
    model, chain, tip, _ = arm("panda")
    with pytest.raises(UnknownNameError, match="panda_joint1"):
        Chain.from_model(model, ["elbow"], tip)
    with pytest.raises(UnknownNameError, match="panda_hand"):
        Chain.from_model(model, chain.names, "nose")


def test_joints_out_of_order_or_off_the_way_are_refused() -> None:
    model, chain, tip, _ = arm("panda")
    with pytest.raises(InputError, match="in a row"):
        Chain.from_model(model, chain.names[::-1], tip)
    with pytest.raises(InputError, match="in a row"):
        Chain.from_model(model, [*chain.names, "panda_finger_joint1"], "panda_hand")


def test_joints_without_a_finite_range_are_refused() -> None:
    model, chain, tip, held = arm("sliding")
    with pytest.raises(InputError, match="joint2"):
        replace(chain, upper=np.array([1.0, 1.0, np.inf, 1.0, 1.0]))
    endless = pin.Model()
    endless.addJoint(0, pin.JointModelRUBZ(), pin.SE3.Identity(), "wheel")
    endless.addFrame(pin.Frame("tip", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(InputError, match="wheel"):
        Chain.from_model(endless, ["wheel"], "tip")
    with pytest.raises(InputError, match="coordinates"):
        Chain.from_model(model, chain.names, tip, held[:-1])
