"""Handovers: pairs of grasps against exact shapes all along coming, taking, letting go and leaving; where they are."""

from __future__ import annotations

import fcl
import numpy as np
import pytest
from tabletops import Tabletop, robot_with_hands, tabletop

from kumitate.regrasp.handovers import HandoverPairs, sample_handovers
from kumitate.regrasp.reach import APPROACH, Holder
from kumitate.robots.rigid import Rigid
from kumitate.transforms import Array, invert, pose, transform_points

ARMS = ("left", "right")
N = 20


@pytest.fixture(scope="module", params=["bracket", "block"])
def table(request) -> Tabletop:
    return tabletop("ur3_dual", request.param)


@pytest.fixture(scope="module")
def holders(table) -> list[Holder]:
    grasps = table.grasps.thin(2 * N)
    odd = np.arange(2 * N) % 2 == 1
    return [Holder.of(table.robot, arm, grasps[rows]) for arm, rows in zip(ARMS, (odd, ~odd), strict=True)]


class Surfaces:
    """The pieces of a hand as surfaces for python-fcl."""

    def __init__(self, pieces: tuple[Rigid, ...]) -> None:
        self.meshes = [piece.mesh for piece in pieces]
        self.objects = [fcl.CollisionObject(self._model(mesh)) for mesh in self.meshes]

    @staticmethod
    def _model(mesh) -> fcl.BVHModel:
        model = fcl.BVHModel()
        model.beginModel(len(mesh.vertices), len(mesh.faces))
        model.addSubModel(mesh.vertices, mesh.faces)
        model.endModel()
        return model

    def boxes(self, poses: Array) -> tuple[Array, Array]:
        corners = [
            transform_points(at, mesh.bounding_box.vertices) for at, mesh in zip(poses, self.meshes, strict=True)
        ]
        return np.min(corners, axis=1), np.max(corners, axis=1)

    def cross(self, poses: Array, other: Surfaces, places: Array) -> bool:
        """Whether a surface of one at ``poses`` crosses one of the other at ``places`` (pieces, 4, 4)."""
        for mine, at in ((self, poses), (other, places)):
            for entry, where in zip(mine.objects, at, strict=True):
                entry.setTransform(fcl.Transform(where[:3, :3], where[:3, 3]))
        (low, high), (lowest, highest) = self.boxes(poses), other.boxes(places)
        near = ((low[:, None] <= highest) & (lowest <= high[:, None])).all(axis=-1)
        return any(
            fcl.collide(self.objects[i], other.objects[j], fcl.CollisionRequest(), fcl.CollisionResult())
            for i, j in np.argwhere(near)
        )


def hand_at(holder: Holder, grasp: int, share: float, back: float) -> Array:
    """Poses (pieces, 4, 4) of a hand in the part's frame, ``share`` of the way to its approach opening, drawn back."""
    grasps, arm = holder.grasps, holder.arm
    closed, wide = grasps.opening[grasp], grasps.approach_opening[grasp]
    flange = grasps.part_from_hand[grasp] @ invert(arm.flange_from_hand(closed))[0]
    base = flange @ arm.flange_from_base
    base[:3, 3] -= back * grasps.part_from_hand[grasp, :3, 2]
    return base @ arm.hand.base_from_piece(np.array([closed + share * (wide - closed)]))[0]


MOMENTS = [(0.0, 0.0), (0.4, 0.0), (0.9, 0.0), (1.0, 0.0), (1.0, 0.005), (1.0, 0.02), (1.0, 0.04), (1.0, APPROACH)]


def crossings(giver: Holder, taker: Holder) -> Array:
    """Whether hands (g, t) cross while the taker comes and closes, or while the giver opens and leaves."""
    hands = [Surfaces(holder.arm.hand.pieces) for holder in (giver, taker)]
    gives, takes = (
        [[hand_at(holder, i, *moment) for moment in MOMENTS] for i in range(len(holder.grasps))]
        for holder in (giver, taker)
    )
    found = np.zeros((len(gives), len(takes)), dtype=bool)
    for g, t in np.ndindex(found.shape):
        ways = [(gives[g][0], there) for there in takes[t]] + [(there, takes[t][0]) for there in gives[g]]
        found[g, t] = any(hands[0].cross(mine, hands[1], theirs) for mine, theirs in ways)
    return found


def test_hands_that_cross_at_any_moment_never_go_together(holders):
    clear = HandoverPairs(*holders).clear(np.arange(N), np.arange(N))
    crossing = crossings(*holders)
    assert not (clear & crossing).any()
    assert clear.sum() > 20
    assert crossing.sum() > 30
    # Few pairs are given up that cross nowhere: hands are covered by hulls, and looked at in fewer places.
    assert (~clear & ~crossing).sum() <= 0.15 * (~crossing).sum()


def test_giver_and_taker_change_places(holders):
    giver, taker = holders
    there = HandoverPairs(giver, taker).clear(np.arange(N), np.arange(N))
    back = HandoverPairs(taker, giver).clear(np.arange(N), np.arange(N))
    np.testing.assert_array_equal(there, back.T)


def test_asking_for_some_gives_the_same_as_asking_for_all(holders, rng, monkeypatch):
    every = np.arange(N)
    whole = HandoverPairs(*holders).clear(every, every)
    pairs = HandoverPairs(*holders)
    for _ in range(6):
        given, taken = rng.permutation(N)[: rng.integers(0, 9)], rng.permutation(N)[:7]
        np.testing.assert_array_equal(pairs.clear(given, taken), whole[np.ix_(given, taken)])
    pairs.clear(every, every)
    monkeypatch.setattr(HandoverPairs, "_look", lambda *_: pytest.fail("looked at again"))
    np.testing.assert_array_equal(pairs.clear(every, every), whole)


# Where


def test_handovers_are_in_the_air_where_both_arms_reach_and_no_two_are_the_same(rng):
    robot = robot_with_hands("nextage")
    near = np.array([0.4, 0.05, -0.1])
    turned = [np.eye(3), pose(rpy=[0.3, 0.1, 0.0])[:3, :3]]
    nodes = sample_handovers(robot, ARMS, near, turned, rng)
    poses = np.array([node.world_from_part for node in nodes])
    assert len({node.name for node in nodes}) == len(nodes)
    assert all(node.support is None and node.to_leave for node in nodes)
    places, count = np.unique(np.round(poses[:, :3, 3], 6), axis=0, return_counts=True)
    assert 1 < len(places) <= 8
    assert set(count.tolist()) == {48}  # 24 turns of each of two rotations
    gaps = np.linalg.norm(places[:, None] - places, axis=-1)[~np.eye(len(places), dtype=bool)]
    assert gaps.min() >= 0.1 - 1e-9
    keys = {tuple(np.round(one, 6).ravel()) for one in poses}
    assert len(keys) == len(nodes)
    for place in places:
        hands = np.tile(pose(place), (200, 1, 1))
        hands[:, :3, :3] = np.linalg.qr(rng.normal(size=(200, 3, 3)))[0]
        hands[:, :3, 0] *= np.linalg.det(hands[:, :3, :3])[:, None]
        for arm in ARMS:
            tips = hands @ invert(robot.arms[arm].flange_from_hand(0.0))
            assert robot.arms[arm].solver(tips).solved.sum() > 10


def test_turns_of_a_cube_are_not_counted_twice(rng):
    robot = robot_with_hands("ur3_dual")
    near = np.array([0.35, 0.0, 1.2])
    once = sample_handovers(robot, ARMS, near, [np.eye(3)], np.random.default_rng(4))
    quarter = pose(rpy=[0.0, 0.0, np.pi / 2.0])[:3, :3]
    twice = sample_handovers(robot, ARMS, near, [np.eye(3), quarter], np.random.default_rng(4))
    assert len(once) == len(twice)
    for a, b in zip(once, twice, strict=True):
        np.testing.assert_allclose(a.world_from_part, b.world_from_part, atol=1e-9)


def test_the_same_generator_gives_the_same_handovers():
    robot = robot_with_hands("ur3_dual")
    near = np.array([0.35, 0.0, 1.2])
    a, b, c = (sample_handovers(robot, ARMS, near, [np.eye(3)], np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert [node.world_from_part.tobytes() for node in a] == [node.world_from_part.tobytes() for node in b]
    assert [node.world_from_part.tobytes() for node in a] != [node.world_from_part.tobytes() for node in c]
