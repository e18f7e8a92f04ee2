"""Opening and closing hands: motions too, checked on the way."""

from __future__ import annotations

import numpy as np

from ..errors import BlockedError
from ..transforms import Array, transform_points
from .hand import Hand
from .paths import LINEAR_STEP
from .scene import Scene
from .state import SceneState


def plan_grip(scene: Scene, state: SceneState, arm: str, opening: float) -> Array:
    """Openings (k,) from that of the hand of ``arm`` in ``state`` to ``opening`` [m], checked on the way.

    No fingertip moves farther than 1 mm between two checks. Contacts of the fingers that the state allows excuse
    touching as everywhere: within the contact tolerance.

    Raises:
        InputError: The opening lies outside the stroke, the arm has no hand, or the state's configuration is outside
            the limits.
        BlockedError: A finger touches something on the way.
    """
    opening = scene.robot.arm(arm).checked_opening(opening)
    q = scene.robot.checked_configuration(state.q, "start")
    start = state.openings[arm]
    openings = np.linspace(start, opening, _steps(scene.robot.hands[arm], start, opening) + 1)
    for i, value in enumerate(openings):
        checker = scene.checker(state.with_opening(arm, value), {arm})
        if not checker.free(q):
            raise BlockedError(checker.touching(q), i / (len(openings) - 1))
    return openings


def _steps(hand: Hand, start: float, end: float) -> int:
    """In how many steps no point of the fingers moves farther than 1 mm."""
    way = np.linspace(start, end, max(int(np.ceil(abs(end - start) / LINEAR_STEP)), 1) + 1)
    poses = hand.base_from_piece(way)
    corners = [transform_points(poses[:, i], piece.corners) for i, piece in enumerate(hand.pieces)]
    longest = max(float(np.linalg.norm(np.diff(points, axis=0), axis=-1).max()) for points in corners)
    return max(int(np.ceil((len(way) - 1) * longest / LINEAR_STEP)), 1)
