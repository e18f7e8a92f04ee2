"""Grasps for three-finger parallel grippers: one finger against two (paper, section IV.C)."""

from __future__ import annotations

from time import process_time

import numpy as np

from ..robots.hand import Hand
from ..transforms import Array, compose, transform_points
from .collision import HandCollision, Mask
from .contacts import Contacts
from .facets import Facets
from .grasps import GraspSet
from .pairs import ContactPairs, find_pairs
from .parallel import FLUSH, Candidates, finish, stand, turn_about
from .parameters import GraspParameters
from .part import Part
from .record import Stage


def plan_three_finger(
    part: Part,
    facets: Facets,
    contacts: Contacts,
    hand: Hand,
    parameters: GraspParameters,
    *,
    colliding: bool = False,
) -> tuple[GraspSet, tuple[Stage, ...]]:
    """Grasps of one finger against two, which close as one; either side may take either contact (section IV.C).

    Both fingers of the pair must come within ``t_dct`` of the surface; nearer than ``contact_tolerance`` counts as
    touching.

    Returns:
        The grasps, and the stages from ``"contact pairs"`` on.
    """
    pairs, record = find_pairs(part, facets, contacts, parameters)
    candidates = turn_about(pairs, parameters.n_da, both_ways=True)
    grasps, stages = hold(part, facets, hand, pairs, candidates, parameters, colliding=colliding)
    return grasps, (*record, *stages)


def hold(
    part: Part,
    facets: Facets,
    hand: Hand,
    pairs: ContactPairs,
    candidates: Candidates,
    parameters: GraspParameters,
    *,
    colliding: bool = False,
) -> tuple[GraspSet, tuple[Stage, ...]]:
    """The nested checks of ``candidates``, from cheap to dear: strokes, pads, the whole hand, stability.

    Returns:
        The grasps, without a record, and the stages from ``"stroke collision"`` on.
    """
    body = HandCollision(part, hand)
    started = process_time()
    wide = pairs.width[candidates.pair] + 2.0 * parameters.contact_tolerance > hand.stroke[1]
    fitting = candidates.take(~wide)
    blocked = strokes_hit(body, hand, pairs, fitting, parameters.h_max)
    dropped = {"wider than the hand opens": int(wide.sum()), "stroke": int(blocked.sum())}
    left = fitting.take(~blocked)
    stroke = Stage("stroke collision", len(candidates), len(left), dropped, process_time() - started)

    started = process_time()
    within = max(parameters.t_dct, parameters.contact_tolerance)
    standing = stand(part, hand, pairs, left, parameters.h_max, floor=-within)
    sinks = (standing.stand_off > parameters.h_max + FLUSH).any(axis=1)
    hangs = ~sinks & (standing.gap > within)
    opening = standing.opening + 2.0 * parameters.contact_tolerance
    misfit = ~sinks & ~hangs & ((standing.opening < hand.stroke[0]) | (opening > hand.stroke[1]))
    good = ~(sinks | hangs | misfit)
    dropped = {
        "pad not on the surface": int(sinks.sum()),
        "finger of the pair off the surface": int(hangs.sum()),
        "opening outside the stroke": int(misfit.sum()),
    }
    pads = Stage("pad standing", len(left), int(good.sum()), dropped, process_time() - started)
    grasps, last = finish(
        part, hand, body, facets, pairs, left.take(good), standing.take(good), parameters, colliding=colliding
    )
    return grasps, (stroke, pads, *last)


def strokes_hit(body: HandCollision, hand: Hand, pairs: ContactPairs, candidates: Candidates, h_max: float) -> Mask:
    """Whether one of the three strokes meets the part (n,): cylinders as for two fingers, but turning with the hand."""
    width = pairs.width[candidates.pair]
    touching = compose(candidates.rotation, candidates.ends(pairs).mean(axis=1))[:, None] @ hand.hand_from_pad(width)
    length = (hand.stroke[1] - width) / 2.0 - h_max
    hits = np.zeros(len(candidates), dtype=bool)
    for i, pad in enumerate(hand.pads):
        outward = (-1.0 if i == 0 else 1.0) * candidates.closing
        start = _contact_point(hand, touching, i) + h_max * outward
        left = np.flatnonzero(~hits)
        hits[left] = body.cylinders_hit(start[left], outward[left], length[left], pad.radius)
    return hits


def _contact_point(hand: Hand, part_from_pad: Array, pad: int) -> Array:
    """Contact points (n, 3) of one pad, ``contact_depth`` below its upper edge, for poses (n, pads, 4, 4)."""
    point = np.array([[0.0, 0.0, hand.pads[pad].size[1] / 2.0 - hand.contact_depth]])
    return transform_points(part_from_pad[:, pad], point)[:, 0]
