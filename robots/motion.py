"""Joint paths free of collision: free motions, straight ones, and the opening and closing of hands.

A search may step coarsely; a path is returned only when it is checked so finely that no point of the robot, or of what
it carries, moves farther than a stated bound between two checks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou
from scipy.spatial.transform import Rotation

from ..errors import BlockedError, NoPathError, PlanningError, StartInCollisionError, UnreachableLineError
from ..transforms import Array, checked_poses, compose, pose_distance, rotation_angle
from .collision import Pair, StateChecker
from .robot import Arm
from .scene import Scene
from .state import SceneState
from .sweep import Sweep
from .trajectory import Trajectory, time_path

FREE_STEP = 5e-3  # m between two checks of a free motion
LINEAR_STEP = 1e-3  # m between two checks of a straight motion, and of closing fingers
SEARCH_STEP = 0.1  # rad (norm over the joints) between two checks of the search
MOST_CHECKS = 40_000  # states that one search may check
_PATH_SHARE = 0.5  # of a line's tolerance; the rest is for the timing of the path
_SHORTCUTS = 60
_CORNER_CUTS = (0.1, 0.02, 4e-3, 0.0)  # rad
_LINE_CUTS = (5e-4, 1e-4, 2e-5)  # rad
_ROUNDS = 4

ou.setLogLevel(ou.LogLevel.LOG_NONE)


@dataclass(frozen=True, eq=False)
class LineTolerance:
    """How far a straight motion may leave its line: position [m] and angle [rad]."""

    position: float = 1e-3
    angle: float = float(np.deg2rad(1.0))


_LINE_STEP = LineTolerance(10e-3, float(np.deg2rad(3.0)))  # between waypoints at first
INSERTION = LineTolerance(0.2e-3, float(np.deg2rad(0.2)))


def check_path(
    scene: Scene, state: SceneState, path: Array, arms: Sequence[str], step: float, working: Collection[str] = ()
) -> None:
    """Check every state along ``path``, spaced so that nothing moves farther than ``step`` [m] from check to check.

    Args:
        scene: The scene.
        state: The state in which the arms move; its configuration does not matter.
        path: Configurations (k, nq).
        arms: The arms that move.
        step: Farthest way of any point between two checks [m].
        working: Arms whose hands need keep no margins.

    Raises:
        BlockedError: Something touches; the error names it, and where along the path.
    """
    checker = scene.checker(state, working)
    fine = Sweep(scene, state, arms).refined(path, step)
    blocked = _first_blocked(checker, fine)
    if blocked is not None:
        raise BlockedError(checker.touching(fine[blocked]), blocked / max(len(fine) - 1, 1))


def plan_motion(
    scene: Scene,
    state: SceneState,
    goals: npt.ArrayLike,
    arms: Sequence[str],
    *,
    seed: int,
    most_checks: int = MOST_CHECKS,
) -> Array:
    """A free motion of ``arms`` from the state's configuration to any of ``goals``.

    RRT-Connect on the joints of the arms, shortened, then checked as `check_path` does with 5 mm; a path that fails
    there is searched again with finer steps.

    Args:
        scene: The scene.
        state: Where everything is; everything but the arms stays there.
        goals: Configurations (g, nq) or (nq,), alike but for the joints of the arms.
        arms: The arms that may move.
        seed: Seed of the search; the same seed gives the same path.
        most_checks: States that the search may check.

    Returns:
        Waypoints (k, nq), the first of them the state's configuration.

    Raises:
        InputError: A goal is no configuration within the limits.
        StartInCollisionError: The start collides, or every goal does.
        NoPathError: The search came to its end; the error names the bodies that were in the way.
    """
    robot = scene.robot
    start = robot.checked_configuration(state.q, "start")
    ends = [robot.checked_configuration(q, "goal") for q in np.atleast_2d(np.asarray(goals, dtype=float))]
    checker = scene.checker(state)
    if not checker.free(start):
        raise StartInCollisionError("the start", checker.touching(start))
    free_ends = [q for q in ends if checker.free(q)]
    if not free_ends:
        raise StartInCollisionError("every goal", checker.touching(ends[0]))
    sweep = Sweep(scene, state, arms)
    search = _Search(checker, start, robot.indices(arms), robot.lower, robot.upper, most_checks)
    for attempt in range(_ROUNDS):
        path = search.run(free_ends, SEARCH_STEP / 2**attempt, seed + attempt)
        if _first_blocked(checker, sweep.refined(path, FREE_STEP)) is None:
            return path
    raise NoPathError("no path passed the fine check", search.blocking())


def plan_linear(
    scene: Scene,
    state: SceneState,
    arm: str,
    world_from_hand: Array,
    *,
    tolerance: LineTolerance | None = None,
    working: Collection[str] = (),
) -> Array:
    """A straight motion of one hand from where the state has it to ``world_from_hand`` (4, 4), keeping the branch.

    Args:
        scene: The scene.
        state: Where everything is; everything but the arm stays there.
        arm: The arm that moves; what it holds moves with it.
        world_from_hand: Pose of the hand at the end, at the hand's opening in ``state``.
        tolerance: How far the motion may leave the line; 1 mm and 1 degree unless given.
        working: Arms whose hands need keep no margins, besides ``arm``.

    Returns:
        Waypoints (k, nq), the first of them the state's configuration.

    Raises:
        InputError: The pose is not rigid, or the arm has no hand.
        UnreachableLineError: Inverse kinematics does not follow the line to its end, or not closely enough.
        BlockedError: Something touches on the way.
    """
    allowed = tolerance or LineTolerance()
    mounted = scene.robot.arm(arm)
    tip_from_hand = mounted.flange_from_hand(state.openings.get(arm, 0.0))[0]
    start = mounted.chain.forward(state.q[None, mounted.indices])[0]
    ends = np.stack([start @ tip_from_hand, checked_poses(world_from_hand, "end of the line")])
    length, angle = (float(value) for value in pose_distance(*ends))
    count = int(np.ceil(max(length / _LINE_STEP.position, angle / _LINE_STEP.angle, 1.0)))
    for _ in range(_ROUNDS):
        joints, reached = mounted.track(
            state.q[mounted.indices], _on_line(ends, np.linspace(0.0, 1.0, count + 1)), state.openings.get(arm, 0.0)
        )
        if reached <= count:
            raise UnreachableLineError(arm, length * max(reached - 1, 0) / count, length)
        between = mounted.chain.forward((joints[1:] + joints[:-1]) / 2.0) @ tip_from_hand
        if _within(between, ends, allowed, _PATH_SHARE):
            path = np.tile(state.q, (count + 1, 1))
            path[:, mounted.indices] = joints
            check_path(scene, state, path, [arm], LINEAR_STEP, {arm, *working})
            return path
        count *= 2
    raise UnreachableLineError(arm, 0.0, length)


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
        BlockedError: The curve touches something however closely it follows the path.
        UnreachableLineError: The curve leaves the line however closely it follows the path.
    """
    robot = scene.robot
    step = FREE_STEP if line is None else LINEAR_STEP
    fault: PlanningError = NoPathError("no curve was tried")
    for deviation in _CORNER_CUTS if line is None else _LINE_CUTS:
        trajectory = time_path(
            path, robot.joint_names, robot.velocity, robot.acceleration, speed=speed, max_deviation=deviation
        )
        curve = trajectory.sample(_between(trajectory.times))
        if line is not None and not _on_its_line(robot.arm(arms[0]), state, path, curve, line):
            fault = UnreachableLineError(arms[0], 0.0, 0.0)
            continue
        try:
            check_path(scene, state, curve, arms, step, working)
        except BlockedError as error:
            fault = error
        else:
            return trajectory
    raise fault


def plan_grip(scene: Scene, state: SceneState, arm: str, opening: float) -> Array:
    """Openings (k,) from that of the hand of ``arm`` in ``state`` to ``opening`` [m], checked on the way.

    No fingertip moves farther than 1 mm between two checks. Contacts of the fingers that the state allows excuse
    touching as everywhere: within the contact tolerance.

    Raises:
        InputError: The opening lies outside the stroke, or the arm has no hand.
        BlockedError: A finger touches something on the way.
    """
    scene.robot.arm(arm).flange_from_hand(opening)
    start = state.openings[arm]
    count = max(int(np.ceil(abs(opening - start) / LINEAR_STEP)), 1)
    openings = np.linspace(start, opening, count + 1)
    for i, value in enumerate(openings):
        checker = scene.checker(state.with_opening(arm, value), {arm})
        if not checker.free(state.q):
            raise BlockedError(checker.touching(state.q), i / count)
    return openings


class _Search:
    """RRT-Connect over the joints of some arms, with the count of what was in the way."""

    def __init__(
        self, checker: StateChecker, start: Array, indices: np.ndarray, lower: Array, upper: Array, most: int
    ) -> None:
        self._checker, self._start, self._indices = checker, start, indices
        self._lower, self._upper = lower[indices], upper[indices]
        self._q = start.copy()
        self._most = self._left = most
        self._blocking: Counter[Pair] = Counter()

    def blocking(self) -> list[tuple[Pair, int]]:
        """Touching pairs met by the search, most frequent first."""
        return self._blocking.most_common()

    def run(self, ends: Sequence[Array], step: float, seed: int) -> Array:
        """A shortened path (k, nq) to one of ``ends``, every state of it free at steps of ``step`` [rad]."""
        dimension = len(self._indices)
        space = ob.RealVectorStateSpace(dimension)
        bounds = ob.RealVectorBounds(dimension)
        for i in range(dimension):
            bounds.setLow(i, float(self._lower[i]))
            bounds.setHigh(i, float(self._upper[i]))
        space.setBounds(bounds)
        ou.RNG.setSeed(seed + 1)
        setup = og.SimpleSetup(space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(self._free)
        information.setStateValidityCheckingResolution(step / space.getMaximumExtent())
        setup.setStartState(_state(space, self._start[self._indices]))
        goals = ob.GoalStates(information)
        for end in ends:
            goals.addState(_state(space, end[self._indices]))
        setup.setGoal(goals)
        setup.setPlanner(og.RRTConnect(information))
        setup.solve(ob.PlannerTerminationCondition(lambda: self._left <= 0))
        if not setup.haveExactSolutionPath():
            raise NoPathError(f"no path within {self._most} checked states", self.blocking())
        path = setup.getSolutionPath()
        simplifier = og.PathSimplifier(information)
        simplifier.reduceVertices(path)
        simplifier.partialShortcutPath(path, _SHORTCUTS, _SHORTCUTS)
        simplifier.reduceVertices(path)
        waypoints = np.tile(self._start, (path.getStateCount(), 1))
        dimension = len(self._indices)
        waypoints[:, self._indices] = [path.getState(i)[0:dimension] for i in range(len(waypoints))]
        return waypoints

    def _free(self, state: Sequence[float]) -> bool:
        self._left -= 1
        self._q[self._indices] = state[0 : len(self._indices)]
        pair = self._checker.first_touching(self._q)
        if pair is not None:
            self._blocking[pair] += 1
        return pair is None


def _state(space: ob.RealVectorStateSpace, values: Array) -> ob.State:
    state = space.allocState()
    for i, value in enumerate(values):
        state[i] = float(value)
    return state


def _first_blocked(checker: StateChecker, path: Array) -> int | None:
    """The first configuration of ``path`` (k, nq) that is not free."""
    return next((i for i, q in enumerate(path) if not checker.free(q)), None)


def _on_line(ends: Array, shares: Array) -> Array:
    """Poses (n, 4, 4) on the straight line between the two poses ``ends`` (2, 4, 4), at ``shares`` (n,) of it."""
    turn = Rotation.from_matrix(ends[0, :3, :3].T @ ends[1, :3, :3]).as_rotvec()
    turned = ends[0, :3, :3] @ Rotation.from_rotvec(shares[:, None] * turn).as_matrix()
    return compose(turned, ends[0, :3, 3] + shares[:, None] * (ends[1, :3, 3] - ends[0, :3, 3]))


def _on_its_line(arm: Arm, state: SceneState, path: Array, curve: Array, line: LineTolerance) -> bool:
    """Whether the hand keeps the line between the ends of ``path`` (k, nq) all along ``curve`` (n, nq)."""
    tip_from_hand = arm.flange_from_hand(state.openings.get(arm.name, 0.0))[0]
    ends = arm.chain.forward(path[[0, -1]][:, arm.indices]) @ tip_from_hand
    return _within(arm.chain.forward(curve[:, arm.indices]) @ tip_from_hand, ends, line, 1.0)


def _between(times: Array) -> Array:
    """``times`` (k,) with three more between each two."""
    knots = np.arange(len(times))
    return np.interp(np.linspace(0, len(times) - 1, 4 * (len(times) - 1) + 1), knots, times)


def _within(hands: Array, ends: Array, allowed: LineTolerance, share: float) -> bool:
    """Whether poses (n, 4, 4) lie on the line between ``ends`` (2, 4, 4), but for a ``share`` of what is allowed."""
    way, turn = ends[1, :3, 3] - ends[0, :3, 3], float(pose_distance(*ends)[1])
    if np.linalg.norm(way) > allowed.position:
        shares = (hands[:, :3, 3] - ends[0, :3, 3]) @ way / (way @ way)
    else:
        shares = rotation_angle(ends[0, :3, :3].T @ hands[:, :3, :3]) / max(turn, allowed.angle)
    shifts, turns = pose_distance(hands, _on_line(ends, np.clip(shares, 0.0, 1.0)))
    return bool((shifts <= share * allowed.position).all() and (turns <= share * allowed.angle).all())
