"""Tools that are used: brought straight to where they work, and straight back, in one hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..transforms import Array, invert, pose
from .document import Plan
from .task import Use
from .verify_cell import Cell
from .verify_holds import Stretch
from .verify_motion import Curve
from .verify_ways import allowed, crooked, looks, off


@dataclass(frozen=True, eq=False)
class Uses:
    """The goals that use a tool, against what the actions do.

    Attributes:
        plan: The plan.
        cell: Its cell.
        curves: The curve of each action.
        ends: What carries what at the end of each action.
    """

    plan: Plan
    cell: Cell
    curves: list[Curve]
    ends: list[Stretch]

    def missed(self, goal: Use, k: int) -> str:
        """What is missing to the goal, of action ``k``, at its end; empty if it is reached."""
        if self.plan.actions[k].kind != "press":
            return f"{goal.part} is used by no press"
        hands = self._hands(goal, k)
        if len(hands) != 1 or goal.arm not in (None, *hands):
            return f"{goal.part} is held by {' and '.join(hands) or 'nothing'}"
        reached = self._frames(goal, k)[-1]
        return off(f"{goal.frame} of {goal.part}", reached, allowed(goal.at, goal.any_turn, reached))

    def flaw(self, goal: Use, k: int) -> str:
        """What is wrong with the ways to and from where action ``k`` reaches the goal; empty if nothing is."""
        what, hands, actions = f"{goal.frame} of {goal.part}", self._hands(goal, k), self.plan.actions[k : k + 2]
        frames = self._frames(goal, k)
        wanted = allowed(goal.at, goal.any_turn, frames[-1])
        if words := crooked(what, frames, wanted, goal.approach):
            return words
        if [(action.kind, action.goal) for action in actions[1:]] != [("withdraw", actions[0].goal)]:
            return f"{what} is not drawn back in the next action"
        if words := crooked(what, self._frames(goal, k + 1)[::-1], wanted, goal.approach):
            return f"on the way back, told from its end: {words}"
        if self._hands(goal, k + 1) != hands:
            return f"{goal.part} is not held by the {hands[0]} arm until it is drawn back"
        if any(action.arms != hands for action in actions):
            return f"more moves than the {hands[0]} arm, which uses {goal.part}"
        return ""

    def _hands(self, goal: Use, k: int) -> tuple[str, ...]:
        return self.ends[k].hands(self.ends[k].assembly(goal.part))

    def _frames(self, goal: Use, k: int) -> Array:
        """Poses (n, 4, 4) of the tool's frame along action ``k`` in the frame in which the goal gives its pose."""
        named = self.cell.task.parts[goal.part].frames[goal.frame]
        poses = looks(self.cell, self.curves[k], self.ends[k], float(self.curves[k].times[-1]))
        frames = poses[goal.part] @ pose(named.xyz, named.rpy)
        if goal.of is None:
            return frames
        world_from_of = poses[goal.of] if goal.of in poses else self.cell.standing[goal.of]
        return np.asarray(invert(world_from_of) @ frames)
