"""Inverse kinematics for whole arrays of poses, and following lines of poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..transforms import Array, checked_poses
from .chain import Chain
from .ik_crossing import CrossingArm
from .ik_geometry import Rows
from .ik_newton import is_at, newton
from .ik_parallel import ParallelArm
from .ik_seeds import SeedSearch

_SAME = 1e-3  # answers whose joints all differ by less are one branch [rad or m]
_SAME_REDUNDANT = 0.1  # the same for arms of more than six joints, whose answers are a continuum
_AT_LIMIT = 1e-7  # rounding may put an answer this far outside a limit; it is moved onto it, then checked [rad or m]
_ROUNDING = 1e-9  # [rad]
_TURN = 2.0 * np.pi
_TRACK_ITERATIONS = 10


@dataclass(frozen=True, eq=False)
class IKSolutions:
    """Configurations that reach some of the targets, sorted by target.

    Attributes:
        q: (m, dof) configurations within the joint limits [rad or m].
        target: (m,) index of the target that each reaches.
        n_targets: How many targets were asked for.
    """

    q: Array
    target: Rows
    n_targets: int

    @property
    def solved(self) -> npt.NDArray[np.bool_]:
        """(n_targets,) whether there is an answer."""
        return self.counts > 0

    @property
    def counts(self) -> Rows:
        """(n_targets,) how many answers there are."""
        return np.bincount(self.target, minlength=self.n_targets)

    def of(self, i: int) -> Array:
        """Configurations (k, dof) that reach target ``i``."""
        start, end = np.searchsorted(self.target, [i, i + 1])
        return self.q[start:end]


@dataclass(frozen=True, eq=False)
class IKSolver:
    """Inverse kinematics of one arm, with its tables; call it with targets.

    Attributes:
        chain: The arm.
        family: What proposes configurations, by the geometry of the chain.
    """

    chain: Chain
    family: ParallelArm | CrossingArm | SeedSearch

    def __call__(self, world_from_tip: npt.ArrayLike) -> IKSolutions:
        """Configurations that put the tip at the targets.

        An arm with three parallel joints, or with the geometry of the Nextage, gets all branches within its limits;
        where an angle is free, as in an aligned wrist, one representative. Other arms get several branches that differ
        by more than 1e-3 rad, redundant ones by more than 0.1 rad. Where a joint's range exceeds a turn, every multiple
        that fits is an answer. Each is within 1e-6 m and 1e-6 rad of its target by forward kinematics.

        Args:
            world_from_tip: (n, 4, 4) or (4, 4) targets.

        Raises:
            InputError: The targets are no rigid poses.
        """
        goals = checked_poses(world_from_tip, "inverse kinematics: targets").reshape(-1, 4, 4)
        (near,) = np.nonzero(_within_reach(self.chain, goals))
        if not near.size:
            return IKSolutions(np.zeros((0, self.chain.dof)), near, len(goals))
        q, row = self.family(goals[near])
        q, target = _accepted(self.chain, q, near[row], goals)
        return IKSolutions(q, target, len(goals))


def make_solver(chain: Chain, seed: int = 0) -> IKSolver:
    """The solver that fits the geometry of ``chain``; a numerical one draws its library of starts from ``seed``."""
    return IKSolver(chain, ParallelArm.of(chain) or CrossingArm.of(chain) or SeedSearch.of(chain, seed))


def solve_ik(chain: Chain, world_from_tip: npt.ArrayLike, seed: int = 0) -> IKSolutions:
    """Inverse kinematics once; keep `make_solver` where the same arm is asked again. See `IKSolver.__call__`."""
    return make_solver(chain, seed)(world_from_tip)


def track(chain: Chain, q_start: Array, world_from_tip: Array, max_joint_step: float = 0.2) -> tuple[Array, Rows]:
    """Follow many lines of poses at once from given configurations, without changing the branch.

    Each step is Newton's method from the configuration before; with more than six joints it takes the shortest way. A
    line ends before the first pose that is not met within 1e-6 m and 1e-6 rad, or not without leaving the limits or
    moving a joint by more than ``max_joint_step``.

    Args:
        chain: The arm.
        q_start: (n, dof) configurations near the first poses.
        world_from_tip: (steps, n, 4, 4) poses along the lines.
        max_joint_step: Longest motion of a joint from pose to pose [rad or m].

    Returns:
        Configurations (steps, n, dof), standing still from where a line ends, and how many leading poses (n,) were met.

    Raises:
        InputError: Shapes that do not fit, or matrices that are no rigid poses.
    """
    goals = checked_poses(world_from_tip, "track: poses")
    q = np.array(q_start, dtype=float)
    if goals.ndim != 4 or q.shape != (goals.shape[1], chain.dof):
        problem = f"poses {goals.shape} do not fit start configurations {q.shape}"
        raise InputError("track", problem, f"give (steps, n, 4, 4) and (n, {chain.dof})")
    path, reached = np.zeros((len(goals), *q.shape)), np.zeros(len(q), dtype=np.intp)
    going = np.arange(len(q))
    for step, goal in enumerate(goals):
        moved = newton(chain, q[going], goal[going], _TRACK_ITERATIONS)
        near = np.abs(moved - q[going]).max(axis=1, initial=0.0) <= max_joint_step
        followed = near & is_at(chain, moved, goal[going])
        going = going[followed]
        q[going] = moved[followed]
        reached[going] = step + 1
        path[step] = q
    return path, reached


def _within_reach(chain: Chain, world_from_tip: Array) -> npt.NDArray[np.bool_]:
    """(n,) False where a target is farther from the first joint than all links in a line."""
    slides = np.where(chain.prismatic, np.maximum(np.abs(chain.lower), np.abs(chain.upper)), 0.0)
    links = np.linalg.norm(chain.placements[1:, :3, 3], axis=1)
    distance = np.linalg.norm(world_from_tip[:, :3, 3] - chain.placements[0, :3, 3], axis=1)
    return np.asarray(distance <= links.sum() + slides.sum() + 1e-6)


def _accepted(chain: Chain, q: Array, target: Rows, world_from_tip: Array) -> tuple[Array, Rows]:
    """The proposals that hold, each once, with all their equivalents within the limits, sorted by target."""
    q = chain.wrapped(q)
    keep = chain.within_limits(q, _AT_LIMIT)
    q, target = np.clip(q[keep], chain.lower, chain.upper), target[keep]
    keep = is_at(chain, q, world_from_tip[target])
    q, target = q[keep], target[keep]
    order = np.argsort(target, kind="stable")
    q, target = _distinct(chain, q[order], target[order])
    for joint in np.flatnonzero(~chain.prismatic & (chain.upper - chain.lower >= _TURN - _ROUNDING)):
        q, row = _with_whole_turns(q, int(joint), chain.lower[joint], chain.upper[joint])
        target = target[row]
    return q, target


def _with_whole_turns(q: Array, joint: int, lower: float, upper: float) -> tuple[Array, Rows]:
    """Configurations (m, dof) with every whole turn of ``joint`` that the limits allow, and their rows in ``q``."""
    least = q[:, joint] - _TURN * np.floor((q[:, joint] - lower + _ROUNDING) / _TURN)
    counts = 1 + np.floor((upper - least + _ROUNDING) / _TURN).astype(np.intp)
    if (counts == 1).all():
        return q, np.arange(len(q))
    row = np.repeat(np.arange(len(q)), counts)
    turns = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
    q = q[row]
    q[:, joint] = np.clip(least[row] + _TURN * turns, lower, upper)
    return q, row


def _distinct(chain: Chain, q: Array, target: Rows) -> tuple[Array, Rows]:
    """The first of the answers to a target that are one branch: closer than the tolerance, whole turns aside."""
    tolerance = _SAME if chain.dof <= 6 else _SAME_REDUNDANT
    turn = np.where(chain.prismatic, np.inf, _TURN)
    kept = np.ones(len(q), dtype=bool)
    for lag in range(1, int(np.bincount(target, minlength=1).max())):
        (row,) = np.nonzero(target[lag:] == target[:-lag])
        for joint in range(chain.dof):
            difference = np.abs(q[row + lag, joint] - q[row, joint])
            row = row[np.minimum(difference, turn[joint] - difference) < tolerance]
        kept[row[kept[row]] + lag] = False
    return q[kept], target[kept]
