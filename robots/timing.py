"""Timing joint paths, and checking again the curves that they become."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..errors import BlockedError, InputError, OffLineError, PlanningError
from ..transforms import Array, checked_numbers
from .arm import Arm
from .paths import FREE_STEP, LINEAR_STEP, PathCheck
from .scene import Scene
from .state import SceneState
from .straight import LineTolerance, on_line
from .trajectory import Trajectory, time_path

_CORNER_CUTS = (0.1, 0.02, 4e-3, 0.0)  # rad
_LINE_CUTS = (5e-4, 1e-4, 2e-5)  # rad


def time_motion(
    scene: Scene,
    state: SceneState,
    path: Array,
    arms: Sequence[str],
    *,
    speed: float = 1.0,
    line: LineTolerance | None = None,
    working: Collection[str] = (),
) -> Trajectory:
    """A trajectory along ``path``, within the robot's limits, checked again on the curve that it is.

    Corners are cut by less and less until the curve is free (and, for a straight motion, on its line).

    Args:
        scene: The scene.
        state: The state in which the arms move.
        path: Waypoints (k, nq) as `plan_motion` and `plan_linear` return them.
        arms: The arms that move.
        speed: Share of the velocity limits to use, in (0, 1].
        line: For a straight motion of one arm, how far it may leave the line between its ends.
        working: Arms whose hands need keep no margins.

    Raises:
        InputError: A waypoint is no configuration within the limits, another joint than those of ``arms`` moves, or a
            line is asked of several arms.
        BlockedError: The curve touches something however closely it follows the path.
        OffLineError: The curve leaves the line however closely it follows the path.
    """
    robot = scene.robot
    still = np.setdiff1d(np.arange(robot.model.nq), robot.indices(arms))
    path = np.array([robot.checked_configuration(q, "path") for q in checked_numbers(path, "path")])
    if not len(path):
        raise InputError("path", "it has no waypoint", "give waypoints (k, nq)")
    if (path[:, still] != path[0, still]).any():
        raise InputError("path", "a joint of no moving arm moves", f"move only {', '.join(arms)}")
    if line is not None and len(arms) != 1:
        raise InputError("line", f"asked of {len(arms)} arms", "give the one arm that follows the line")
    check = PathCheck(scene, state, arms, FREE_STEP if line is None else LINEAR_STEP, working)
    fault: PlanningError
    for deviation in _CORNER_CUTS if line is None else _LINE_CUTS:
        trajectory = time_path(
            path, robot.joint_names, robot.velocity, robot.acceleration, speed=speed, max_deviation=deviation
        )
        curve = trajectory.sample(_between(trajectory.times))
        if line is not None and not _on_its_line(robot.arm(arms[0]), state, path, curve, line):
            fault = OffLineError(arms[0], line.position, line.angle)
            continue
        try:
            check.require_free(curve)
        except BlockedError as error:
            fault = error
        else:
            return trajectory
    raise fault


def _on_its_line(arm: Arm, state: SceneState, path: Array, curve: Array, line: LineTolerance) -> bool:
    """Whether the hand keeps the line between the ends of ``path`` (k, nq) all along ``curve`` (n, nq)."""
    tip_from_hand = arm.flange_from_hand(state.openings.get(arm.name, 0.0))[0]
    ends = arm.chain.forward(path[[0, -1]][:, arm.indices]) @ tip_from_hand
    return on_line(arm.chain.forward(curve[:, arm.indices]) @ tip_from_hand, ends, line, 1.0)


def _between(times: Array) -> Array:
    """``times`` (k,) with three more between each two."""
    knots = np.arange(len(times))
    return np.interp(np.linspace(0, len(times) - 1, 4 * (len(times) - 1) + 1), knots, times)
