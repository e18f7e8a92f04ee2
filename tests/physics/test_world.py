"""The world of a trial: its hand moves and presses as the hand's file says, and a part on the table stays there."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh

from kumitate.grasping.part import Part
from kumitate.physics.trial import GRAVITY
from kumitate.physics.world import World, build_world
from kumitate.robots.hand import Hand
from kumitate.robots.library import load_hand

SIDES = (0.03, 0.1, 0.03)  # m: the pair of three fingers meets it too


@pytest.fixture(scope="module", params=["robotiq_2f85", "hrp5p_three_finger"])
def hand(request) -> Hand:
    return load_hand(request.param)


@pytest.fixture(scope="module")
def block() -> Part:
    return Part.from_mesh(trimesh.creation.box(SIDES), mass=0.1, name="block")


@pytest.fixture(scope="module")
def world(block, hand) -> World:
    return build_world(block, hand)


def fresh(world: World, at: np.ndarray) -> mujoco.MjData:
    """The part at a place (3,), the table far below."""
    data = mujoco.MjData(world.model)
    data.mocap_pos[0] = [0.0, 0.0, -10.0]
    data.qpos[world.free[0] : world.free[0] + 3] = at
    return data


def test_pieces_of_the_hand_are_where_the_hand_has_them(world, hand):
    data = fresh(world, np.array([5.0, 0.0, 0.0]))
    for opening in np.linspace(*hand.stroke, 4):
        data.qpos[world.joints : world.joints + len(hand.joint_names)] = hand.joint_positions([opening])[0]
        mujoco.mj_forward(world.model, data)
        poses = hand.base_from_piece([opening])[0]
        for piece, pose in zip(hand.pieces, poses, strict=True):
            name = hand.joint_names[piece.joint - 1] if piece.joint else "base"
            np.testing.assert_allclose(data.body(name).xpos, pose[:3, 3], atol=1e-6)
            np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), pose[:3, :3], atol=1e-6)


def test_the_part_weighs_what_it_weighs(world, block):
    data = fresh(world, np.array([5.0, 0.0, 0.0]))
    body = world.model.body("part")
    assert body.mass[0] == pytest.approx(block.mass)
    across = [sum(side**2 for side in SIDES) - side**2 for side in SIDES]
    np.testing.assert_allclose(np.sort(body.inertia), np.sort(block.mass * np.array(across) / 12.0), rtol=1e-6)
    world.model.opt.gravity = [0.0, 0.0, -GRAVITY]
    mujoco.mj_step(world.model, data, 100)
    assert data.qvel[world.free[1] + 2] == pytest.approx(-GRAVITY * data.time, rel=1e-3)


def test_fingers_press_with_the_grip_force_and_stay_coupled(world, hand):
    """A block between the pads, without gravity: force on each side, by MuJoCo's contacts, is the hand's."""
    world.model.opt.gravity = 0.0
    centre = hand.base_from_hand([SIDES[0]])[0]
    data = fresh(world, centre[:3, 3])
    mujoco.mju_mat2Quat(data.qpos[world.free[0] + 3 : world.free[0] + 7], np.ravel(centre[:3, :3]))
    fingers = slice(world.joints, world.joints + len(hand.joint_names))
    data.qpos[fingers] = hand.joint_positions([SIDES[0] + 2e-3])[0]
    before, after = hand.joint_positions([SIDES[0] - 1e-4, SIDES[0] + 1e-4])[:, hand.mechanism.leader]
    per_opening = (after - before) / 2e-4
    world.model.actuator_forcerange[0] = np.array([-1.0, 1.0]) * hand.grip_force / abs(per_opening)
    data.ctrl[0] = -2.0 * hand.speed * per_opening
    mujoco.mj_step(world.model, data, 400)
    sides = {body: np.zeros(3) for body in world.pads}
    force = np.zeros(6)
    for k in range(data.ncon):
        body = int(world.model.geom_bodyid[data.contact.geom[k]].min())
        mujoco.mj_contactForce(world.model, data, k, force)
        sides[body] += data.contact.frame[k].reshape(3, 3).T @ force[:3]
    closing = centre[:3, 0]
    single = abs(sides[world.pads[0]] @ closing)
    others = abs(sum(sides[body] for body in world.pads[1:]) @ closing)
    assert single == pytest.approx(hand.grip_force, rel=0.1)
    assert others == pytest.approx(hand.grip_force, rel=0.1)
    leader = data.qpos[world.joints + hand.mechanism.leader]
    coupled = hand.mechanism.joints(np.array([leader]))[0]
    np.testing.assert_allclose(data.qpos[fingers], coupled, atol=1e-3)
