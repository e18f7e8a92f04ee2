"""Grasps that face others: half a turn from them, at their contacts, the single fingers between the pairs."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
import trimesh

from kumitate.errors import InputError
from kumitate.grasping.interlock import faced, facing_grasps
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand
from kumitate.transforms import invert, transform_points

DEFAULTS = GraspParameters()
HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])  # about the hand's y, along which its pair stands


@pytest.fixture(scope="module")
def hand():
    return load_hand("hrp5p_three_finger")


@pytest.fixture(scope="module", params=["bar", "wedge"])
def part(request) -> Part:
    """A bar of 40 mm by 110 mm; or one whose side falls away by 2 mm, so that fingers of a pair stand off it."""
    mesh = trimesh.creation.box([0.04, 0.11, 0.05])
    if request.param == "wedge":
        mesh.vertices[(mesh.vertices[:, 0] > 0) & (mesh.vertices[:, 1] > 0), 0] -= 0.002
    return Part.from_mesh(mesh, mass=0.1, name=request.param)


@pytest.fixture(scope="module")
def giver(part, hand):
    return plan_grasps(part, hand)


@pytest.fixture(scope="module")
def taker(part, hand, giver):
    return facing_grasps(part, hand, giver, DEFAULTS)


def named(grasps, *, turned: bool = False) -> set[tuple[float, ...]]:
    """Each grasp by its contacts and its approach; or those of the grasp that would face it."""
    contacts, approach = grasps.contacts, grasps.part_from_hand[:, :3, 2]
    if turned:
        contacts, approach = contacts[:, ::-1], -approach
    rows = np.concatenate([contacts.reshape(len(grasps), 6), approach], axis=1)
    return set(map(tuple, np.round(rows, 6) + 0.0))


def faces(hand, grasps, i: int) -> np.ndarray:
    """Corners (3, 4, 3) of the pads' faces of one grasp in the part's frame, the single finger's first."""
    corners = np.array([np.outer([-0.5, -0.5, 0.5, 0.5], [0.0, *pad.size]) for pad in hand.pads])
    corners[:, [1, 3], 2] *= -1.0
    return transform_points(grasps.part_from_hand[i] @ hand.hand_from_pad(grasps.opening[i : i + 1])[0], corners)


def along_pair(grasps, i: int, face: np.ndarray) -> tuple[float, float]:
    """Where corners (4, 3) lie along the line on which the pair of one grasp stands, from and to."""
    y = transform_points(invert(grasps.part_from_hand[i]), face)[:, 1]
    return y.min(), y.max()


def test_each_faces_its_giver_but_for_how_the_pads_stand(giver, taker):
    own = faced(giver, taker)
    difference = invert(giver.part_from_hand[own] @ HALF_TURN) @ taker.part_from_hand
    np.testing.assert_allclose(difference[:, :3, :3], np.tile(np.eye(3), (len(taker), 1, 1)), atol=1e-9)
    np.testing.assert_allclose(difference[:, 1:3, 3], 0.0, atol=1e-9)  # moved along the closing axis alone, and there
    moved, wider = np.abs(difference[:, 0, 3]), np.abs(taker.opening - giver.opening[own])
    assert (moved <= DEFAULTS.h_max).all()  # by what a pad may stand off
    assert (wider <= 2.0 * DEFAULTS.h_max).all()
    assert (moved.max() > 1e-4) == (taker.part == "wedge")


def test_the_contacts_are_the_givers_the_other_way_round(giver, taker):
    own = faced(giver, taker)
    for name in ("contacts", "normals", "facets"):
        np.testing.assert_array_equal(getattr(taker, name), getattr(giver, name)[own][:, ::-1])


def test_they_are_the_hands_own_grasps_that_are_turned_so(giver, taker):
    """Among all grasps of a part, turned by eighths and both ways round, are those that face one of them."""
    assert named(taker) == named(giver) & named(giver, turned=True)
    assert 500 < len(taker) < len(giver)


def test_they_keep_the_givers_order_and_tell_its_grasps_from_any_order(part, hand, giver, taker, rng):
    own = faced(giver, taker)
    assert (np.diff(own) > 0).all()
    shuffled = rng.permutation(len(giver))
    np.testing.assert_array_equal(shuffled[faced(giver[shuffled], taker)], own)
    some = shuffled[:300]
    from_some = facing_grasps(part, hand, giver[some], DEFAULTS)
    there = some[faced(giver[some], from_some)]
    assert set(there) == set(some) & set(own)
    kept = taker.part_from_hand[np.searchsorted(own, there)]
    np.testing.assert_array_equal(from_some.part_from_hand, kept)


def test_the_giver_faces_those_that_face_it(part, hand, giver, taker):
    back = facing_grasps(part, hand, taker, DEFAULTS)
    assert len(back) == len(taker)
    np.testing.assert_allclose(back.part_from_hand, giver.part_from_hand[faced(giver, taker)], atol=1e-9)


def test_the_single_finger_of_either_stands_between_the_two_of_the_other(hand, giver, taker, rng):
    own = faced(giver, taker)
    for i in rng.choice(len(taker), 200, replace=False):
        mine, theirs = faces(hand, taker, i), faces(hand, giver, own[i])
        for single, pair, among in ((mine[0], theirs[1:], (giver, own[i])), (theirs[0], mine[1:], (taker, i))):
            below, above = sorted(along_pair(*among, face) for face in pair)
            low, high = along_pair(*among, single)
            assert below[1] < low < high < above[0]


def test_hands_clear_the_part_with_their_fingers_a_bit_open_and_touch_it_with_them_closed(part, hand, taker, rng):
    """By python-fcl: all pieces of the hand against the part."""
    body = _object(part.mesh)
    for i in rng.choice(len(taker), 30, replace=False):
        base = taker.part_from_hand[i] @ invert(hand.base_from_hand(taker.opening[i : i + 1])[0])
        for opening, touching in ((taker.opening[i] + 1e-3, False), (taker.opening[i] - 1e-4, True)):
            poses = base @ hand.base_from_piece([opening])[0]
            hits = [_touch(_object(p.mesh, at), body) for p, at in zip(hand.pieces, poses, strict=True)]
            assert any(hits) == touching


def test_nothing_faces_nothing(part, hand, giver):
    none = facing_grasps(part, hand, giver[:0], DEFAULTS)
    assert len(none) == len(faced(giver, none)) == 0


def test_hands_of_two_fingers_do_not_interlock(part, giver):
    with pytest.raises(InputError, match="robotiq_2f85: its fingers cannot interlock") as caught:
        facing_grasps(part, load_hand("robotiq_2f85"), giver, DEFAULTS)
    assert "hrp5p_three_finger" in caught.value.cure


def _object(mesh: trimesh.Trimesh, at: np.ndarray | None = None) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    at = np.eye(4) if at is None else at
    return fcl.CollisionObject(model, fcl.Transform(at[:3, :3], at[:3, 3]))


def _touch(a: fcl.CollisionObject, b: fcl.CollisionObject) -> bool:
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))
