"""Steps one after the other: they join, touch nothing by a second opinion, and leave nothing behind when they fail."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tabletops import Tabletop, tabletop
from witness import LINE_STEP, Witness, faults, looks

from kumitate.errors import BlockedError, NoPathError, UnreachableLineError
from kumitate.regrasp.reach import APPROACH, LIFT, Holder, Reach
from kumitate.regrasp.steps import Event, Motions, StepError
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, SceneState
from kumitate.transforms import pose, pose_distance, transform_points

PART = "bracket"


class Job:
    """A bracket picked up by the right arm, turned by a third of a turn, and put down beside."""

    def __init__(self, table: Tabletop) -> None:
        self.table = table
        self.scene = Scene.of(table.robot, [*table.scene.bodies.values(), Body.box("post", [0.04, 0.04, 0.2])])
        self.away = pose([0.3, 0.6, table.top + 0.5])
        here, there = table.at([0.3, -0.2, 0.025]), table.at([0.3, -0.35, 0.025], [0.0, 0.0, 2.0])
        grasps = table.grasps.thin(150)
        reacher = table.reacher(here, grasps, ["right"])
        every = np.ones(len(grasps), dtype=bool)
        found = [reacher.reach(table.node(name, at), "right", every) for name, at in (("here", here), ("there", there))]
        self.grasp = int(np.intersect1d(found[0].grasp, found[1].grasp)[0])
        self.source, self.target = (self.first(reach) for reach in found)
        self.holder, self.there = reacher.holders["right"], there
        at = {"table": table.world_from_table, PART: here, "post": self.away}
        self.start = self.scene.state(at).with_contacts(table.resting(here).contacts)
        self.motions = self.whole()
        self.witness = Witness(self.scene)

    def first(self, reach: Reach) -> Reach:
        return reach.take(np.flatnonzero(reach.grasp == self.grasp)[:1])

    def whole(self, speed: float = 0.5) -> Motions:
        motions = Motions(self.scene, self.start, speed, seed=3)
        motions.take(self.holder, PART, self.grasp, self.source.before[0])
        motions.lift(self.holder, PART, self.grasp, LIFT)
        motions.free({"right": self.target.above[0]}, "transfer", "right arm carries it", PART)
        motions.lower(self.holder, PART, self.grasp, self.there, "table")
        motions.give(self.holder, PART, self.grasp)
        motions.retreat(self.holder, PART, self.grasp, APPROACH)
        return motions

    def faults(self, steps=None) -> list[str]:
        return faults(self.scene, self.start, self.motions.steps if steps is None else steps, PART, self.witness)

    def with_body(self, name: str, at: np.ndarray, kind: str):
        """The step of one kind with a body elsewhere."""
        (step,) = (step for step in self.motions.steps if step.kind == kind)
        return replace(step, start=step.start.with_pose(name, at), end=step.end.with_pose(name, at))


@pytest.fixture(scope="module")
def job() -> Job:
    return Job(tabletop("ur3_dual", PART))


def test_the_second_look_takes_steps_of_a_fifth_of_a_millimetre_and_agrees_with_the_reference(job):
    lift = next(step for step in job.motions.steps if step.kind == "lift")
    poses = looks(job.scene, lift, job.witness)
    corners = transform_points(poses, job.witness._corners).reshape(len(poses), -1, 3)
    assert np.linalg.norm(np.diff(corners, axis=0), axis=-1).max() <= LINE_STEP
    body = job.witness.names.index(PART)
    assert poses[-1, body, 2, 3] - poses[0, body, 2, 3] == pytest.approx(LIFT, abs=1e-4)
    for share in (0.0, 0.3, 1.0):
        q = lift.trajectory.sample([share * lift.trajectory.duration])
        np.testing.assert_allclose(job.witness.along(lift.start, q)[0], job.witness.poses(lift.start, q[0]), atol=1e-9)


def test_the_second_look_finds_what_it_should_find(job):
    """A table that rises into the part, or a post in the way; a part may sink in by less than the contact tolerance."""
    raised = {depth: pose([0.0, 0.0, depth]) @ job.table.world_from_table for depth in (0.0003, 0.001)}
    names = [step.kind for step in job.motions.steps]
    assert names.count("lift") == 1
    for depth, fine in ((0.0003, True), (0.001, False)):
        found = job.faults([job.with_body("table", raised[depth], "lift")])
        assert ("step 0, lift by right: table / bracket cross" not in found) == fine
        assert "step 0, lift by right: joints or openings jump" in found  # it is the first of these steps
    transfer = next(step for step in job.motions.steps if step.kind == "transfer")
    middle = transfer.start.with_q(transfer.trajectory.sample([0.5 * transfer.trajectory.duration])[0])
    found = job.faults([job.with_body("post", job.scene.world_from_body(middle, PART), "transfer")])
    assert any(line.endswith(("/ post cross", "post / bracket cross", "bracket / post cross")) for line in found)
    extra = replace(transfer, start=transfer.start.with_contacts(job.motions.steps[0].start.contacts))
    assert "step 0, transfer by right: contact ('table', 'bracket')" in job.faults([extra])


def test_a_part_is_picked_up_carried_and_put_down_without_a_fault(job):
    steps = job.motions.steps
    kinds = [step.kind for step in steps]
    assert (
        kinds == ["open", "transit", "approach", "close", "lift", "transfer", "lower", "open", "retreat"][-len(kinds) :]
    )
    assert job.faults() == []
    end = job.motions.state
    distance, angle = pose_distance(job.scene.world_from_body(end, PART), job.there)
    assert distance < 1e-5
    assert angle < 1e-5
    assert not end.attached
    assert [(c.first, c.second) for c in end.contacts] == [("table", PART)]
    assert all(step.part == PART and step.grasp is not None for step in steps if step.kind != "transfer")


def test_events_say_who_takes_the_part_and_when(job):
    events = [(step.kind, event) for step in job.motions.steps for event in step.events]
    attach, detach = Event("attach", PART, "right", at_end=True), Event("detach", PART, "right", at_end=False)
    assert events == [("close", attach), ("open", detach)]
    held = [PART in step.start.attached for step in job.motions.steps]
    first, last = (i for i, step in enumerate(job.motions.steps) if step.events)
    assert held == [first < i <= last for i in range(len(held))]
    for step in job.motions.steps:
        for opening in step.openings.values():
            assert opening == (step.start.openings["right"], step.end.openings["right"])


def test_where_the_named_arm_is_there_already_the_others_go_home_with_nothing(job):
    robot, motions = job.table.robot, job.whole()
    left, right = robot.arm("left").indices, robot.arm("right").indices
    up = robot.home[left] + 0.1
    motions.free({"left": up, "right": motions.state.q[right]}, "transit", "left arm moves away", None)
    assert motions.steps[-1].arms == ("left",)
    motions.free(
        {"right": motions.state.q[right]}, "transfer", "right arm carries it", PART, grasp=job.holder.row(job.grasp)
    )
    step = motions.steps[-1]
    assert (step.kind, step.arms, step.part, step.grasp) == ("transit", ("left",), None, None)
    np.testing.assert_array_equal(step.end.q[left], robot.home[left])


def test_fingers_stay_below_their_speed(job):
    hand = job.table.robot.hands["right"]
    for step in job.motions.steps:
        for before, after in step.openings.values():
            mean = abs(after - before) / 2.0 / step.trajectory.duration  # of one finger
            assert 1.5 * mean == pytest.approx(0.5 * hand.speed)


def test_half_the_speed_takes_twice_the_time(job):
    for fast, slow in zip(job.motions.steps, job.whole(speed=0.25).steps, strict=True):
        assert slow.kind == fast.kind
        assert slow.trajectory.duration == pytest.approx(2.0 * fast.trajectory.duration)


def test_what_was_marked_comes_back(job):
    motions = Motions(job.scene, job.start, 0.5, seed=3)
    motions.free({"right": job.source.before[0]}, "transit", "there", PART)
    mark, state = motions.mark(), motions.state
    motions.free({"right": job.target.above[0]}, "transit", "and away", PART)
    assert len(motions.steps) == 2
    motions.back_to(mark)
    assert len(motions.steps) == 1
    assert motions.state is state


def test_arms_that_hold_nothing_go_home_and_others_stay(job):
    robot = job.table.robot
    away = job.start.with_q(np.where(np.arange(len(robot.home)) % 3 == 0, robot.home + 0.15, robot.home))
    motions = Motions(job.scene, away, 0.5, seed=1)
    motions.free({"right": job.source.before[0]}, "transit", "there", PART)
    np.testing.assert_array_equal(motions.state.q[robot.arms["left"].indices], robot.home[robot.arms["left"].indices])
    assert set(motions.steps[0].arms) == {"left", "right"}
    held = job.scene.attach(
        away.with_pose("post", robot.hand_pose("left", away.q, 0.085) @ pose([0, 0, 0.02], [np.pi / 2, 0, 0])),
        "post",
        "left",
    )
    motions = Motions(job.scene, held, 0.5, seed=1)
    motions.free({"right": job.source.before[0]}, "transit", "there", PART)
    np.testing.assert_array_equal(motions.state.q[robot.arms["left"].indices], away.q[robot.arms["left"].indices])
    assert motions.steps[0].arms == ("right",)


def test_no_motion_is_no_step(job):
    motions = Motions(job.scene, job.start, 0.5, seed=1)
    motions.free({"right": job.start.q[job.table.robot.arms["right"].indices]}, "transit", "nowhere", PART)
    assert motions.steps == []


def test_a_hand_is_opened_before_it_goes(job):
    motions = Motions(job.scene, job.start.with_opening("right", 0.02), 0.5, seed=1)
    motions.free({"right": job.source.before[0]}, "transit", "there", PART, opening=("right", 0.06))
    assert [step.kind for step in motions.steps] == ["open", "transit"]
    assert motions.steps[0].openings == {"right": (0.02, 0.06)}
    assert motions.state.openings["right"] == 0.06


def test_who_lets_go_of_a_part_that_another_holds_changes_nothing(job):
    carried = next(step.start for step in job.motions.steps if step.kind == "transfer")
    handed = job.scene.attach(carried, PART, "left")
    motions = Motions(job.scene, handed, 0.5, seed=1)
    motions.give(job.holder, PART, job.grasp)
    assert motions.state.attached[PART].carrier == "left"
    assert motions.state.openings["right"] == job.holder.grasps.approach_opening[job.grasp]
    assert not [contact for contact in motions.state.contacts if contact.second.startswith("right/")]


# What fails


def unchanged(motions: Motions, state: SceneState) -> bool:
    return motions.state is state and motions.steps == []


def test_a_line_out_of_reach_is_told_with_step_arm_and_part(job):
    carried = next(step.start for step in job.motions.steps if step.kind == "lift")
    motions = Motions(job.scene, carried, 0.5, seed=1)
    with pytest.raises(StepError, match="lift of bracket by the right arm") as caught:
        motions.lift(job.holder, PART, job.grasp, 2.0)
    assert (caught.value.kind, caught.value.arm, caught.value.part) == ("lift", "right", PART)
    assert isinstance(caught.value.cause, UnreachableLineError)
    assert unchanged(motions, carried)


def test_fingers_that_would_close_through_the_part_are_told(job):
    close = next(step.start for step in job.motions.steps if step.kind == "close")
    motions = Motions(job.scene, close, 0.5, seed=1)
    with pytest.raises(StepError, match=PART) as caught:
        motions.grip("right", 0.0, "close", "too far", PART, (), None)
    assert isinstance(caught.value.cause, BlockedError)
    assert unchanged(motions, close)


def test_a_goal_that_is_shut_in_is_told(job):
    """The hand would have to stand where the post stands."""
    robot, joints = job.table.robot, job.source.before[0]
    q = robot.with_joints(job.start.q, "right", joints[None])[0]
    blocked = job.start.with_pose("post", robot.hand_pose("right", q, 0.085))
    motions = Motions(job.scene, blocked, 0.5, seed=1)
    with pytest.raises(StepError, match="post") as caught:
        motions.free({"right": joints}, "transit", "there", PART)
    assert not isinstance(caught.value.cause, NoPathError)  # found at the goal, before any search
    assert unchanged(motions, blocked)


def test_holders_know_their_arm_only(job):
    other = Holder.of(job.table.robot, "left", job.holder.grasps)
    assert other.row(job.grasp).opening == job.holder.row(job.grasp).opening
    assert {contact.second.split("/")[0] for contact in other.pads(PART, job.grasp)} == {"left"}
