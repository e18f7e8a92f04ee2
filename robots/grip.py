"""Opening and closing hands: motions too, checked on the way."""

from __future__ import annotations

import numpy as np

from ..errors import BlockedError
from ..transforms import Array
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
    count = max(int(np.ceil(abs(opening - start) / LINEAR_STEP)), 1)
    openings = np.linspace(start, opening, count + 1)
    for i, value in enumerate(openings):
        checker = scene.checker(state.with_opening(arm, value), {arm})
        if not checker.free(q):
            raise BlockedError(checker.touching(q), i / count)
    return openings
