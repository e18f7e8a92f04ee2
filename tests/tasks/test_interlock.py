"""Handing over with interlocked fingers: which grasps go together, and the motions from hand to hand."""

from __future__ import annotations

import itertools
from dataclasses import replace

import fcl
import numpy as np
import pytest
import trimesh
from own_kinematics import Flanges

from kumitate.errors import InputError, NoRegraspError
from kumitate.grasping.interlock import faced, facing_grasps
from kumitate.regrasp.handovers import HandoverPairs
from kumitate.regrasp.reach import Holder
from kumitate.robots.library import load_robot
from kumitate.tasks.cell import Cell, build_cell
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.goals import hand_over
from kumitate.tasks.interlock import LockedPairs
from kumitate.tasks.job import Job
from kumitate.tasks.task import At, HandOver
from kumitate.tasks.task_file import task_of
from kumitate.transforms import invert, pose, pose_distance, transform_points

HANDS = {"left": "hrp5p_three_finger", "right": "hrp5p_three_finger"}
TO_LEFT = HandOver("bar", "left", At((0.45, 0.2, 0.4)), interlocked=True)
HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def cell(tmp_path_factory) -> Cell:
    """A bar on a table, the right hand nearer to it."""
    folder = tmp_path_factory.mktemp("bar")
    trimesh.creation.box([0.04, 0.16, 0.05]).export(folder / "bar.stl")
    task = {
        "robot": "hrp5p",
        "hands": HANDS,
        "cell": [{"name": "table", "box": [0.5, 1.2, 0.02], "at": {"xyz": [0.55, 0.0, 0.14]}, "support": True}],
        "parts": {
            "bar": {
                "mesh": "bar.stl",
                "unit": "m",
                "mass": 0.3,
                "at": {"xyz": [0.5, -0.15, 0.175]},
                "grasps": {"t_rnn": 0.008},
            }
        },
        "goals": [{"hand_over": {"part": "bar", "to": "left", "at": {"xyz": [0.45, 0.2, 0.4]}, "interlocked": True}}],
    }
    return build_cell(task_of(task), folder)


def new_job(cell: Cell) -> Job:
    return Job(cell, 0, Deadline(600.0))


@pytest.fixture(scope="module")
def handed_over(cell) -> Job:
    job = new_job(cell)
    hand_over(job, TO_LEFT)
    return job


@pytest.fixture
def handed(handed_over):
    """A job in which the right hand has given the bar to the left one."""
    mark = handed_over.mark()
    yield handed_over
    handed_over.back_to(mark)


# Pairs ----------------------------------------------------------------------------------------------------------------


class Locked:
    """Some grasps of the bar by the right hand, those of the left that face them, and one more that faces none."""

    def __init__(self, cell: Cell) -> None:
        part, hand = cell.parts["bar"], cell.robot.hands["left"]
        given = new_job(cell).grasps("bar", "right").thin(60)
        taken = facing_grasps(part, hand, given, cell.parameters["bar"])
        self.faced = np.append(faced(given, taken), -1)
        self.giver = Holder.of(cell.robot, "right", given)
        self.taker = Holder.of(cell.robot, "left", taken.joined(given[:1]))
        self.pairs = LockedPairs(self.giver, self.taker, self.faced)
        self.every = np.arange(len(given)), np.arange(len(self.faced))


@pytest.fixture(scope="module")
def locked(cell) -> Locked:
    return Locked(cell)


def test_those_go_together_that_face_each_other_and_are_clear(locked, rng):
    """Hands that face each other are all clear here; so others are told to face each other, too, by chance."""
    given, taken = locked.every
    clear = HandoverPairs(locked.giver, locked.taker).clear(given, taken)
    for told in (locked.faced, rng.choice(given, len(taken))):
        pairs = LockedPairs(locked.giver, locked.taker, told)
        facing = given[:, None] == told
        np.testing.assert_array_equal(pairs.clear(given, taken), facing & clear)
        np.testing.assert_array_equal(pairs.facing, told >= 0)
    assert 0 < (facing & clear).sum() < facing.sum() == len(taken)
    assert locked.pairs.clear(given, taken).sum() == len(taken) - 1


def test_it_does_not_matter_which_are_asked_for_together(locked, rng):
    given, taken = locked.every
    whole = locked.pairs.clear(given, taken)
    again = LockedPairs(locked.giver, locked.taker, locked.faced)
    for _ in range(5):
        rows, columns = rng.permutation(given)[:20], rng.permutation(taken)[:15]
        np.testing.assert_array_equal(again.clear(rows, columns), whole[np.ix_(rows, columns)])


def test_hands_that_go_together_do_not_touch_at_the_same_contacts(locked):
    """By python-fcl on all pieces of both hands, closed on the bar."""
    together = np.argwhere(locked.pairs.clear(*locked.every))
    for g, t in together:
        hands = []
        for holder, grasp in ((locked.giver, g), (locked.taker, t)):
            hand, opening = holder.arm.hand, holder.grasps.opening[[grasp]]
            poses = holder.grasps.part_from_hand[grasp] @ hand.hand_from_piece(opening)[0]
            hands.append([_object(piece.mesh, at) for piece, at in zip(hand.pieces, poses, strict=True)])
        assert not any(_touch(a, b) for a, b in itertools.product(*hands))


# From hand to hand ----------------------------------------------------------------------------------------------------


def both_hold(job: Job, since: int = 0) -> int:
    """The number of the step that closes a hand on a part which another holds already."""
    steps = job.motions.steps
    (number,) = [
        i for i, step in enumerate(steps) if i >= since and step.kind == "close" and "bar" in step.start.attached
    ]
    return number


def kinds(job: Job, since: int = 0) -> list[str]:
    return [step.kind for step in job.motions.steps[since:]]


def assert_interlocked(job: Job, number: int) -> None:
    """That after a step the single finger of either hand is between the two of the other, at its height."""
    state = job.motions.steps[number].end
    flanges = Flanges("hrp5p", job.cell.robot.joint_names).at(state.q)
    frames, faces = {}, {}
    for arm, mounted in job.cell.robot.arms.items():
        hand, opening = mounted.hand, [state.openings[arm]]
        frames[arm] = flanges[arm] @ mounted.flange_from_base @ hand.base_from_hand(opening)[0]
        corners = np.array([np.outer([-0.5, 0.5], [0.0, *pad.size]) for pad in hand.pads])
        faces[arm] = transform_points(frames[arm] @ hand.hand_from_pad(opening)[0], corners)
    for arm, other in itertools.permutations(frames):
        single, *pair = transform_points(invert(frames[arm]), np.concatenate([faces[other][:1], faces[arm][1:]]))
        below, above = sorted(pair, key=lambda face: face[:, 1].mean())
        assert below[:, 1].max() < single[:, 1].min() < single[:, 1].max() < above[:, 1].min()
        assert max(face[:, 2].min() for face in (single, *pair)) < min(face[:, 2].max() for face in (single, *pair))
    assert frames["left"][:3, 2] @ frames["right"][:3, 2] < -0.99


def test_the_taker_takes_it_with_its_fingers_between_the_givers_and_ends_with_it_at_the_pose(handed):
    assert handed.motions.state.attached["bar"].carrier == "left"
    np.testing.assert_allclose(pose_distance(handed.pose("bar"), pose(TO_LEFT.at.xyz)), 0.0, atol=1e-3)
    number = both_hold(handed)
    assert handed.motions.steps[number].arms == ("left",)
    assert handed.motions.steps[number].start.attached["bar"].carrier == "right"
    assert_interlocked(handed, number)
    assert kinds(handed, number) == ["close", "open", "retreat", "transfer"]


def test_the_grasps_of_both_face_each_other(handed):
    number = both_hold(handed)
    given = next(step.grasp for step in handed.motions.steps if step.kind == "lift")
    taken = handed.motions.steps[number].grasp
    difference = invert(given.part_from_hand[0] @ HALF_TURN) @ taken.part_from_hand[0]
    np.testing.assert_allclose(difference[:3, :3], np.eye(3), atol=1e-9)
    np.testing.assert_allclose(taken.contacts, given.contacts[:, ::-1], atol=1e-9)
    np.testing.assert_array_equal(handed.used("bar").part_from_hand, taken.part_from_hand)


def test_a_hand_that_holds_it_so_gives_it_without_a_regrasp(handed):
    """What was taken with a facing grasp faces the hand that gave it."""
    since = len(handed.motions.steps)
    hand_over(handed, HandOver("bar", "right", At((0.45, -0.2, 0.4)), interlocked=True))
    assert kinds(handed, since).count("close") == 1
    assert_interlocked(handed, both_hold(handed, since))
    assert handed.motions.state.attached["bar"].carrier == "right"


def test_a_hand_that_holds_it_already_is_given_it_all_the_same(handed):
    since = len(handed.motions.steps)
    hand_over(handed, HandOver("bar", "left", At((0.45, 0.2, 0.45)), interlocked=True))
    closes = [step.arms for step in handed.motions.steps[since:] if step.kind == "close"]
    assert closes[-1] == ("left",)
    assert ("right",) in closes
    last = max(i for i, step in enumerate(handed.motions.steps) if step.kind == "close")
    assert_interlocked(handed, last)
    np.testing.assert_allclose(pose_distance(handed.pose("bar"), pose([0.45, 0.2, 0.45])), 0.0, atol=1e-3)


# Why not --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("other", ["left", "right"])
def test_hands_without_one_finger_against_two_are_refused(cell, other):
    """Either as the giver's or as the taker's."""
    robot = load_robot("hrp5p", {**HANDS, other: "robotiq_2f85"}).with_home(cell.robot.home)
    with pytest.raises(InputError, match="finger") as caught:
        hand_over(new_job(replace(cell, robot=robot, scene=replace(cell.scene, robot=robot))), TO_LEFT)
    assert "both arms" in caught.value.cure


def test_a_pose_out_of_reach_is_told_with_the_number_of_interlocked_grasps(cell):
    with pytest.raises(NoRegraspError, match="no interlocked handover was found") as caught:
        hand_over(new_job(cell), HandOver("bar", "left", At((2.0, 0.0, 0.4)), interlocked=True))
    count, words = caught.value.report[0].split(" ", 1)
    assert words == "interlocked grasps by right and left arm, of those that it can be taken with"
    assert int(count) > 0


def _object(mesh: trimesh.Trimesh, at: np.ndarray) -> fcl.CollisionObject:
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices, mesh.faces)
    model.endModel()
    return fcl.CollisionObject(model, fcl.Transform(at[:3, :3], at[:3, 3]))


def _touch(a: fcl.CollisionObject, b: fcl.CollisionObject) -> bool:
    return bool(fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()))
