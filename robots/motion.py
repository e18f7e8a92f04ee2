"""Free motions: RRT-Connect, shortened, and checked by how far bodies really move.

The search steps coarsely; a path is returned only when no point of the robot, or of what it carries, moves farther than
5 mm between two checks.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from ..errors import InputError, NoPathError, StartInCollisionError
from ..transforms import Array, checked_numbers
from .collision import Pair, StateChecker
from .paths import FREE_STEP, PathCheck
from .scene import Scene
from .state import SceneState
from .sweep import split

SEARCH_STEP = 0.15  # rad (norm over the joints) between two checks of the search
MOST_CHECKS = 40_000  # states that one search may check
_NEAR = 0.7  # rad or m that a joint may leave the straight way in the first searches
_SHORTCUTS = 120
_SHORTENING_SHARES = (0.5, 0.1)  # of the step of the search
_WORTHWHILE = 1e-3  # rad that a shortcut must save
_ROUNDS = 4

ou.setLogLevel(ou.LogLevel.LOG_NONE)


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

    RRT-Connect on the joints of the arms, at first near the straight way to the nearest goal and with the arms in
    turns, shortened, then checked as `PathCheck` does; a path that fails there is searched again with finer steps.

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
        InputError: There is no goal, a goal is no configuration within the limits or differs in joints of other arms,
            or the seed is no natural number.
        StartInCollisionError: The start collides, or every goal does.
        NoPathError: The search came to its end; the error names the bodies that were in the way.
    """
    robot = scene.robot
    start = robot.checked_configuration(state.q, "start")
    ends = [robot.checked_configuration(q, "goal") for q in np.atleast_2d(checked_numbers(goals, "goal"))]
    if not ends:
        raise InputError("goal", "there is none", "give at least one configuration: did inverse kinematics answer?")
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise InputError("seed", f"{seed!r} is no seed", "give a whole number from 0 upwards")
    moving = robot.indices(arms)
    still = np.setdiff1d(np.arange(len(start)), moving)
    if any((q[still] != start[still]).any() for q in ends):
        raise InputError("goal", "a joint of no moving arm differs from the start", f"move only {', '.join(arms)}")
    checker = scene.checker(state)
    if not checker.free(start):
        raise StartInCollisionError("the start", checker.touching(start))
    free_ends = [q for q in ends if checker.free(q)]
    if not free_ends:
        raise StartInCollisionError("every goal", checker.touching(ends[0]))
    free_ends.sort(key=lambda q: float(np.linalg.norm(q - start)))
    check = PathCheck(scene, state, arms, FREE_STEP)
    search = Search(checker, start, [robot.arm(arm).indices for arm in arms], robot.lower, robot.upper)
    for attempt in range(_ROUNDS):
        step = SEARCH_STEP / 2**attempt
        path = search.path(free_ends, step, seed + attempt, most_checks)
        if path is None:
            raise NoPathError(f"no path within {most_checks} checked states", search.blocking())
        for share in _SHORTENING_SHARES:
            shorter = search.shortened(path, share * step, seed + attempt)
            if check.blocked(shorter) is None:
                return shorter
        if check.blocked(path) is None:
            return path
    raise NoPathError("no path passed the fine check", search.blocking())


class Search:
    """RRT-Connect over the joints of some arms, with the count of what was in the way."""

    def __init__(
        self, checker: StateChecker, start: Array, arms: Sequence[npt.NDArray[np.intp]], lower: Array, upper: Array
    ) -> None:
        self._checker, self._start, self._arms = checker, start, arms
        self._all = np.concatenate(arms)
        self._lower, self._upper = lower, upper
        self._left = 0
        self._blocking: Counter[Pair] = Counter()

    def blocking(self) -> list[tuple[Pair, int]]:
        """Touching pairs met by the search, most frequent first."""
        return self._blocking.most_common()

    def path(self, ends: Sequence[Array], step: float, seed: int, most: int) -> Array | None:
        """A path (k, nq) to one of ``ends``, free at steps of ``step`` [rad]; None after ``most`` checked states.

        Simple searches come first, each with a share of the checks: near the straight way to the nearest end before
        everywhere, arms in turns before all at once. They find most paths much sooner, and shorter ones.
        """
        self._left = most
        for room, share in ((_NEAR, most // 20), (np.inf, most // 8)):
            for order in itertools.permutations(self._arms):
                path = self._in_turns(ends[0], order, step, seed, share, room)
                if path is not None:
                    return path
            if len(self._arms) > 1:
                path = self._connected(self._start, ends[:1], self._all, step, seed, share, room)
                if path is not None:
                    return path
        return self._connected(self._start, ends, self._all, step, seed, self._left, np.inf)

    def _in_turns(
        self, end: Array, order: Sequence[npt.NDArray[np.intp]], step: float, seed: int, most: int, room: float
    ) -> Array | None:
        """A path (k, nq) to ``end`` on which the arms move one after the other."""
        path = self._start[None]
        for joints in order:
            halfway = path[-1].copy()
            halfway[joints] = end[joints]
            if not self._checker.free(halfway):
                return None
            stretch = self._connected(path[-1], [halfway], joints, step, seed, most, room)
            if stretch is None:
                return None
            path = np.concatenate([path, stretch[1:]])
        return path

    def _connected(
        self,
        start: Array,
        ends: Sequence[Array],
        joints: npt.NDArray[np.intp],
        step: float,
        seed: int,
        most: int,
        room: float,
    ) -> Array | None:
        """A path (k, nq) by RRT-Connect from ``start`` to one of ``ends``, moving ``joints`` only.

        It looks where no joint is farther than ``room`` [rad or m] from the range between start and ends.
        """
        both = np.concatenate([start[None], ends])[:, joints]
        # A start or goal may lie a rounding outside the limits; outside the bounds the search would wait for ever.
        lowest, highest = both.min(axis=0), both.max(axis=0)
        lower = np.minimum(np.maximum(self._lower[joints], lowest - room), lowest)
        upper = np.maximum(np.minimum(self._upper[joints], highest + room), highest)
        dimension, q, floor = len(joints), start.copy(), max(self._left - most, 0)

        def free(state: Sequence[float]) -> bool:
            self._left -= 1
            q[joints] = state[0:dimension]
            pair = self._checker.first_touching(q)
            if pair is not None:
                self._blocking[pair] += 1
            return pair is None

        space = ob.RealVectorStateSpace(dimension)
        bounds = ob.RealVectorBounds(dimension)
        for i in range(dimension):
            bounds.setLow(i, float(lower[i]))
            bounds.setHigh(i, float(upper[i]))
        space.setBounds(bounds)
        ou.RNG.setSeed(int(seed) + 1)
        setup = og.SimpleSetup(space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(free)
        information.setStateValidityCheckingResolution(step / space.getMaximumExtent())
        setup.setStartState(_state(space, start[joints]))
        goals = ob.GoalStates(information)
        for end in ends:
            goals.addState(_state(space, end[joints]))
        setup.setGoal(goals)
        setup.setPlanner(og.RRTConnect(information))
        setup.solve(ob.PlannerTerminationCondition(lambda: self._left <= floor))
        if not setup.haveExactSolutionPath():
            return None
        found = setup.getSolutionPath()
        path = np.tile(start, (found.getStateCount(), 1))
        path[:, joints] = [found.getState(i)[0:dimension] for i in range(len(path))]
        return path

    def shortened(self, path: Array, step: float, seed: int) -> Array:
        """``path`` (k, nq) with stretches made straight, for all joints or those of one arm, where that is free.

        While one arm goes straight, the others keep their motion (partial shortcuts, Geraerts and Overmars 2007); so
        arms that moved in turns come to move together.
        """
        rng = np.random.default_rng(seed)
        subsets = [self._all, *self._arms]
        path = _resampled(path, step)
        for _ in range(_SHORTCUTS):
            if len(path) < 3:
                break
            first, last = sorted(rng.choice(len(path), 2, replace=False))
            which = rng.integers(len(subsets))
            stretch = path[[first, last]] if which == 0 else path[first : last + 1].copy()
            joints = subsets[which]
            stretch[:, joints] = np.linspace(stretch[0, joints], stretch[-1, joints], len(stretch))
            stretch = _resampled(stretch, step)
            shorter = _length(stretch) < _length(path[first : last + 1]) - _WORTHWHILE
            if shorter and all(self._checker.free(q) for q in stretch[1:-1]):
                path = np.concatenate([path[:first], stretch, path[last + 1 :]])
        return path


def _length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _resampled(path: Array, step: float) -> Array:
    """``path`` (k, nq) with waypoints put between until none are farther apart than ``step`` [rad], none alike."""
    lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
    path = path[np.concatenate([[True], lengths > 0.0])]
    return split(path, np.ceil(lengths[lengths > 0.0] / step).astype(int))


def _state(space: ob.RealVectorStateSpace, values: Array) -> ob.State:
    state = space.allocState()
    for i, value in enumerate(values):
        state[i] = float(value)
    return state
