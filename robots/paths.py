"""Checking joint paths by how far bodies really move.

A path is checked at configurations between which no point moves farther than a step. Where something comes nearer to
something else than that step, what happens between two checks is not yet certain, and the path is checked there with a
fifth of the step, down to 0.2 mm.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ..errors import BlockedError
from ..transforms import Array
from .scene import Scene
from .state import SceneState
from .sweep import Sweep

FREE_STEP = 5e-3  # m between two checks of a free motion
LINEAR_STEP = 1e-3  # m between two checks of a straight motion, and of closing fingers
_FINEST = 0.2e-3  # m
_FINER = 5


class PathCheck:
    """Checks paths of some arms in one state of a scene.

    Args:
        scene: The scene.
        state: The state in which the arms move; its configuration does not matter.
        arms: The arms that move.
        step: Farthest way of any point between two checks [m], where nothing is nearer than that.
        working: Arms whose hands need keep no margins.
    """

    def __init__(
        self, scene: Scene, state: SceneState, arms: Sequence[str], step: float, working: Collection[str] = ()
    ) -> None:
        self._sweep = Sweep(scene, state, arms)
        self._checker = scene.checker(state, working)
        self._steps = [step]
        while self._steps[-1] / _FINER >= _FINEST * (1.0 - 1e-9):
            self._steps.append(self._steps[-1] / _FINER)

    def blocked(self, path: Array) -> tuple[Array, float] | None:
        """The first configuration (nq,) of ``path`` (k, nq) that touches something, and its place from 0 to 1."""
        stretches = [(path, np.linspace(0.0, 1.0, len(path)))]
        for step in self._steps:
            clear = self._checker.with_clearance(step)
            fine = [self._sweep.refined(stretch, shares, step) for stretch, shares in stretches]
            near = [np.array([not clear.free(q) for q in stretch], dtype=bool) for stretch, _ in fine]
            for (stretch, shares), doubtful in zip(fine, near, strict=True):
                for i in np.flatnonzero(doubtful):
                    if not self._checker.free(stretch[i]):
                        return stretch[i], float(shares[i])
            stretches = [
                (stretch[part], shares[part])
                for (stretch, shares), doubtful in zip(fine, near, strict=True)
                for part in _around(doubtful)
            ]
        return None

    def require_free(self, path: Array) -> None:
        """Raise where ``path`` (k, nq) touches something.

        Raises:
            BlockedError: Something touches; the error names it, and where along the path.
        """
        found = self.blocked(path)
        if found is not None:
            q, share = found
            raise BlockedError(self._checker.touching(q), share)


def _around(marked: npt.NDArray[np.bool_]) -> Iterator[slice]:
    """Slices over the runs of marked places, each with the places before and after it."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]])))
    for first, after in edges.reshape(-1, 2):
        yield slice(max(first - 1, 0), after + 1)
