"""Where the forces of two sides pass each other, they turn the part in the hand.

A pad that lies on an edge or on a bulge presses there, not at the planned contact. Which places touch and which way the
forces point there need not be looked for: by virtual work a force does on its way what a couple does on its turn, so
the couple is told by how much further the hand closes if it is turned by a little.
"""

from __future__ import annotations

import numpy as np

from ..robots.hand import Hand
from ..transforms import Array, compose, rotation_about
from .facets import Indices
from .part import Part
from .touch import first_touch

_TURN = np.radians(0.05)  # pads of 40 mm sink by hundredths of a millimetre
_WAYS = np.arange(8) * np.pi / 4.0  # the axes turned about: from the hand's y axis towards its z axis
_NEAR = 2e-4  # m: no pad rises or sinks by more under so small a turn


def force_offsets(part: Part, hand: Hand, part_from_hand: Array, opening: Array, end: Indices) -> Array:
    """How far the force of each side passes the other side's pad (n, 2) [m]: past the single finger's, then the other.

    The largest over turns about eight axes across the closing axis; zero where a force that the one side can exert runs
    against one of the other, as between pads that lie flat on faces that overlap. Two contacts hold by friction alone
    where the line between them lies within both cones of friction: where, for small angles, no offset is more than the
    coefficient of friction times the opening.

    Args:
        part: The part.
        hand: A hand with fingers.
        part_from_hand: (n, 4, 4) poses of the hand, where it has closed.
        opening: (n,) its opening there: a pad of each side just touches the part [m].
        end: (n,) contact of the single finger: 2 x its pair + which of the two; the other side's is the pair's other.
    """
    axes = np.stack([np.zeros(len(_WAYS)), np.cos(_WAYS), np.sin(_WAYS)], axis=-1)
    n, half = len(opening), 0.5 * opening[:, None] * np.array([1.0, 0.0, 0.0])
    pivot, turn = np.stack([-half, half], axis=1)[:, :, None], rotation_about(axes, _TURN)
    turned = part_from_hand[:, None, None] @ compose(turn, pivot - (turn @ pivot[..., None])[..., 0])
    turned = np.concatenate([part_from_hand[:, None], turned.reshape(n, 2 * len(axes), 4, 4)], axis=1)
    pads = turned[:, :, None] @ hand.hand_from_pad(opening)[:, None]
    ways = pads.shape[1]
    touch, closing = np.zeros((len(hand.pads), n * ways)), part_from_hand[:, :3, 0]
    for i, pad in enumerate(hand.pads):
        outward = closing if i else -closing
        place = end ^ (i > 0) if i == 0 or len(hand.pads) == 2 else np.arange(n)
        touch[i] = first_touch(
            part.mesh,
            np.repeat(place, ways),
            np.repeat(outward, ways, axis=0),
            pads[:, :, i].reshape(-1, 4, 4),
            pad.size,
            floor=-_NEAR,
            reach=np.full(n * ways, _NEAR),
        )
    touch = np.maximum(touch, -_NEAR)
    apart = (touch[0] + touch[1:].max(axis=0)).reshape(n, ways)
    closes = apart[:, :1] - apart[:, 1:].reshape(n, 2, len(axes)).min(axis=2)
    return np.asarray(np.maximum(closes, 0.0) / _TURN)
