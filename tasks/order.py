"""In which order goals are reached where any will do."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Sequence

import numpy as np

from ..errors import InputError, NoRegraspError, PlanningError, TimeLimitError
from ..regrasp.reach import Node, Reacher
from .job import Job
from .targets import place_nodes
from .task import Goal, Place

_log = logging.getLogger(__name__)

_LOOKED = 200  # well-spread grasps that tell whether a part can still be taken and put down


class NoOrderError(PlanningError):
    """Goals cannot be reached in any order.

    Attributes:
        report: What stopped which order, a sentence each.
    """

    def __init__(self, report: Sequence[str]) -> None:
        """Name the last reason."""
        self.report = tuple(dict.fromkeys(report))
        super().__init__(f"there is no order in which the goals can be reached: {report[-1]}")


def in_some_order(job: Job, goals: Sequence[Goal], reach: Callable[[int, list[int]], None]) -> None:
    """Reach ``goals`` in an order that works; depth first, the order in which they are given first.

    A goal is not reached while its part, once in place, would keep another from its own place; nor can it be while what
    its part shall rest on is still to come. A set of goals that could not be finished is not tried again.

    Args:
        job: The job.
        goals: The goals.
        reach: Plans the goal of a number; given too are the numbers of those to come.

    Raises:
        NoOrderError: There is none.
    """
    failures: list[str] = []
    dead: set[frozenset[int]] = set()
    kept_out: set[tuple[int, int]] = set()  # a number and another that it has kept out

    def finish(left: frozenset[int]) -> bool:
        if not left:
            return True
        # What has kept another out may do so only as long as something else stood there too; it is asked last.
        waiting = {number for number, other in kept_out if other in left}
        for number in sorted(left, key=lambda number: (number in waiting, number)) if left not in dead else ():
            others = sorted(left - {number})
            blocked = next((other for other in others if _keeps_out(job, goals[number], goals[other])), None)
            if blocked is not None:
                kept_out.add((number, blocked))
                failures.append(f"goal {number + 1} in place keeps goal {blocked + 1} from being reached")
                continue
            mark = job.mark()
            try:
                reach(number, others)
            except TimeLimitError:
                raise
            except (InputError, PlanningError) as error:
                _log.info("goal %d: %s", number + 1, error)
                failures.append(f"goal {number + 1}: {error}")
            else:
                if finish(left - {number}):
                    return True
            job.back_to(mark)
        dead.add(left)
        return False

    if not finish(frozenset(range(len(goals)))):
        raise NoOrderError(failures)


def _keeps_out(job: Job, goal: Goal, other: Goal) -> bool:
    """Whether the part of ``other`` can be taken and put down now, and no more once that of ``goal`` is in place."""
    if goal.place is None or other.place is None or other.place.part == goal.place.part:
        return False
    nodes, part = _places(job, goal.place), job.root(goal.place.part)
    job.tell(f"whether {other.place.part} comes to its place after {part}")
    reacher, mark = Reacher(job.cell.scene, job.motions.state, part, {}), job.mark()
    for node in nodes:
        job.motions.state = reacher.state_at(node)
        possible = _possible(job, other.place)
        job.back_to(mark)
        if possible:
            return False
    return bool(nodes) and _possible(job, other.place)


def _possible(job: Job, goal: Place) -> bool:
    """Whether some grasp can take the part of ``goal`` now, and some grasp put it down."""
    part, nodes = job.root(goal.part), _places(job, goal)
    if job.held(part) is not None or not nodes:
        return True
    holders = job.whole(part).holders
    reacher = Reacher(job.cell.scene, job.motions.state, part, holders, job.motions.watch)
    start = Node("start", job.pose(part), job.rests_on(part))
    arms = tuple(holders) if goal.arm is None else (goal.arm,)
    return _reached(reacher, [start], tuple(holders)) and _reached(reacher, nodes, arms)


def _places(job: Job, goal: Place) -> list[Node]:
    """Where the part of ``goal`` may be put down; nowhere while what it shall rest on is not there."""
    try:
        return place_nodes(job, goal)
    except (InputError, NoRegraspError):
        return []


def _reached(reacher: Reacher, nodes: Sequence[Node], arms: Sequence[str]) -> bool:
    """Whether some well-spread grasp of one of ``arms`` works at one of ``nodes``."""
    masks = {arm: np.zeros(len(reacher.holders[arm].grasps), dtype=bool) for arm in arms}
    for arm, mask in masks.items():
        mask[reacher.holders[arm].grasps.spread(_LOOKED)] = True
    return any(len(reacher.reach(node, arm, masks[arm]).grasp) for node, arm in itertools.product(nodes, arms))
