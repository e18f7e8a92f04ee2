"""States while a part is brought somewhere: what it rests on, what it carries, and arms that have nothing to do."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..robots.scene import Scene
from ..robots.state import Contact, SceneState

_UP = np.array([0.0, 0.0, 1.0])


def at_rest(scene: Scene, state: SceneState, part: str) -> SceneState:
    """``state`` with the arms that carry nothing but ``part`` at home, and without contacts of the part."""
    q = np.array(state.q)
    busy = {state.carrier(body)[0] for body in state.attached if root_of(state, body) != part}
    for name, arm in scene.robot.arms.items():
        if name not in busy:
            q[arm.indices] = scene.robot.home[arm.indices]
    return apart(state.with_q(q), part)


def apart(state: SceneState, part: str, kept: Iterable[str] = ()) -> SceneState:
    """``state`` without the contacts of ``part``, and what it carries, with anything else but the pieces ``kept``."""
    whole = {part} | {body for body in state.attached if root_of(state, body) == part}
    left = [c for c in state.contacts if (c.first in whole) == (c.second in whole) or c.second in kept]
    return state.with_contacts(left)


def rest_contacts(scene: Scene, state: SceneState, support: str, part: str) -> list[Contact]:
    """The contacts of ``part``, and of all that is joined to it, with the ``support`` that it stands on."""
    up = scene.world_from_body(state, support)[:3, :3].T @ _UP
    joined = [body for body in state.attached if body != part and root_of(state, body) == part]
    return [Contact(support, body, up) for body in (part, *joined)]


def root_of(state: SceneState, body: str) -> str:
    """The body that carries ``body`` through other bodies and is itself carried by an arm or by nothing."""
    while body in state.attached and state.attached[body].carrier in (*state.poses, *state.attached):
        body = state.attached[body].carrier
    return body
