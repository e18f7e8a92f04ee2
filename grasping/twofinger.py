"""Grasps for two-finger parallel grippers (paper, section IV.B)."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np

from ..robots.hand import Hand
from .collision import HandCollision, looks_the_same_turned
from .contacts import Contacts
from .facets import Facets
from .grasps import GraspSet
from .pairs import ContactPairs, find_pairs
from .parallel import FLUSH, finish, stand, turn_about
from .parameters import GraspParameters
from .part import Part
from .record import Stage


def plan_two_finger(
    part: Part,
    facets: Facets,
    contacts: Contacts,
    hand: Hand,
    parameters: GraspParameters,
    *,
    colliding: bool = False,
) -> tuple[GraspSet, tuple[Stage, ...]]:
    """Grasps of a two-finger parallel gripper: contact pairs, then nested checks from cheap to dear (section IV.B).

    Returns:
        The grasps, and the stages from ``"contact pairs"`` on. Both ways round (fingers swapped) are two grasps; where
        the hand looks the same turned by half a turn the checks of one way serve both.
    """
    pairs, record = find_pairs(part, facets, contacts, parameters)
    body = HandCollision(part, hand)
    pairs, stroke = clear_strokes(body, hand, pairs, parameters)

    started = process_time()
    same_turned = looks_the_same_turned(hand)
    candidates = turn_about(pairs, parameters.n_da, both_ways=not same_turned)
    standing = stand(part, hand, pairs, candidates, parameters.h_max, floor=0.0)
    sinks = (standing.stand_off > parameters.h_max + FLUSH).any(axis=1)
    wide = ~sinks & (standing.opening + 2.0 * parameters.contact_tolerance > hand.stroke[1])
    good = ~(sinks | wide)
    dropped = {"pad not on the surface": int(sinks.sum()), "opens too wide": int(wide.sum())}
    pads = Stage("pad standing", len(candidates), int(good.sum()), dropped, process_time() - started)

    candidates, standing = candidates.take(good), standing.take(good)
    grasps, last = finish(part, hand, body, facets, pairs, candidates, standing, parameters, colliding=colliding)
    record = (*record, stroke, pads, *last)
    if same_turned:
        started = process_time()
        taken, grasps = len(grasps), with_fingers_swapped(grasps)
        record = (*record, Stage("both ways round", taken, len(grasps), {}, process_time() - started))
    return grasps, record


def clear_strokes(
    body: HandCollision, hand: Hand, pairs: ContactPairs, parameters: GraspParameters
) -> tuple[ContactPairs, Stage]:
    """Keep the pairs that the hand can span and whose strokes are free of the part (section IV.B, line 14).

    The stroke of a finger is a cylinder of the pad's radius, from ``h_max`` outside the contact outward as far as the
    hand opens; having no orientation it is checked once for all rotations.
    """
    started = process_time()
    wide = pairs.width + 2.0 * parameters.contact_tolerance > hand.stroke[1]
    left = np.flatnonzero(~wide)
    length = (hand.stroke[1] - pairs.width) / 2.0 - parameters.h_max
    for end, way in ((0, -1.0), (1, 1.0)):
        outward = way * pairs.axis[left]
        start = pairs.points[left, end] + parameters.h_max * outward
        left = left[~body.cylinders_hit(start, outward, length[left], hand.pads[end].radius)]
    dropped = {"wider than the hand opens": int(wide.sum()), "stroke": int(len(pairs) - wide.sum() - len(left))}
    return pairs.take(left), Stage("stroke collision", len(pairs), len(left), dropped, process_time() - started)


def with_fingers_swapped(grasps: GraspSet) -> GraspSet:
    """The grasps, and each again with the hand turned half about its approach direction: the wrist differs."""
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    swapped = replace(
        grasps,
        part_from_hand=grasps.part_from_hand @ half_turn,
        contacts=grasps.contacts[:, ::-1],
        normals=grasps.normals[:, ::-1],
        facets=grasps.facets[:, ::-1],
    )
    return grasps.joined(swapped)
