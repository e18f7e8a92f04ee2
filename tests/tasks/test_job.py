"""A job under way: parts and wholes, how they are held, going back, and the time limit."""

from __future__ import annotations

from dataclasses import replace

import fcl
import msgspec
import numpy as np
import pytest
import trimesh

from kumitate.errors import TimeLimitError
from kumitate.regrasp.clearance import hands_hit
from kumitate.regrasp.graph import Goal
from kumitate.regrasp.reach import Node
from kumitate.robots.state import Attachment, SceneState
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.job import Job, any_grasp
from kumitate.tasks.task import At, Region
from kumitate.transforms import pose, pose_distance

ROLLED = (0.0, 0.0, np.pi / 6.0)
IN_TUBE = pose([0.0, 0.0, -0.045], [np.pi, 0.0, 0.0])


@pytest.fixture
def told():
    return []


@pytest.fixture
def job(block_cell, told):
    return Job(block_cell, 0, Deadline(600.0, told.append))


@pytest.fixture(scope="module")
def holding(block_cell):
    """A job in which an arm has brought the block into the air, and the goal."""
    job = Job(block_cell, 0, Deadline(600.0))
    node = Node("in the air", pose([0.4, 0.1, 0.25], [-np.pi / 2, 0.0, 0.0]), None, to_leave=False)
    graph = job.graph("block", [node])
    holders = graph.reacher.holders
    job.bring(graph, [Goal(node, {arm: np.ones(len(h.grasps), dtype=bool) for arm, h in holders.items()})])
    return job, node


def assembled(job):
    """The job once the peg is in the tube that stands there."""
    state = job.motions.state
    poses = {name: where for name, where in state.poses.items() if name != "peg"}
    attached = {**state.attached, "peg": Attachment("tube", IN_TUBE)}
    contacts = tuple(c for c in state.contacts if "peg" not in (c.first, c.second))
    job.motions.state = SceneState(state.q, dict(state.openings), poses, attached, contacts)
    return job


def test_what_it_does_is_told_until_the_time_is_over(block_cell, told):
    Job(block_cell, 0, Deadline(600.0, told.append)).tell("thinking")
    assert told == ["thinking"]
    with pytest.raises(TimeLimitError, match=r"-1 s was over while planning: thinking"):
        Job(block_cell, 0, Deadline(-1.0, told.append)).tell("thinking")
    assert told == ["thinking"]


def test_grasps_are_planned_once_for_equal_parts_and_hands(job, told):
    assert job.grasps("block", "left") is job.grasps("block", "right")
    assert told == ["grasps of block by robotiq_2f85"]
    assert 0 < len(job.grasps("block", "left")) <= 1000


def test_a_part_alone_is_a_whole_of_itself(job):
    whole = job.whole("tube")
    assert whole.part is job.cell.parts["tube"]
    assert whole.others == ()
    assert set(whole.holders) == {"left", "right"}
    assert len(whole.holders["left"].grasps) == len(job.grasps("tube", "left"))
    assert job.whole("tube") is whole


def test_a_whole_has_what_is_assembled_to_it(job):
    parts = job.cell.parts
    alone = job.whole("tube").holders["left"].grasps
    assembled(job)
    assert job.root("peg") == job.root("tube") == "tube"
    whole = job.whole("tube")
    assert whole.others == ("peg",)
    np.testing.assert_allclose(whole.poses[0], IN_TUBE, atol=1e-12)
    assert whole.part.mass == pytest.approx(parts["tube"].mass + parts["peg"].mass)
    # Grasps of the whole are those of the tube whose hands keep clear of the peg.
    known = {row.tobytes() for row in alone.part_from_hand}
    holder = whole.holders["left"]
    assert 0 < len(holder.grasps) < len(alone)
    assert {row.tobytes() for row in holder.grasps.part_from_hand} < known
    base = holder.part_from_flange @ holder.arm.flange_from_base
    peg = job.cell.scene.bodies["peg"]
    assert not hands_hit(holder.arm.hand, base, holder.grasps.opening, peg, IN_TUBE).any()


def test_no_hand_that_holds_a_part_is_where_none_may_be(block_cell):
    """By python-fcl: the grasps that stay are those whose hands touch no region, one of which is turned."""
    regions = (Region((0.05, 0.05, 0.04), At((0.0, 0.0, 0.05))), Region((0.02, 0.2, 0.2), At((0.05, 0.0, 0.0), ROLLED)))
    every = Job(block_cell, 0, Deadline(600.0)).whole("block").holders["left"].grasps
    parts = block_cell.task.parts
    block = msgspec.structs.replace(parts["block"], no_touch=regions)
    task = msgspec.structs.replace(block_cell.task, parts={**parts, "block": block})
    kept = Job(replace(block_cell, task=task), 0, Deadline(600.0)).whole("block").holders["left"].grasps
    known = {row.tobytes() for row in kept.part_from_hand}
    boxes = [placed(solid(trimesh.creation.box(r.box)), pose(r.at.xyz, r.at.rpy)) for r in regions]
    hand = block_cell.robot.hands["left"]
    pieces, stays = [solid(piece.mesh) for piece in hand.pieces], []
    for i in range(0, len(every), 8):
        places = every.part_from_hand[i] @ hand.hand_from_piece(every.opening[[i]])[0]
        there = [placed(piece, at) for piece, at in zip(pieces, places, strict=True)]
        stays.append(every.part_from_hand[i].tobytes() in known)
        assert stays[-1] != any(touch(piece, box) for piece in there for box in boxes)
    assert 10 < sum(stays) < len(stays) - 10


def solid(mesh):
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model)


def placed(item, at):
    item.setTransform(fcl.Transform(at[:3, :3], at[:3, 3]))
    return item


def touch(a, b):
    return fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()) > 0


def test_a_holder_has_those_grasps_of_a_part_that_hold_its_whole(job):
    """Of any grasps; planned ones are not asked for again."""
    assembled(job)
    whole, some = job.whole("tube"), job.grasps("tube", "left")[:300]
    found = job.holder(whole, "left", some).grasps
    known = {row.tobytes() for row in whole.holders["left"].grasps.part_from_hand}
    expected = [i for i in range(len(some)) if some.part_from_hand[i].tobytes() in known]
    np.testing.assert_array_equal(found.part_from_hand, some.part_from_hand[expected])
    assert 0 < len(found) < len(some)


def test_parts_rest_on_what_they_stand_on_until_they_are_carried(job):
    assert {part: job.rests_on(part) for part in job.cell.parts} == dict.fromkeys(job.cell.parts, "table")
    assembled(job)
    assert job.rests_on("peg") is None
    assert job.rests_on("tube") == "table"
    np.testing.assert_allclose(job.pose("peg"), job.pose("tube") @ IN_TUBE, atol=1e-12)


def test_nobody_holds_a_part_that_stands(job):
    assert job.held("block") is None


def test_a_part_that_was_brought_is_held_as_it_was_taken(holding):
    job, node = holding
    held = job.held("block")
    assert held.arm == job.motions.state.attached["block"].carrier
    np.testing.assert_allclose(pose_distance(job.pose("block"), node.world_from_part), 0.0, atol=1e-3)
    grasps = job.whole("block").holders[held.arm].grasps
    hand = job.cell.robot.hand_pose(held.arm, job.motions.state.q, job.motions.state.openings[held.arm])
    told = job.pose("block") @ grasps.part_from_hand[held.grasp]
    np.testing.assert_allclose(pose_distance(told, hand), 0.0, atol=1e-5)
    indices = job.cell.robot.arms[held.arm].indices
    np.testing.assert_array_equal(held.joints, job.motions.state.q[indices])


def test_the_grasp_that_is_used_is_the_one_it_was_taken_with(holding):
    job, _ = holding
    used, held = job.used("block"), job.held("block")
    assert len(used) == 1
    taking = next(step for step in job.motions.steps if step.kind == "close")
    np.testing.assert_array_equal(used.part_from_hand, taking.grasp.part_from_hand)
    np.testing.assert_array_equal(
        used.part_from_hand[0], job.whole("block").holders[held.arm].grasps.part_from_hand[held.grasp]
    )


def test_any_grasp_of_any_arm_or_of_the_one_that_is_pinned(job):
    graph = job.graph("block", [])
    counts = {arm: len(holder.grasps) for arm, holder in graph.reacher.holders.items()}
    for pinned, arms in ((None, {"left", "right"}), ("left", {"left"}), ("right", {"right"})):
        masks = any_grasp(graph, pinned)
        assert set(masks) == arms
        assert all(mask.all() and len(mask) == counts[arm] for arm, mask in masks.items())


def test_going_back_forgets_what_came_after(holding):
    job, _ = holding
    mark, steps = job.mark(), list(job.motions.steps)
    pose_before, held = job.pose("block"), job.held("block")
    node = Node("elsewhere", pose([0.4, 0.05, 0.3], [-np.pi / 2, 0.0, 0.0]), None, to_leave=False)
    every = np.ones(len(job.whole("block").holders[held.arm].grasps), dtype=bool)
    job.bring(job.graph("block", [node]), [Goal(node, {held.arm: every})])
    assert len(job.motions.steps) > len(steps)
    job.back_to(mark)
    assert job.motions.steps == steps
    np.testing.assert_array_equal(job.pose("block"), pose_before)
    assert job.held("block").grasp == held.grasp
