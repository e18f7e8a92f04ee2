"""Where bodies are in a plan: compared with a second opinion, and with what the plan itself says."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from plans import sample_plan
from reference import Reference

from kumitate.errors import InputError
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body
from kumitate.tasks.document import Carried, Event, matrix
from kumitate.tasks.film import curve, film
from kumitate.transforms import invert, pose_distance

RATE = 30.0


@pytest.fixture(scope="module")
def plan():
    return sample_plan()


@pytest.fixture(scope="module")
def robot(plan):
    return load_robot(plan.task["robot"], plan.task["hands"])


@pytest.fixture(scope="module")
def whole(plan, robot):
    return film(plan, robot, RATE)


def starts(plan):
    return np.cumsum([0.0, *(action.motion.duration for action in plan.actions)])


def at(film, time):
    return int(np.abs(film.times - time).argmin())


def test_it_is_dense_and_stops_at_the_ends_and_events_of_actions(plan, whole):
    assert whole.times[0] == 0.0
    assert whole.times[-1] == pytest.approx(plan.duration)
    steps = np.diff(whole.times)
    assert (steps > 0.0).all()
    assert steps.max() <= 1.0 / RATE + 1e-9
    for start, action in zip(starts(plan), plan.actions, strict=False):
        for moment in (start, *(start + event.time for event in action.events)):
            assert np.abs(whole.times - moment).min() < 1e-9


def test_parts_are_where_the_plan_says_at_every_end(plan, whole):
    for end, action in zip(starts(plan)[1:], plan.actions, strict=True):
        for part, pose in action.end.poses.items():
            distance, angle = pose_distance(whole.of(part)[at(whole, end)], np.array(pose))
            assert distance < 1e-6
            assert angle < 1e-6


def test_links_and_fingers_are_where_another_reader_of_the_urdf_puts_them(plan, robot, whole):
    parts = [Body.from_mesh(name, mesh.trimesh()) for name, mesh in plan.meshes.items() if name != "table"]
    scene = Scene.of(robot, parts)
    reference = Reference(scene)
    for start, action in zip(starts(plan)[::4], plan.actions[::4], strict=False):
        middle = action.motion.duration / 2.0
        i = at(whole, start + middle)
        states = curve(plan.joints, action.motion).sample([whole.times[i] - start])[0]
        openings = dict(zip(("left", "right"), states[-2:], strict=True))
        state = scene.state({part.name: np.eye(4) for part in parts}, states[:-2], openings)
        expected = dict(zip(reference.names, reference.poses(state, states[:-2]), strict=True))
        bodies = [name for name in whole.names if name not in action.start.poses]
        assert len(bodies) == len(robot.links) + sum(len(hand.pieces) for hand in robot.hands.values())
        for name in bodies:
            assert np.allclose(whole.of(name)[i], expected[name], atol=1e-6), name


def test_a_held_part_stays_with_its_hand_and_none_jumps(plan, whole):
    for start, action in zip(starts(plan), plan.actions, strict=False):
        of = slice(at(whole, start), at(whole, start + action.motion.duration) + 1)
        if action.kind == "transfer":
            grips = invert(whole.of(f"{action.arms[0]}/base")[of]) @ whole.of(action.part)[of]
            assert np.abs(grips - grips[0]).max() < 1e-9
            assert np.ptp(whole.of(action.part)[of], axis=0).max() > 0.04
    for part in plan.actions[0].start.poses:
        way = np.linalg.norm(np.diff(whole.of(part)[:, :3, 3], axis=0), axis=1)
        assert way.max() < 2.0 / RATE  # m: 2 m/s


def test_a_part_that_is_let_go_half_way_stays_there(plan, robot):
    i, action = next((i, a) for i, a in enumerate(plan.actions) if a.kind == "transfer")
    middle = action.motion.duration / 2.0
    event = Event(middle, "detach", action.part, action.arms[0])
    dropped = film(replace(plan, actions=(replace(action, events=(event,)),)), robot, RATE).of(action.part)
    held = film(replace(plan, actions=(action,)), robot, RATE)
    here = at(held, middle)
    assert np.abs(dropped[-1] - dropped[here + 2]).max() < 1e-12
    assert np.abs(dropped[-1] - held.of(action.part)[-1]).max() > 0.01
    again = Event(middle, "attach", action.part, action.arms[0])
    caught = film(replace(plan, actions=(replace(action, events=(event, again)),)), robot, RATE).of(action.part)
    assert np.allclose(caught[-1], held.of(action.part)[-1], atol=1e-9)
    assert plan.actions[i] == action


def test_a_hand_that_no_longer_carries_lets_nothing_go(plan, robot):
    action = next(a for a in plan.actions if a.kind == "transfer")
    other = Event(0.0, "detach", action.part, "right" if action.arms[0] == "left" else "left")
    same = film(replace(plan, actions=(replace(action, events=(other,)),)), robot, RATE)
    assert np.array_equal(same.poses, film(replace(plan, actions=(action,)), robot, RATE).poses)


def test_a_plan_that_does_not_fit_is_told(plan, robot):
    first = plan.actions[0]
    state, motion = first.start, first.motion
    ghost = Event(0.0, "attach", "ghost", "left")
    crane = Event(0.0, "attach", "block", "crane")
    here = matrix(np.eye(4))
    around = {"block": Carried("peg", here), "peg": Carried("tube", here), "tube": Carried("block", here)}
    flat = {**state.poses, "block": matrix(np.zeros((4, 4)))}
    wrong = {
        "it has no action": replace(plan, actions=()),
        "joints": replace(plan, joints=plan.joints[::-1]),
        "ghost": replace(plan, actions=(replace(first, events=(ghost,)),)),
        "crane": replace(plan, actions=(replace(first, events=(crane,)),)),
        "parts": replace(plan, actions=(first, replace(first, start=replace(state, poses={})))),
        "hands": replace(plan, actions=(replace(first, motion=replace(motion, openings={})),)),
        "samples": replace(plan, actions=(replace(first, motion=replace(motion, positions=motion.positions[1:])),)),
        "increase from 0": replace(plan, actions=(replace(first, motion=replace(motion, times=())),)),
        "carries itself": replace(plan, actions=(replace(first, start=replace(state, attached=around)),)),
        "no rigid pose": replace(plan, actions=(replace(first, start=replace(state, poses=flat)),)),
    }
    for words, other in wrong.items():
        with pytest.raises(InputError, match=words):
            film(other, robot, RATE)
