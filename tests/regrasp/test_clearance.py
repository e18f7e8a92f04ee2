"""Boxes, hands against bodies and hands against hands, each against an exact check that shares no code with them."""

from __future__ import annotations

from collections.abc import Sequence

import fcl
import numpy as np
import pytest
from cells import MAKERS
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kumitate.regrasp.clearance import Boxes, HandPoses, Hands, hands_hit
from kumitate.robots.library import load_hand
from kumitate.robots.rigid import Rigid
from kumitate.robots.state import Body
from kumitate.transforms import compose, invert, transform_points

HANDS = ("robotiq_2f85", "hrp5p_three_finger", "suction_cup")
laws = settings(max_examples=200, deadline=None)


@pytest.fixture(scope="module", params=HANDS)
def hand(request):
    return load_hand(request.param)


@pytest.fixture(scope="module")
def bracket():
    return Body.from_mesh("bracket", MAKERS["bracket"](0.12, 0.02, 0.1))


def around(rng, n, distance):
    """Poses (n, 4, 4) turned at random, up to ``distance`` from the origin [m]."""
    return compose(Rotation.random(n, random_state=rng).as_matrix(), rng.uniform(-distance, distance, (n, 3)))


def surface(body: Rigid) -> fcl.CollisionObject:
    mesh, model = body.mesh, fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model)


def crossing(a: fcl.CollisionObject, pose_a, b: fcl.CollisionObject, pose_b) -> bool:
    for entry, pose in ((a, pose_a), (b, pose_b)):
        entry.setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))


def meet(pieces: Sequence[fcl.CollisionObject], poses, others: Sequence[fcl.CollisionObject], places) -> bool:
    """Whether a surface of ``pieces`` at ``poses`` crosses one of ``others`` at ``places``."""
    pairs = [(i, j) for i in range(len(pieces)) for j in range(len(others))]
    return any(crossing(pieces[i], poses[i], others[j], places[j]) for i, j in pairs)


# Boxes


def one_box(pose, half) -> Boxes:
    return Boxes.of(-half[None], half[None], pose[None, None])


def gap(a, b, half_a, half_b) -> float:
    """Distance of two boxes by python-fcl; negative or 0 where they meet."""
    placed = [
        fcl.CollisionObject(fcl.Box(*(2.0 * half)), fcl.Transform(pose[:3, :3], pose[:3, 3]))
        for pose, half in ((a, half_a), (b, half_b))
    ]
    if fcl.collide(*placed, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return float(fcl.distance(*placed, fcl.DistanceRequest(), fcl.DistanceResult()))


@laws
@given(seed=st.integers(0, 2**32 - 1), aligned=st.booleans(), size=st.sampled_from([0.3, 1.0, 3.0]))
def test_boxes_are_apart_where_an_exact_check_says_so(seed, aligned, size):
    rng = np.random.default_rng(seed)
    a, b = around(rng, 2, size)
    if aligned:
        b[:3, :3] = a[:3, :3][:, rng.permutation(3)]
        b[:3, 0] *= np.linalg.det(b[:3, :3])
    half_a, half_b = rng.uniform(0.05, 1.0, (2, 3))
    apart = bool(one_box(a, half_a).apart(one_box(b, half_b))[0, 0])
    distance = gap(a, b, half_a, half_b)
    if apart:
        assert distance > 0.0
    else:
        assert distance < 1e-6
    assert apart == bool(one_box(b, half_b).apart(one_box(a, half_a))[0, 0])


def test_rods_are_apart_by_their_edges_too(rng):
    """Thin and thick boxes, many of them apart along no face's normal but along a normal to two edges."""
    n = 3000
    poses, half = around(rng, 2 * n, 0.5), 10.0 ** rng.uniform(-2.0, 0.0, (2 * n, 3))
    boxes = Boxes.of(-half, half, poses[None])[0]
    apart = boxes[:n].apart(boxes[n:])
    assert 0.2 * n < apart.sum() < 0.8 * n
    gaps = np.array([gap(poses[i], poses[i + n], half[i], half[i + n]) for i in range(n)])
    assert (gaps[apart] > 0.0).all()
    assert (gaps[~apart] < 1e-6).all()


def test_a_box_inside_another_is_not_apart_from_it(rng):
    poses, half = around(rng, 200, 1.0), rng.uniform(0.05, 0.6, (200, 3))
    outer, inner = (Boxes.of(-size, size, poses[None]) for size in (half, half / 10.0))
    assert not outer.apart(inner).any()


def test_boxes_that_touch_are_not_apart():
    """Boxes side by side, with a corner, an edge or a face in common, and with nothing but a hair between them."""
    half = np.full(3, 0.1)
    for way in ([1, 0, 0], [1, 1, 0], [1, 1, 1]):
        for shift, apart in ((0.2, False), (0.2 + 1e-6, True)):
            moved = compose(np.eye(3), shift * np.array(way, dtype=float))
            assert one_box(np.eye(4), half).apart(one_box(moved, half)).item() == apart


def test_boxes_hold_the_bodies_they_are_around(bracket, hand, rng):
    poses = around(rng, 5, 1.0)[:, None] @ hand.base_from_piece(np.full(5, hand.stroke[1]))
    boxes = Boxes.around(hand.pieces, poses)
    assert boxes.center.shape == (5, len(hand.pieces), 3)
    for i, piece in enumerate(hand.pieces):
        points = transform_points(poses[:, i], piece.mesh.vertices) - boxes.center[:, i, None]
        inside = np.abs(points @ boxes.axes[:, i])
        assert (inside <= boxes.half[:, i, None] + 1e-9).all()
    assert Boxes.around([bracket], np.eye(4)[None, None]).half[0, 0] == pytest.approx([0.06, 0.06, 0.05])


# Hands


def test_hands_hit_what_their_pieces_touch_one_by_one(hand, bracket, rng):
    n = 300
    pose = around(rng, 1, 0.3)[0]
    bases = pose @ around(rng, n, 0.1)
    openings = rng.uniform(*hand.stroke, n)
    hits = hands_hit(hand, bases, openings, bracket, pose)
    poses = bases[:, None] @ hand.base_from_piece(openings)
    each = [any(bracket.touches(p, invert(pose) @ at) for p, at in zip(hand.pieces, row, strict=True)) for row in poses]
    np.testing.assert_array_equal(hits, each)
    pieces, other = [surface(piece) for piece in hand.pieces], surface(bracket)
    exact = np.array([meet(pieces, row, [other], [pose]) for row in poses])
    assert hits[exact].all()
    assert exact.sum() > 20
    assert (~hits).sum() > 20
    # What touches without crossing lies wholly inside: a piece in the bracket, or the bracket in a piece.
    for i in np.flatnonzero(hits & ~exact):
        at = poses[i]
        assert any(
            p.mesh.contains(transform_points(invert(q) @ pose, bracket.mesh.vertices[:1])).any()
            or bracket.mesh.contains(transform_points(invert(pose) @ q, p.mesh.vertices[:1])).any()
            for p, q in zip(hand.pieces, at, strict=True)
        )


def test_some_hands_without_some_pieces_and_with_room_around_them(hand, bracket, rng):
    bases, openings = around(rng, 120, 0.1), rng.uniform(*hand.stroke, 120)
    hands, pose = Hands.of(hand, bases, openings), around(rng, 1, 0.05)[0]
    chosen, without, margin = rng.permutation(120)[:80], [0], 4e-3
    hits = hands.hit(chosen, bracket, pose, without=without, margin=margin)
    poses = (bases[:, None] @ hand.base_from_piece(openings))[chosen]
    expected = [
        any(bracket.touches(p, invert(pose) @ at, margin) for p, at in list(zip(hand.pieces, row, strict=True))[1:])
        for row in poses
    ]
    np.testing.assert_array_equal(hits, expected)
    assert not hits.all()
    assert hits.any() == (len(hand.pieces) > 1)
    assert (hits <= hands.hit(chosen, bracket, pose, margin=margin)).all()


def test_no_hands_hit_nothing(hand, bracket):
    none = hands_hit(hand, np.zeros((0, 4, 4)), np.zeros(0), bracket, np.eye(4))
    assert none.shape == (0,)
    assert none.dtype == bool


def test_hands_that_meet_are_never_called_clear_and_few_that_are_clear_are_called_hits(hand, rng):
    n = 12
    bases, openings = around(rng, 2 * n, 0.6 * hand.pieces[0].ball[3]), rng.uniform(*hand.stroke, 2 * n)
    hands = [HandPoses.of(hand, bases[k], openings[k]) for k in (slice(n), slice(n, None))]
    pairs = np.array([(i, j) for i in range(n) for j in range(n)])
    hits = hands[0].hit(hands[1], pairs)
    pieces = [[surface(piece) for piece in hand.pieces] for _ in range(2)]
    poses = bases[:, None] @ hand.base_from_piece(openings)
    exact = np.array([meet(pieces[0], poses[i], pieces[1], poses[n + j]) for i, j in pairs])
    assert hits[exact].all()
    assert exact.sum() > 20
    assert (~hits).sum() > 20
    assert (hits & ~exact).sum() <= 0.2 * (~exact).sum()  # covers are wider than what they cover: the cup's most
    np.testing.assert_array_equal(hands[1].hit(hands[0], pairs[:, ::-1]), hits)
    assert hands[0].hit(hands[1], np.zeros((0, 2), dtype=np.intp)).shape == (0,)
