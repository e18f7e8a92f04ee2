"""Grasps of a taker built on those of a giver, so that their fingers interlock: both hold a part at the same contacts.

Each hand has one finger against two. The taker faces the giver: turned by half a turn about the line through the
giver's pair, its single finger enters the gap between the giver's two, and its own two come to either side of the
giver's single one. Grasps sampled for each hand alone hardly ever meet so.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from ..errors import InputError
from ..robots.hand import Hand
from .facets import segment
from .grasps import GraspSet
from .pairs import ContactPairs
from .parallel import Candidates
from .parameters import GraspParameters
from .part import Part
from .threefinger import hold

_FACING = np.diag([-1.0, 1.0, -1.0, 1.0])  # giver_from_taker, half a turn about the line through the pair


def facing_grasps(part: Part, hand: Hand, giver: GraspSet, parameters: GraspParameters) -> GraspSet:
    """The grasps by the taker's ``hand`` that interlock with those of ``giver``, as far as they hold the part.

    Args:
        part: The part.
        hand: The taker's hand.
        giver: Grasps (n,) by a hand of three fingers.
        parameters: How the part's grasps are planned.

    Returns:
        At most n grasps, in the order of the giver's.

    Raises:
        InputError: The taker's hand has not one finger against two.
    """
    if hand.kind != "three_finger":
        cure = "give both arms hands with one finger against two, such as hrp5p_three_finger"
        raise InputError(f"hand {hand.name}", "its fingers cannot interlock with another hand's", cure)
    facing = giver.part_from_hand @ _FACING
    pairs = ContactPairs(giver.contacts[:, ::-1], giver.normals[:, ::-1], giver.facets[:, ::-1], giver.parallelness)
    candidates = Candidates(
        pair=np.arange(len(giver)),
        swapped=np.zeros(len(giver), dtype=bool),
        closing=facing[:, :3, 0],
        approach=facing[:, :3, 2],
    )
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    return hold(part, facets, hand, pairs, candidates, parameters)[0]


def faced(giver: GraspSet, taker: GraspSet) -> npt.NDArray[np.intp]:
    """The grasp (k,) of ``giver`` (n,) that each of the facing grasps ``taker`` (k,) was built on."""
    mine, theirs = (
        np.concatenate(
            [grasps.contacts[:, way].reshape(len(grasps), 6), side * grasps.part_from_hand[:, :3, 2]], axis=1
        )
        for grasps, way, side in ((taker, [0, 1], 1.0), (giver, [1, 0], -1.0))
    )
    return np.asarray(cKDTree(theirs).query(mine)[1], dtype=np.intp)
