"""Path checks: how closely they look, where, and for whom margins are left out."""

from __future__ import annotations

import numpy as np
import pytest

from kumitate.errors import BlockedError
from kumitate.robots.library import load_robot
from kumitate.robots.paths import FREE_STEP, PathCheck, _around
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Margins
from kumitate.transforms import pose


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage", {"left": "robotiq_2f85"})


def turn(robot, angle, count):
    """Waypoints (count, nq) that turn the left arm's first joint by ``angle`` from home."""
    path = np.tile(robot.home, (count, 1))
    path[:, robot.arms["left"].indices[0]] += np.linspace(0.0, angle, count)
    return path


@pytest.mark.parametrize("seed", range(8))
def test_a_wire_in_the_way_is_found_wherever_it_stands_between_two_checks(robot, seed):
    # The fingertip passes a wire of 0.6 mm: on the way there are states, 0.2 mm apart, in which they touch.
    rng = np.random.default_rng(seed)
    path = turn(robot, 0.3, 2)
    halfway = path[0] + rng.uniform(0.3, 0.7) * (path[1] - path[0])
    tip = robot.hand_pose("left", halfway, 0.085) @ pose([0.0, rng.uniform(-0.005, 0.005), 0.0])
    scene = Scene.of(robot, [Body.box("wire", [0.6e-3, 0.6e-3, 0.3], fixed=True)])
    side = scene.robot.hands["left"].hand_from_pad([0.085])[0, 0] @ pose([-0.002, 0.0, 0.0])
    state = scene.state({"wire": pose((tip @ side)[:3, 3])})
    assert scene.checker(state).free(path[0])
    assert scene.checker(state).free(path[1])
    found = PathCheck(scene, state, ["left"], FREE_STEP).blocked(path)
    assert found is not None
    assert 0.1 < found[1] < 0.9
    assert not scene.checker(state).free(found[0])


def test_a_path_is_blocked_where_the_error_says(robot):
    scene = Scene.of(robot, [Body.box("wall", [0.3, 0.01, 0.3], fixed=True)])
    path = turn(robot, 0.6, 3)
    stop = robot.hand_pose("left", path[1], 0.085)
    state = scene.state({"wall": pose(stop[:3, 3] + [0.0, 0.1, 0.0])})
    with pytest.raises(BlockedError) as caught:
        PathCheck(scene, state, ["left"], FREE_STEP).require_free(path)
    checker = scene.checker(state)
    at = path[0] + caught.value.share * (path[-1] - path[0])
    before = path[0] + (caught.value.share - 0.02) * (path[-1] - path[0])
    assert caught.value.pairs == checker.touching(at)
    assert checker.free(before)


def test_hands_at_work_need_keep_no_margins(robot):
    scene = Scene.of(robot, [Body.box("post", [0.02, 0.02, 0.1], fixed=True)], Margins(environment=0.02))
    ahead = robot.hand_pose("left", robot.home, 0.0) @ pose([0.0, 0.0, 0.014 + 0.05 + 0.008])
    state, path = scene.state({"post": ahead}, openings={"left": 0.0}), turn(robot, 0.01, 2)
    assert PathCheck(scene, state, ["left"], FREE_STEP).blocked(path) is not None
    assert PathCheck(scene, state, ["left"], FREE_STEP, {"left"}).blocked(path) is None


def test_doubtful_places_are_looked_at_from_the_place_before_to_the_place_after():
    marked = np.array([True, False, False, True, True, False, False, False, True])
    assert [(part.start, part.stop) for part in _around(marked)] == [(0, 2), (2, 6), (7, 10)]
    assert list(_around(np.zeros(4, dtype=bool))) == []
