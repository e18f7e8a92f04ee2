"""Inverse kinematics of any chain: damped Newton steps from the nearest of many random configurations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from ..transforms import Array
from .chain import Chain
from .ik_geometry import Rows
from .ik_newton import is_at, newton

_SEEDS = 20_000
_ARM = 0.3  # a turn of the tip by one radian counts as much as this distance when seeds are compared [m]
_ROUNDS = (8, 24)  # seeds tried for a target; the second lot only for targets that the first left unsolved
_STEPS = 12


@dataclass(frozen=True, eq=False)
class SeedSearch:
    """A library of random configurations, sorted by the pose of the tip.

    Attributes:
        chain: The arm.
        q: (k, dof) configurations within the limits.
    """

    chain: Chain
    q: Array
    _tree: cKDTree = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_tree", cKDTree(_features(self.chain.forward(self.q))))

    @classmethod
    def of(cls, chain: Chain, seed: int) -> SeedSearch:
        """A library for ``chain``."""
        return cls(chain, chain.random(np.random.default_rng(seed), _SEEDS))

    def __call__(self, world_from_tip: Array) -> tuple[Array, Rows]:
        """Configurations (m, dof) within the limits and the targets (m,) they belong to, not yet checked."""
        _, nearest = self._tree.query(_features(world_from_tip), k=sum(_ROUNDS))
        open_targets, tried = np.arange(len(world_from_tip)), 0
        found: list[tuple[Array, Rows]] = []
        for count in _ROUNDS:
            starts = self.q[nearest[open_targets, tried : tried + count]].reshape(-1, self.chain.dof)
            target = np.repeat(open_targets, count)
            q = newton(self.chain, starts, world_from_tip[target], _STEPS)
            solved = is_at(self.chain, q, world_from_tip[target])
            found.append((q[solved], target[solved]))
            open_targets, tried = np.setdiff1d(open_targets, target[solved]), tried + count
        return np.concatenate([q for q, _ in found]), np.concatenate([target for _, target in found])


def _features(poses: Array) -> Array:
    """Points (n, 12) whose distance is, for small turns, that of the poses (n, 4, 4) [m]."""
    return np.hstack([poses[:, :3, 3], _ARM / np.sqrt(2.0) * poses[:, :3, :3].reshape(-1, 9)])
