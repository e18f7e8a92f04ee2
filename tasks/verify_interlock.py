"""Interlocked hands: the single finger of each between the two of the other, from opposite sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..transforms import Array, invert, transform_points
from .document import Plan
from .task import HandOver
from .verify_cell import Cell
from .verify_holds import Stretch
from .verify_motion import Curve

_OPPOSED = float(np.cos(np.deg2rad(45.0)))  # hands that come from opposite sides are turned no farther from that


@dataclass(frozen=True, eq=False)
class Fingers:
    """A hand and the faces of its pads.

    Attributes:
        world_from_hand: Pose (4, 4): x from the single finger to the pair, z the approach.
        faces: Their corners (pads, 4, 3) in the world, the single finger's first [m].
    """

    world_from_hand: Array
    faces: Array

    @classmethod
    def of(cls, cell: Cell, arm: str, values: Array) -> Fingers:
        """The fingers of an arm's hand at a row (1, columns) of a curve."""
        faces = cell.machine.grippers[arm].faces(cell.split(values)[1][arm])[0]
        return cls(cell.hand(arm, values)[0], transform_points(cell.flanges(values)[arm][0], faces))


def interlocked(one: Fingers, other: Fingers) -> bool:
    """Whether two hands have three fingers each, and either has its single one between the other's two."""
    return len(one.faces) == len(other.faces) == 3 and _between(one, other) and _between(other, one)


def _between(one: Fingers, other: Fingers) -> bool:
    """Whether the single finger of ``other`` stands between the pair of ``one``, come from the opposite side."""
    own_from_world = invert(one.world_from_hand)
    single = transform_points(own_from_world, other.faces[0])
    first, second = sorted(transform_points(own_from_world, one.faces[1:]), key=lambda face: float(face[:, 1].mean()))
    amid = first[:, 1].max() < single[:, 1].min() and single[:, 1].max() < second[:, 1].min()
    beside = single[:, 0].mean() > 0.0  # of the part's two sides the pair's
    level = all(
        max(face[:, 2].min(), single[:, 2].min()) < min(face[:, 2].max(), single[:, 2].max())
        for face in (first, second)
    )
    turn = own_from_world @ other.world_from_hand
    opposed = max(turn[0, 0], turn[2, 2]) < -_OPPOSED
    return bool(amid and beside and level and opposed)


def apart(goal: HandOver, plan: Plan, cell: Cell, curves: list[Curve], ends: list[Stretch], k: int) -> str:
    """Why an arm that holds a part after action ``k`` was not given it by interlocked hands; empty if it was."""
    whole = ends[k].assembly(goal.part)
    for j in range(k, -1, -1):
        for event in reversed(plan.actions[j].events):
            if event.kind == "attach" and event.carrier == goal.to and event.part in whole:
                givers = set(ends[j - 1].hands(ends[j - 1].assembly(event.part)) if j else ()) - {goal.to}
                values = curves[j].at(np.array([event.time]))
                taker = Fingers.of(cell, goal.to, values)
                if any(interlocked(Fingers.of(cell, giver, values), taker) for giver in givers):
                    return ""
                hands = " and ".join(sorted(givers))
                words = f"from the {hands} hand, their fingers not interlocked" if givers else "from no other hand"
                return f"the {goal.to} hand takes {goal.part} {words}"
    return f"the {goal.to} hand never takes {goal.part}"
