"""By how much closing forces pass each other, on parts where geometry tells."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kumitate.grasping.couple import force_offsets
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand
from kumitate.transforms import compose, rotation_about


def box(sides, at) -> trimesh.Trimesh:
    return trimesh.creation.box(sides, trimesh.transformations.translation_matrix(at))


def offsets(mesh: trimesh.Trimesh, hand, opening: float, poses=None) -> np.ndarray:
    """Of hands that close on a part along x, at its origin unless poses are given."""
    poses = np.eye(4)[None] if poses is None else poses
    n = len(poses)
    return force_offsets(Part.from_mesh(mesh, mass=0.1), hand, poses, np.full(n, opening), 2 * np.arange(n))


def bosses(y: float, z: float) -> trimesh.Trimesh:
    """A plate across the hand with a boss 4 mm wide on either side, at (y, z) and at (-y, -z); 20 mm over both."""
    one, other = ([sign * 0.0075, sign * y, sign * z] for sign in (-1.0, 1.0))
    return trimesh.boolean.union(
        [box([0.012, 0.06, 0.06], [0, 0, 0]), *(box([0.005, 0.004, 0.004], at) for at in (one, other))]
    )


def test_pads_that_lie_flat_have_no_couple(gripper):
    assert np.allclose(offsets(box([0.03, 0.05, 0.05], [0, 0, 0]), gripper, 0.03), 0.0, atol=1e-9)


@pytest.mark.parametrize(("y", "z"), [(0.007, 0.0), (0.0, 0.009), (-0.006, 0.0)])
def test_bosses_across_from_each_other_are_as_far_apart_as_their_edges(gripper, y, z):
    apart = 2.0 * max(abs(y), abs(z)) - 0.004
    assert np.allclose(offsets(bosses(y, z), gripper, 0.02), apart, rtol=0.02)


def test_turned_with_the_part_they_stay(gripper):
    mesh, turn = bosses(0.007, 0.0), compose(rotation_about([0.6, 0.0, 0.8], 1.1), [0.1, 0.2, 0.3])
    found = offsets(mesh.copy().apply_transform(turn), gripper, 0.02, turn[None])
    assert np.allclose(found, offsets(mesh, gripper, 0.02), rtol=1e-4)


def test_forces_of_edges_on_a_slope_point_along_its_normal(gripper):
    """Both pads touch a ball with an edge, h off its middle: the forces meet in it, and pass the other pad by 2 h."""
    radius, h = 0.04, 0.008
    ball = trimesh.creation.icosphere(subdivisions=6, radius=radius)
    pose = compose(np.eye(3), [0.0, h + gripper.pads[0].size[0] / 2.0, 0.0])
    found = offsets(ball, gripper, 2.0 * np.sqrt(radius**2 - h**2), pose[None])
    assert np.allclose(found, 2.0 * h, rtol=0.15)  # the ball has facets of 0.7 mm


def test_of_a_slope_on_one_side_the_force_passes_the_other_side(gripper):
    """The other side touches at 45 deg with its edge: its force leaves the single finger's flat face 30 mm behind."""
    assert gripper.pads[0].size[0] == 0.022  # it meets the slope at y = 11 mm, x = 15 mm
    width, corners = 0.03, [(-0.015, -0.015), (-0.011, -0.015), (0.034, 0.03), (-0.015, 0.03)]
    prism = trimesh.convex.convex_hull([[*corner, z] for corner in corners for z in (-0.03, 0.03)])
    found = offsets(prism, gripper, width)
    assert np.allclose(found, [[width, 0.0]], rtol=0.02, atol=1e-6)


def test_pads_that_lie_on_their_contacts_need_no_look(gripper):
    """Of planned grasps whose pads touch at both contacts the offset is no more than what a turn itself takes away."""
    mesh = trimesh.boolean.union([box([0.03, 0.05, 0.05], [0, 0, 0]), trimesh.creation.cylinder(0.012, 0.09)])
    part = Part.from_mesh(mesh, mass=0.1)
    grasps = plan_grasps(part, gripper)
    width = np.linalg.norm(np.diff(grasps.contacts, axis=1)[:, 0], axis=1)
    flush = np.flatnonzero(grasps.opening - width < 1e-6)
    assert 20 < len(flush) < len(grasps)
    found = force_offsets(part, gripper, grasps.part_from_hand[flush], grasps.opening[flush], 2 * np.arange(len(flush)))
    assert (found.max(axis=1) <= grasps.opening[flush] * np.radians(0.05) + 1e-6).all()


def test_of_three_fingers_one_that_hangs_presses_nothing():
    """The pair's pads begin 19 mm off the middle, the single one ends 11 mm off: 8 mm between the forces."""
    hand = load_hand("hrp5p_three_finger")
    single, other = (hand.hand_from_pad([0.03])[0, k, 1, 3] for k in (0, 1))
    half = hand.pads[0].size[0] / 2.0
    mesh = box([0.03, 0.12, 0.05], [0, 0, 0])
    mesh.vertices[(mesh.vertices[:, 0] > 0) & (np.sign(mesh.vertices[:, 1]) == -np.sign(other)), 0] -= 0.004
    flat = trimesh.boolean.union([mesh, box([0.015, 0.05, 0.05], [0.0075, np.sign(other) * 0.035, 0])])
    touching = abs(other) - half - (single + half)
    assert touching > 0.005
    assert np.allclose(offsets(flat, hand, 0.03)[:, 0], touching, rtol=0.05)


def test_grasps_whose_forces_pass_each_other_rank_below_flat_ones(gripper):
    """A bar with a boss on either side, across from each other: pads on both come after pads beside them."""
    bar = trimesh.boolean.union(
        [
            box([0.02, 0.12, 0.02], [0, 0, 0]),
            box([0.0012, 0.004, 0.02], [0.0105, 0.008, 0]),
            box([0.0012, 0.004, 0.02], [-0.0105, -0.008, 0]),
        ]
    )
    grasps = plan_grasps(Part.from_mesh(bar, mass=0.1), gripper)
    across = np.abs(grasps.part_from_hand[:, 0, 0]) > 0.999
    on_bosses = across & (np.abs(grasps.part_from_hand[:, 1, 3]) < 0.002) & (grasps.opening > 0.0211)
    flat = across & (np.abs(grasps.part_from_hand[:, 1, 3]) < 0.03) & (grasps.opening < 0.0201)
    assert on_bosses.any()
    assert flat.any()
    assert grasps.quality[on_bosses].max() < 0.5 * np.median(grasps.quality[flat])
