"""Fits: what is said to go together never collides on full meshes along the insertion, and what is not does."""

from __future__ import annotations

import fcl
import numpy as np
import pytest

from kumitate.regrasp.reach import APPROACH
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.fit import Fit, Insertion
from kumitate.tasks.job import Job
from kumitate.transforms import invert, pose

AT = pose([0.0, 0.032, 0.010])
WAY = np.array([0.0, -0.070, 0.0])
SAMPLED = 12
SHARES = np.linspace(0.0, 1.0, 71)  # a millimetre apart


@pytest.fixture(scope="module")
def job(wheel_cell):
    return Job(wheel_cell, 0, Deadline(600.0))


@pytest.fixture(scope="module")
def fit(job):
    return Fit(job.cell.scene, Insertion(AT, WAY), job.whole("wheel"), job.whole("support"), "left", "right")


@pytest.fixture(scope="module")
def masks(fit):
    every = [np.ones(len(holder.grasps), dtype=bool) for holder in (fit.holder, fit.mover)]
    return fit.holding(every[0]), fit.moving(every[1])


class Solid:
    """A mesh as python-fcl has it."""

    def __init__(self, mesh):
        bvh = fcl.BVHModel()
        bvh.beginModel(len(mesh.vertices), len(mesh.faces))
        bvh.addSubModel(mesh.vertices, mesh.faces)
        bvh.endModel()
        self._object = fcl.CollisionObject(bvh, fcl.Transform())

    def at(self, where):
        self._object.setTransform(fcl.Transform(where[:3, :3], where[:3, 3]))
        return self._object


def touch(a, b):
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))


class Hand:
    """A hand of a grasp on full meshes."""

    def __init__(self, holder, grasp):
        self.holder, self.grasp = holder, grasp
        self.pieces = [Solid(piece.mesh) for piece in holder.arm.hand.pieces]

    def at(self, world_from_part, *, closed=True, back=0.0):
        """Its pieces, with the part at a pose."""
        arm, grasps = self.holder.arm, self.holder.grasps
        opening = (grasps.opening if closed else grasps.approach_opening)[[self.grasp]]
        base = world_from_part @ self.holder.part_from_flange[self.grasp] @ arm.flange_from_base
        base[:3, 3] -= back * (world_from_part @ grasps.part_from_hand[self.grasp])[:3, 2]
        poses = base @ arm.hand.base_from_piece(opening)[0]
        return [piece.at(where) for piece, where in zip(self.pieces, poses, strict=True)]


def some(mask, rng):
    (indices,) = np.nonzero(mask)
    return rng.choice(indices, min(SAMPLED, len(indices)), replace=False)


def test_the_insertion_ends_where_it_is_told_and_comes_straight(fit):
    looks = fit.insertion.looks()
    np.testing.assert_allclose(looks[0], AT)
    np.testing.assert_allclose(looks[-1], fit.insertion.before())
    np.testing.assert_allclose(invert(fit.insertion.before()) @ AT, pose(WAY), atol=1e-12)
    assert np.linalg.norm(np.diff(looks[:, :3, 3], axis=0), axis=1).max() <= 0.010 + 1e-12
    np.testing.assert_allclose(looks[:, :3, :3], np.broadcast_to(np.eye(3), looks[:, :3, :3].shape))


def test_holding_grasps_leave_the_way_free(job, fit, masks, rng):
    wheel = Solid(job.cell.parts["wheel"].mesh)
    assert 0 < masks[0].sum() < len(masks[0])
    for grasp in some(masks[0], rng):
        pieces = Hand(fit.holder, grasp).at(np.eye(4))
        for share in SHARES:
            placed = wheel.at(pose(-(1.0 - share) * WAY) @ AT)
            assert not any(touch(placed, piece) for piece in pieces)


def test_grasps_that_are_not_for_holding_are_in_the_way(job, fit, masks, rng):
    wheel = Solid(job.cell.parts["wheel"].mesh)
    for grasp in some(~masks[0], rng):
        pieces = Hand(fit.holder, grasp).at(np.eye(4))
        placed = (wheel.at(pose(-(1.0 - share) * WAY) @ AT) for share in SHARES)
        assert any(touch(part, piece) for part in placed for piece in pieces)


def test_moving_grasps_stay_clear_of_the_other_part(job, fit, masks, rng):
    support = Solid(job.cell.parts["support"].mesh).at(np.eye(4))
    assert 0 < masks[1].sum() < len(masks[1])
    for grasp in some(masks[1], rng):
        hand = Hand(fit.mover, grasp)
        for share in SHARES:
            assert not any(touch(support, piece) for piece in hand.at(pose(-(1.0 - share) * WAY) @ AT))
        for back in np.linspace(0.0, APPROACH, 11):
            assert not any(touch(support, piece) for piece in hand.at(AT, closed=False, back=back))


def test_grasps_that_are_not_for_moving_hit_the_other_part(job, fit, masks, rng):
    support = Solid(job.cell.parts["support"].mesh).at(np.eye(4))
    for grasp in some(~masks[1], rng):
        hand = Hand(fit.mover, grasp)
        coming = [{"where": pose(-(1.0 - share) * WAY) @ AT} for share in SHARES]
        leaving = [{"where": AT, "closed": False, "back": back} for back in np.linspace(0.0, APPROACH, 51)]
        assert any(
            touch(support, piece)
            for how in coming + leaving
            for piece in hand.at(how["where"], closed=how.get("closed", True), back=how.get("back", 0.0))
        )


def test_pairs_that_go_together_have_hands_that_never_touch(fit, masks, rng):
    hold, move = some(masks[0], rng), some(masks[1], rng)
    clear = fit.pairs(hold, move)
    assert clear.shape == (len(hold), len(move))
    pairs = rng.permutation(np.argwhere(clear))[:SAMPLED]
    assert len(pairs)
    for i, j in pairs:
        still, moving = Hand(fit.holder, hold[i]).at(np.eye(4)), Hand(fit.mover, move[j])
        for share in SHARES:
            pieces = moving.at(pose(-(1.0 - share) * WAY) @ AT)
            assert not any(touch(a, b) for a in still for b in pieces)
        for back in np.linspace(0.0, APPROACH, 11):
            pieces = moving.at(AT, closed=False, back=back)
            assert not any(touch(a, b) for a in still for b in pieces)


def test_pairs_are_the_same_whoever_asks_and_in_whatever_order(fit, masks, rng):
    hold, move = some(masks[0], rng), some(masks[1], rng)
    clear = fit.pairs(hold, move)
    np.testing.assert_array_equal(fit.pairs(hold[::-1], move[::-1]), clear[::-1, ::-1])
    np.testing.assert_array_equal(fit.pairs(hold[:1], move), clear[:1])


def test_only_what_is_wanted_is_answered(job, masks):
    fresh = Fit(job.cell.scene, Insertion(AT, WAY), job.whole("wheel"), job.whole("support"), "left", "right")
    half = np.arange(len(masks[0])) % 2 == 0
    np.testing.assert_array_equal(fresh.holding(half), masks[0] & half)
    np.testing.assert_array_equal(fresh.holding(np.ones_like(half)), masks[0])


def test_a_whole_is_looked_at_with_all_its_parts(job, rng):
    """With a wheel on the first axle, a second one's hand must keep clear of that wheel too."""
    wheel, scene = job.cell.parts["wheel"], job.cell.scene
    alone = job.whole("support")
    joined = type(alone)(alone.part, ("wheel",), (AT,), alone.holders)
    insertion = Insertion(pose([0.0, -0.032, 0.010], [0.0, 0.0, np.pi]), -WAY)
    without, together = (Fit(scene, insertion, job.whole("wheel"), whole, "left", "right") for whole in (alone, joined))
    every = np.ones(len(without.mover.grasps), dtype=bool)
    some_clear, fewer = without.moving(every), together.moving(every)
    assert not (fewer & ~some_clear).any()
    on_axle = Solid(wheel.mesh).at(AT)
    for grasp in some(some_clear & ~fewer, rng):
        hand = Hand(without.mover, grasp)
        poses = [(pose(-(1.0 - share) * insertion.way) @ insertion.at, True, 0.0) for share in SHARES]
        poses += [(insertion.at, False, back) for back in np.linspace(0.0, APPROACH, 51)]
        assert any(
            touch(on_axle, piece) for where, closed, back in poses for piece in hand.at(where, closed=closed, back=back)
        )
