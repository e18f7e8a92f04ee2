"""Why a part does not come to its goal: what was tried, how many grasps fell to which cause, which motions failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..errors import NoRegraspError
from .graph import Goal, RegraspGraph

_MOST_LINES = 12
_MOST_CAUSES = 4


class Count(str):
    """How many grasps work at a node, and what was the first thing that the others failed at."""


def report_on(graph: RegraspGraph, goals: Sequence[Goal], failures: Sequence[str]) -> NoRegraspError:
    """The error that tells why ``graph`` has no way to ``goals``, ``failures`` being the motions that failed."""
    part, lines = graph.reacher.part, list[str]()
    working: Counter[str] = Counter()
    dropped, tested = graph.reacher.dropped(), graph.reacher.tested()
    ends = [graph.start.name, *(goal.node.name for goal in goals)]
    for (node, arm), (asked, kept) in tested.items():
        working[node] += kept
        if node in ends:
            causes = ", ".join(f"{n} {cause}" for cause, n in dropped[node, arm].most_common(_MOST_CAUSES) if n)
            lines.append(
                Count(f"{node}, {arm} arm: {kept} of {asked} grasps work" + (f" ({causes})" if causes else ""))
            )
    between = [node.name for node in graph.nodes if any(name == node.name for name, _ in tested)]
    useful = sum(working[name] > 0 for name in between)
    lines.append(f"{len(between)} of {len(graph.nodes)} placements and handovers looked at, {useful} with any grasp")
    lines += list(dict.fromkeys(failures))[:_MOST_LINES]
    return NoRegraspError(part, _cause(graph, goals, working, failures), lines)


def _cause(graph: RegraspGraph, goals: Sequence[Goal], working: Counter[str], failures: Sequence[str]) -> str:
    """The cause, in words."""
    if not any(len(holder.grasps) for holder in graph.reacher.holders.values()):
        return "no hand has a grasp of it; is the hand too small?"
    for where, names in (("where it is", [graph.start.name]), ("at the goal", [goal.node.name for goal in goals])):
        held = graph.held is not None and names == [graph.start.name]
        if not held and not any(working[name] for name in names):
            causes: Counter[str] = Counter()
            for (node, _), reasons in graph.reacher.dropped().items():
                if node in names:
                    causes.update(reasons)
            worst = ", ".join(cause for cause, n in causes.most_common(2) if n)
            return f"no grasp of it works {where}" + (f": {worst}" if worst else "")
    if failures:
        return f"no motion was found: {failures[-1]}"
    if not graph.nodes:
        return "no grasp is shared by start and goal, and there is no support to put it down on, nor a second arm"
    return "no grasp is shared by start and goal, nor along any way over the placements and handovers looked at"
