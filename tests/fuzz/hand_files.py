"""Hands: the shipped YAML and URDF, spoiled, through the reader to what grasp planning asks of a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from robot_files import spoiled_text
from spoil import NAMES, Rng, one

from kumitate.robots.hand import Hand
from kumitate.robots.library import HANDS
from kumitate.tasks.models import LIBRARY

COUNT = 3500
_WORDS = ("suction", "two_finger", "three_finger", "!!bool x", "!!timestamp x", "!!int ''", "2020-01-01", "&a [*a]")


def make(rng: Rng, folder: Path) -> None:
    """Write the two files of a hand, one or both of them spoiled."""
    name = one(rng, HANDS)
    texts = {end: (LIBRARY / f"{name}{end}").read_text() for end in (".yaml", ".urdf")}
    spoiled = one(rng, ((".yaml",), (".urdf",), (".yaml", ".urdf")))
    for end, text in texts.items():
        content = spoiled_text(rng, end, text) if end in spoiled else text.encode()
        if end == ".yaml" and rng.random() < 0.1:
            content = content.replace(one(rng, content.split()), one(rng, (*NAMES, *_WORDS)).encode(errors="ignore"), 1)
        (folder / f"{name if end == '.urdf' else 'hand'}{end}").write_bytes(content)


def feed(folder: Path) -> str:
    """Load the hand; its pads are as far apart as it is opened."""
    hand = Hand.load(folder / "hand.yaml")
    openings = np.linspace(*hand.stroke, 3)
    pieces, pads = hand.hand_from_piece(openings), hand.hand_from_pad(openings) if hand.pads else np.zeros((3, 2, 4, 4))
    if not (np.isfinite(pieces).all() and np.isfinite(pads).all() and np.isfinite(hand.pieces[0].mesh.bounds).all()):
        raise AssertionError("a number of the hand is not finite")
    if hand.pads:
        heights = np.array([pad.size[1] / 2.0 - hand.contact_depth for pad in hand.pads])
        contacts = pads[..., :3, 3] + pads[..., :3, 2] * heights[:, None]
        apart = contacts[:, 1:, 0].mean(axis=1) - contacts[:, 0, 0]
        if np.abs(apart - openings).max() > 1e-3:
            raise AssertionError(f"opened by {openings}, the contacts are {apart} apart")
    return "works"
