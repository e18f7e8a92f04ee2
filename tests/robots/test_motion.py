"""Motions: ends, limits, collisions by an independent engine, straightness, grips, reasons of failure."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from reference import Reference

from kumitate.errors import BlockedError, InputError, NoPathError, StartInCollisionError, UnreachableLineError
from kumitate.robots.grip import plan_grip
from kumitate.robots.library import load_robot
from kumitate.robots.motion import Search, plan_motion
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact
from kumitate.robots.straight import INSERTION, LineTolerance, plan_linear
from kumitate.robots.timing import time_motion
from kumitate.transforms import pose, pose_distance

TOP = -0.05


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage", {"left": "robotiq_2f85", "right": "robotiq_2f85"})


@pytest.fixture(scope="module")
def shop(robot):
    """A Nextage at a table with a wall between its hands and a block before the left one."""
    bodies = [
        Body.box("table", [0.3, 1.32, 0.02], fixed=True),
        Body.box("wall", [0.2, 0.02, 0.25], fixed=True),
        Body.box("block", [0.04, 0.04, 0.06]),
    ]
    scene = Scene.of(robot, bodies)
    poses = {
        "table": pose([0.4, 0.0, TOP - 0.01]),
        "wall": pose([0.45, 0.0, TOP + 0.1251]),
        "block": pose([0.4, 0.25, TOP + 0.0301]),
    }
    return scene, scene.state(poses)


def top_down(xyz, turn=0.0):
    """A hand pose (4, 4) that looks straight down."""
    return pose(xyz, [np.pi, 0.0, turn])


def reach(scene, state, arm, hand_pose, opening):
    """A state with the hand of ``arm`` at a pose, by the first free answer of inverse kinematics."""
    for joints in scene.robot.arms[arm].solve_ik(hand_pose, opening).q:
        q = state.q.copy()
        q[scene.robot.arms[arm].indices] = joints
        found = state.with_q(q).with_opening(arm, opening)
        if not scene.touching(found):
            return found
    raise AssertionError("the test's pose is out of reach")


def test_a_free_motion_starts_and_ends_where_asked_and_touches_nothing_in_between(shop):
    scene, state = shop
    left = reach(scene, state, "left", top_down([0.4, 0.12, 0.05]), 0.085)
    goal = reach(scene, left, "right", top_down([0.4, -0.12, 0.05]), 0.085)
    path = plan_motion(scene, state, goal.q, ["left", "right"], seed=3)
    np.testing.assert_array_equal(path[0], state.q)
    np.testing.assert_array_equal(path[-1], goal.q)
    trajectory = time_motion(scene, state, path, ["left", "right"])
    assert (trajectory.peak_velocity() <= scene.robot.velocity * 1.001).all()
    assert (trajectory.peak_acceleration() <= scene.robot.acceleration * 1.001).all()
    reference = Reference(scene)
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 1500))
    assert [reference.touching(state, q) for q in samples if reference.touching(state, q)] == []


def test_the_reference_sees_a_motion_through_the_wall(shop):
    scene, state = shop
    goal = reach(scene, state, "left", top_down([0.4, 0.12, 0.02]), 0.085)
    across = reach(
        Scene.of(scene.robot, []), Scene.of(scene.robot, []).state({}), "left", top_down([0.4, -0.12, 0.02]), 0.085
    )
    reference = Reference(scene)
    straight = goal.q + np.linspace(0.0, 1.0, 200)[:, None] * (across.q - goal.q)
    assert any(reference.touching(state, q) for q in straight)


def test_only_the_arms_asked_for_move_and_the_same_seed_gives_the_same_path(shop):
    scene, state = shop
    goal = reach(scene, state, "left", top_down([0.4, 0.12, 0.05]), 0.085)
    path = plan_motion(scene, state, goal.q, ["left"], seed=5)
    still = np.setdiff1d(np.arange(len(state.q)), scene.robot.indices(["left"]))
    np.testing.assert_array_equal(path[:, still], np.tile(state.q[still], (len(path), 1)))
    np.testing.assert_array_equal(path, plan_motion(scene, state, goal.q, ["left"], seed=5))


def test_any_of_several_goals_will_do_and_blocked_ones_are_passed_over(shop):
    scene, state = shop
    free = reach(scene, state, "left", top_down([0.4, 0.12, 0.05]), 0.085)
    bare = Scene.of(scene.robot, [])
    blocked = reach(bare, bare.state({}), "left", top_down([0.4, 0.3, TOP - 0.02]), 0.085)
    path = plan_motion(scene, state, [blocked.q, free.q], ["left"], seed=1)
    np.testing.assert_array_equal(path[-1], free.q)
    with pytest.raises(StartInCollisionError, match="table"):
        plan_motion(scene, state, blocked.q, ["left"], seed=1)
    with pytest.raises(StartInCollisionError, match="start"):
        plan_motion(scene, state.with_q(blocked.q), free.q, ["left"], seed=1)


def test_a_search_that_may_not_go_on_ends_and_names_what_was_in_the_way(robot):
    scene = Scene.of(robot, [Body.box("fence", [0.4, 0.02, 0.15], fixed=True)])
    state = scene.state({"fence": pose([0.4, 0.26, TOP + 0.075])})
    start = reach(scene, state, "left", top_down([0.38, 0.42, 0.0]), 0.085)
    goal = reach(scene, state, "left", top_down([0.38, 0.1, 0.0]), 0.085)
    with pytest.raises(NoPathError, match="40 checked states") as caught:
        plan_motion(scene, start, goal.q, ["left"], seed=0, most_checks=40)
    assert all("fence" in pair for pair, _ in caught.value.blocking[:1])
    assert caught.value.blocking
    path = plan_motion(scene, start, goal.q, ["left"], seed=0)
    reference = Reference(scene)
    steps = np.linspace(0, len(path) - 1, 2000)
    fine = np.array([np.interp(steps, np.arange(len(path)), column) for column in path.T]).T
    assert [reference.touching(state, q) for q in fine if reference.touching(state, q)] == []


@pytest.mark.parametrize("tolerance", [LineTolerance(), INSERTION])
def test_a_straight_motion_keeps_its_line_after_timing_too(shop, tolerance):
    scene, state = shop
    start = reach(scene, state, "left", top_down([0.42, 0.25, 0.16]), 0.085)
    end = top_down([0.42, 0.25, 0.06]) @ pose([0.02, 0.0, 0.0], [0.0, 0.0, 0.3])
    path = plan_linear(scene, start, "left", end, tolerance=tolerance)
    trajectory = time_motion(scene, start, path, ["left"], line=tolerance)
    samples = trajectory.sample(np.linspace(0.0, trajectory.duration, 400))
    hands = np.array([scene.robot.hand_pose("left", q, 0.085) for q in samples])
    first = scene.robot.hand_pose("left", start.q, 0.085)
    way = end[:3, 3] - first[:3, 3]
    share = np.clip((hands[:, :3, 3] - first[:3, 3]) @ way / (way @ way), 0.0, 1.0)
    assert (np.diff(share) >= -1e-6).all()
    shifts = np.linalg.norm(hands[:, :3, 3] - first[:3, 3] - share[:, None] * way, axis=1)
    turn = pin.log3(first[:3, :3].T @ end[:3, :3])
    ideal = np.array([pose() for _ in share])
    for i, part in enumerate(share):
        ideal[i, :3, :3] = first[:3, :3] @ pin.exp3(part * turn)
    angles = pose_distance(hands * np.array([1, 1, 1, 0.0]) + np.eye(4) * [0, 0, 0, 1.0], ideal)[1]
    assert shifts.max() <= tolerance.position
    assert angles.max() <= tolerance.angle
    distance, angle = pose_distance(hands[-1], end)
    assert distance < 1e-5
    assert angle < 1e-5
    assert np.abs(np.diff(samples, axis=0)).max() < 0.05


def test_a_straight_motion_into_the_table_is_blocked_and_says_by_what(shop):
    scene, state = shop
    start = reach(scene, state, "left", top_down([0.42, 0.35, 0.10]), 0.085)
    with pytest.raises(BlockedError) as caught:
        plan_linear(scene, start, "left", top_down([0.42, 0.35, TOP - 0.02]))
    assert any("table" in pair for pair in caught.value.pairs)
    assert 0.3 < caught.value.share < 1.0


def test_a_straight_motion_out_of_reach_tells_how_far_it_comes(shop):
    scene, state = shop
    start = reach(scene, state, "left", top_down([0.42, 0.25, 0.2]), 0.085)
    with pytest.raises(UnreachableLineError) as caught:
        plan_linear(scene, start, "left", top_down([1.4, 0.25, 0.2]))
    assert 0.0 <= caught.value.reached < caught.value.length == pytest.approx(0.98, abs=1e-3)


def test_a_held_part_is_part_of_what_moves(shop):
    scene, state = shop
    grasp = reach(scene, state, "left", top_down([0.4, 0.25, TOP + 0.045]), 0.085)
    sides = [
        Contact("block", f"left/{name}_inner_finger", sign * np.array([1.0, 0.0, 0.0]))
        for name, sign in (("left", -1), ("right", 1))
    ]
    openings = plan_grip(scene, grasp.with_contacts(sides), "left", 0.04)
    assert openings[0] == 0.085
    assert openings[-1] == 0.04
    held = scene.attach(grasp.with_opening("left", 0.04).with_contacts(sides), "block", "left")
    hand = scene.robot.hand_pose("left", held.q, 0.04)
    up = hand.copy()
    up[2, 3] += 0.1
    path = plan_linear(scene, held, "left", up)
    lifted = held.with_q(path[-1])
    np.testing.assert_allclose(scene.world_from_body(lifted, "block"), pose([0.4, 0.25, TOP + 0.1301]), atol=1e-5)
    into_wall = up.copy()
    into_wall[:3, 3] += [0.03, -0.24, -0.03]
    with pytest.raises(BlockedError) as caught:
        plan_linear(scene, lifted, "left", into_wall)
    assert any("wall" in pair for pair in caught.value.pairs)


def test_fingers_that_close_on_something_in_between_are_blocked(shop):
    scene, state = shop
    grasp = reach(scene, state, "left", top_down([0.4, 0.25, TOP + 0.045]), 0.085)
    with pytest.raises(BlockedError) as caught:
        plan_grip(scene, grasp, "left", 0.03)
    assert any("block" in pair for pair in caught.value.pairs)
    with pytest.raises(InputError, match="stroke"):
        plan_grip(scene, grasp, "left", 0.1)


def test_what_is_no_goal_is_refused(shop):
    scene, state = shop
    other = state.q.copy()
    other[scene.robot.indices(["right"])] += 0.1
    none = scene.robot.with_joints(state.q, "left", np.zeros((0, 6)))
    for goals, arms, seed, message in (
        (np.full(15, 7.0), ["left"], 0, "goal: joint"),
        (none, ["left"], 0, "goal: there is none"),
        ([], ["left"], 0, "goal"),
        (np.zeros(3), ["left"], 0, "goal"),
        (["far"] * 15, ["left"], 0, "goal: no array of numbers"),
        (other, ["left"], 0, "no moving arm"),
        (state.q, [], 0, "arms"),
        (state.q, "left", 0, "arms"),
        (state.q, ["left", "left"], 0, "arms"),
        (state.q, ["left"], -1, "seed"),
        (state.q, ["left"], 1.5, "seed"),
    ):
        with pytest.raises(InputError, match=message):
            plan_motion(scene, state, goals, arms, seed=seed)


def test_the_nearest_goal_is_tried_first(robot):
    scene = Scene.of(robot, [])
    state = scene.state({})
    near, far = state.q.copy(), state.q.copy()
    near[robot.arms["left"].indices[0]] += 0.1
    far[robot.arms["left"].indices[0]] += 0.4
    for goals in ([near, far], [far, near]):
        path = plan_motion(scene, state, goals, ["left"], seed=0)
        np.testing.assert_array_equal(path[-1], near)


def test_ends_a_rounding_outside_the_limits_are_reached(robot):
    scene = Scene.of(robot, [])
    state, joint = scene.state({}), robot.arms["left"].indices[5]
    goal = state.q.copy()
    goal[joint] = robot.upper[joint] + 5e-7
    path = plan_motion(scene, state, goal, ["left"], seed=0)
    np.testing.assert_array_equal(path[-1], goal)


def test_detours_are_shortened_where_the_straight_way_is_free_and_left_where_it_is_not(shop):
    scene, state = shop
    robot, checker = scene.robot, scene.checker(state)
    arms = [robot.arms["left"].indices]
    search = Search(checker, state.q, arms, robot.lower, robot.upper)
    goal = reach(scene, state, "left", top_down([0.4, 0.12, 0.05]), 0.085).q
    detour = np.stack([state.q, state.q, goal])
    detour[1, arms[0][5]] += 1.0
    length = np.linalg.norm(np.diff(search.shortened(detour, 0.02, 0), axis=0), axis=1).sum()
    assert length < 1.1 * np.linalg.norm(goal - state.q)
    # Over the wall: the straight way is shorter, but not free.
    over = reach(scene, state, "left", top_down([0.4, 0.12, 0.02]), 0.085)
    across = reach(scene, state, "left", top_down([0.4, -0.12, 0.02]), 0.085)
    path = plan_motion(scene, over, across.q, ["left"], seed=0)
    shorter = Search(checker, over.q, arms, robot.lower, robot.upper).shortened(path, 0.02, 3)
    assert all(checker.free(q) for q in shorter)
