"""Checking joint paths: no point of the robot, or of what it carries, moves farther than a bound between two checks."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from ..errors import BlockedError
from ..transforms import Array
from .collision import StateChecker
from .scene import Scene
from .state import SceneState
from .sweep import Sweep

FREE_STEP = 5e-3  # m between two checks of a free motion
LINEAR_STEP = 1e-3  # m between two checks of a straight motion, and of closing fingers


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
    blocked = first_blocked(checker, fine)
    if blocked is not None:
        raise BlockedError(checker.touching(fine[blocked]), blocked / max(len(fine) - 1, 1))


def first_blocked(checker: StateChecker, path: Array) -> int | None:
    """The first configuration of ``path`` (k, nq) that is not free."""
    return next((i for i, q in enumerate(path) if not checker.free(q)), None)
