"""Grasp planning from the part to the set of grasps: the front door of this room (paper, sections III and IV)."""

from __future__ import annotations

from dataclasses import replace
from time import process_time

import numpy as np

from ..robots.hand import Hand
from .contacts import sample_contacts
from .facets import segment
from .grasps import GraspSet
from .parameters import GraspParameters
from .part import Part
from .record import Stage
from .suction import plan_suction
from .threefinger import plan_three_finger
from .twofinger import plan_two_finger

_PLANNERS = {"suction": plan_suction, "two_finger": plan_two_finger, "three_finger": plan_three_finger}


def plan_grasps(
    part: Part, hand: Hand, parameters: GraspParameters | None = None, *, colliding: bool = False
) -> GraspSet:
    """Plan the grasps of a part by a hand.

    Args:
        part: The part.
        hand: A suction cup, or a parallel gripper with two or three fingers.
        parameters: The paper's parameters; its defaults unless given.
        colliding: For pictures: give what the check of the whole hand drops, in place of what it keeps.

    Returns:
        The grasps, the best first; ``record`` has one row for each stage. The set is empty where nothing holds the
        part, and the record says which stage dropped the last candidates and why.
    """
    parameters = parameters or GraspParameters()
    started = process_time()
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    segmentation = Stage("segmentation", len(part.mesh.faces), len(facets), {}, process_time() - started)
    contacts, sampling = sample_contacts(part, facets, parameters)
    grasps, planning = _PLANNERS[hand.kind](part, facets, contacts, hand, parameters, colliding=colliding)
    best_first = grasps[np.argsort(-grasps.quality, kind="stable")]
    return replace(best_first, record=(segmentation, *sampling, *planning))
