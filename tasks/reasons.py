"""Why a goal is not reached: what stands against each arm's grasps, what was tried, and which causes decide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from ..errors import InputError, NoRegraspError, PlanningError
from ..regrasp.diagnosis import Cause, Diagnosis, decisive, diagnose, roots
from ..regrasp.reach import Node, Reacher
from ..regrasp.report import Count
from ..regrasp.steps import Attempt
from ..robots.scene import Scene
from ..robots.state import SceneState
from ..transforms import Array, invert
from .assembly import NoMeetingError, in_the_way, insertion_of, pinned_pose, ways_left
from .job import Job
from .targets import hold_nodes, place_nodes
from .task import At, Attach, Goal
from .use import stroke_nodes

_MOST_NODES = 3  # places of a goal that are looked at
_MOST_LINES = 12
_MOST_CAUSES = 5  # of a funnel that are told
_HERE = "where it is"
_NO_GRASP = "no grasp"


@dataclass(frozen=True, eq=False)
class Blocked:
    """The candidate that comes nearest to working, to look at.

    Attributes:
        scene: The scene.
        place: Where the part is (3,) [m].
        state: Where everything is; the arm at home where no inverse kinematics answers.
        causes: What stands against it.
        hand: Where the hand would be then: the arm, and the pose (4, 4) of its hand's base in the world.
    """

    scene: Scene
    place: Array
    state: SceneState
    causes: frozenset[Cause]
    hand: tuple[str, Array] | None

    @property
    def bodies(self) -> frozenset[str]:
        """The bodies that are in the way."""
        return frozenset(body for cause in self.causes for body in cause.bodies)


@dataclass(frozen=True, eq=False)
class Report:
    """Why there is no plan; iterates over its sentences.

    Attributes:
        goal: The number, from 0, of the goal that is not reached; none if it is no single one.
        where: What does not work, in words.
        causes: What decides, the gravest first: how many grasps, or attempts, would work without it, or without as few
            others as possible.
        diagnoses: What stands against the grasps, for each part, place and arm.
        attempts: Candidates of the search that motions were not found for.
        notes: What else was tried, a sentence each.
        blocked: The candidate that comes nearest to working, at the first place where none does; else how all stands.
    """

    goal: int | None
    where: str
    causes: tuple[tuple[Cause, int], ...]
    diagnoses: tuple[Diagnosis, ...] = ()
    attempts: tuple[Attempt, ...] = ()
    notes: tuple[str, ...] = ()
    blocked: Blocked | None = None

    @property
    def title(self) -> str:
        """The goal, and what does not work."""
        goal = "there is no plan" if self.goal is None else f"goal {self.goal + 1} is not reached"
        return f"{goal}: {self.where}"

    def __iter__(self) -> Iterator[str]:
        if self.causes:
            yield "because of: " + "; ".join(f"{cause} ({count})" for cause, count in self.causes)
        yield from map(funnel, self.diagnoses)
        yield from list(dict.fromkeys(self.notes))[:_MOST_LINES]
        yield from list(dict.fromkeys(self.attempts))[:_MOST_LINES]


class NoPlanError(PlanningError):
    """A goal is not reached.

    Attributes:
        report: Why.
    """

    def __init__(self, report: Report, error: PlanningError) -> None:
        """Name the goal, what failed, and the causes that decide."""
        self.report = report
        because = "; ".join(str(cause) for cause, _ in report.causes[:2])
        super().__init__(f"{report.title}: {because or error}")


def funnel(entry: Diagnosis) -> str:
    """How many grasps are left of those planned, and what the others fell to, in words."""
    where = entry.node.name.removeprefix(f"{entry.part} ")
    words = f"{entry.part}, {where}, {entry.arm} arm: {entry.planned} grasps planned"
    if not entry.planned:
        return words
    causes = ", ".join(f"{count} {cause}" for cause, count in entry.each.most_common(_MOST_CAUSES))
    return f"{words}, {entry.looked} looked at, {entry.works} work" + (f" ({causes})" if causes else "")


def reasons(job: Job, number: int, goal: Goal, error: PlanningError) -> Report:
    """Why ``goal`` is not reached from where ``job`` is, once planning has ended in ``error``."""
    told: tuple[str, ...] = tuple(getattr(error, "report", ()))
    attempts = tuple(line for line in told if isinstance(line, Attempt))
    notes = [line for line in told if not isinstance(line, Attempt | Count)]
    diagnoses, causes, where = list[Diagnosis](), list[tuple[Cause, int]](), ""
    blocked: Blocked | None = None
    for part, nodes, arms in _stations(job, goal):
        found = _asked(job, part, nodes, arms)
        diagnoses += found
        if not causes and not any(entry.works for entry in found):
            causes, blocked = _no_grasps(job, found) or _decisive(found), _nearest(job, found)
            where = f"{_NO_GRASP} of {part} works {'where it is' if nodes[0].name == _HERE else 'at its goal'}"
    if not causes:
        where, causes = _no_way(job, goal, error, attempts)
    blocked = blocked or _standing(job, goal, causes)
    notes = [*_held(job, diagnoses), *notes]
    return Report(number, where, tuple(causes), tuple(diagnoses), attempts, tuple(notes), blocked)


def reasons_for_no_order(job: Job, goals: Sequence[Goal], error: PlanningError) -> Report:
    """Why ``goals``, free in their order, are not all reached: the first that would not even be reached as the first.

    Where there is none, what stopped which order.
    """
    for number, goal in enumerate(goals):
        with suppress(InputError):  # what it shall rest on is yet to come
            report = reasons(job, number, goal, error)
            if report.where.startswith(_NO_GRASP):
                return report
    return Report(None, "the goals are not reached in any order", (), notes=tuple(getattr(error, "report", ())))


def _stations(job: Job, goal: Goal) -> Iterator[tuple[str, Sequence[Node], Sequence[str]]]:
    """Where the goal's parts must be taken and brought, by which arms; at each some grasp must work."""
    arms = tuple(job.cell.robot.hands)
    for part in map(job.root, _parts(goal)):
        if job.held(part) is None:
            yield part, [Node(_HERE, job.pose(part), job.rests_on(part))], arms
    if goal.attach is not None and goal.attach.where is not None:
        yield from _joined_at(job, goal.attach, goal.attach.where, arms)
    root = job.root(_parts(goal)[0])
    if goal.place is not None:
        with suppress(NoRegraspError):  # an area without room for the part is told by the search
            yield root, place_nodes(job, goal.place)[:_MOST_NODES], _pinned(goal.place.arm, arms)
    elif goal.hand_over is not None:
        yield root, hold_nodes(job, goal.hand_over)[:_MOST_NODES], (goal.hand_over.to,)
    elif goal.use is not None:
        for nodes in reversed(stroke_nodes(job, goal.use)):
            yield root, nodes[:_MOST_NODES], _pinned(goal.use.arm, arms)


def _joined_at(
    job: Job, goal: Attach, where: At, arms: Sequence[str]
) -> Iterator[tuple[str, Sequence[Node], Sequence[str]]]:
    """Where two parts must be held, before the straight way, to be joined at the pose ``where`` of the other."""
    world_from_to = pinned_pose(job, goal, where)
    before = world_from_to @ insertion_of(job, goal).before()
    for root, there, arm in (
        (job.root(goal.to), world_from_to, goal.to_arm),
        (job.root(goal.part), before @ invert(job.pose(goal.part)) @ job.pose(job.root(goal.part)), goal.arm),
    ):
        if job.held(root) is None:
            yield root, [Node(f"{root} at its goal", there, None, to_leave=False)], _pinned(arm, arms)


def _parts(goal: Goal) -> list[str]:
    """The parts that ``goal`` moves, the one it is about first."""
    return [goal.asked.part, *([goal.attach.to] if goal.attach is not None else [])]


def _pinned(arm: str | None, arms: Sequence[str]) -> Sequence[str]:
    return arms if arm is None else (arm,)


def _asked(job: Job, part: str, nodes: Sequence[Node], arms: Sequence[str]) -> list[Diagnosis]:
    reacher = Reacher(job.cell.scene, job.motions.state, part, job.whole(part).holders)
    return [diagnose(reacher, node, arm) for node in nodes for arm in arms]


def _decisive(found: Sequence[Diagnosis]) -> list[tuple[Cause, int]]:
    """The causes that decide; arms that can be there do not keep silent what others, out of reach, would need too."""
    reached, other = Counter[frozenset[Cause]](), Counter[frozenset[Cause]]()
    for entry in found:
        (reached if entry.closest is not None and entry.closest.q is not None else other).update(entry.stopped)
    return decisive([reached, other])


def _no_grasps(job: Job, found: Sequence[Diagnosis]) -> list[tuple[Cause, int]]:
    """Where no hand has a grasp: that none held in simulation, or what dropped the last candidates of planning."""
    if any(entry.planned for entry in found):
        return []
    causes, fallen = Counter[Cause](), Counter[Cause]()
    for part, arm in dict.fromkeys((entry.part, entry.arm) for entry in found):
        hand, grasps = job.cell.robot.hands[arm].name, job.grasps(part, arm)
        if len(grasps):
            causes[Cause(f"{hand} cannot hold what is joined to, or must not be touched of,", (part,))] = len(grasps)
            continue
        if planned := len(job.cell.simulated.get((part, arm), ())):
            fallen[Cause(f"{hand} has no grasp, none held in simulation:", (part,))] = planned
            continue
        last = next((stage for stage in reversed(grasps.record) if stage.taken), None)
        dropped = {reason: n for reason, n in last.dropped.items() if n} if last is not None else {}
        for reason, n in (dropped or {"no place for its pads": 1}).items():
            causes[Cause(f"{hand} has no grasp, {reason}:", (part,))] = n
    return [*fallen.most_common(), *causes.most_common()]


def _held(job: Job, found: Sequence[Diagnosis]) -> Iterator[str]:
    """How many of the grasps that were simulated held."""
    for part, arm in dict.fromkeys((entry.part, entry.arm) for entry in found):
        if (grasps := job.cell.simulated.get((part, arm))) is not None:
            yield f"{len(grasps.held())} of {len(grasps)} grasps of {part} by {grasps.hand} held in simulation"


def _no_way(
    job: Job, goal: Goal, error: PlanningError, attempts: Sequence[Attempt]
) -> tuple[str, list[tuple[Cause, int]]]:
    """What does not work, and why, where grasps work: parts that do not fit, motions, grasps that none share."""
    if goal.attach is not None and (causes := _not_fitting(job, goal.attach)):
        return f"{goal.attach.part} is not joined to {goal.attach.to}", causes
    if attempts:
        return "no motion was found", Counter(_stopping(job, goal, attempt) for attempt in attempts).most_common()
    if isinstance(error, NoMeetingError) and error.why.total():
        causes = [(Cause(words), count) for words, count in error.why.most_common() if count]
        return "no place was found to join them", causes
    return "no way was found", [(Cause(error.cause if isinstance(error, NoRegraspError) else str(error)), 1)]


def _not_fitting(job: Job, goal: Attach) -> list[tuple[Cause, int]]:
    """What of parts and hands keeps two parts from being joined, wherever that is."""
    if in_the_way(job, goal):
        return [(Cause("parts touch on the straight way:", (goal.part, goal.to)), 1)]
    causes: Counter[Cause] = Counter()
    for part, other, left, planned in ways_left(job, goal):
        if not left and planned:
            causes[Cause(f"every hand on {part} is in the way of", (other,))] += planned
    return causes.most_common()


def _stopping(job: Job, goal: Goal, attempt: Attempt) -> Cause:
    """What a motion was not found for: what stands around, if that is in the way."""
    moved = [job.root(part) for part in _parts(goal)]
    around = tuple(body for body in attempt.bodies if body in job.cell.scene.bodies and body not in moved)
    bodies = around or attempt.bodies
    return Cause("motion blocked by", bodies) if bodies else Cause(attempt)


def _nearest(job: Job, found: Sequence[Diagnosis]) -> Blocked | None:
    """The candidate of all that were asked that comes nearest to working."""
    asked = [(entry, entry.closest) for entry in found if entry.closest is not None]
    if not asked:
        return None
    entry, closest = min(asked, key=lambda pair: (roots(pair[1].causes), pair[1].q is None))
    scene, holder = job.cell.scene, job.whole(entry.part).holders[entry.arm]
    reacher = Reacher(scene, job.motions.state, entry.part, {entry.arm: holder})
    grasps = holder.grasps
    opening = float((grasps.approach_opening if entry.node.to_leave else grasps.opening)[closest.grasp])
    state, place = reacher.state_at(entry.node).with_opening(entry.arm, opening), entry.node.world_from_part[:3, 3]
    if closest.q is not None:
        return Blocked(scene, place, state.with_q(closest.q), closest.causes, None)
    base = entry.node.world_from_part @ holder.part_from_flange[closest.grasp] @ holder.arm.flange_from_base
    return Blocked(scene, place, state, closest.causes, (entry.arm, base))


def _standing(job: Job, goal: Goal, causes: Sequence[tuple[Cause, int]]) -> Blocked:
    """Everything where it is, to see what the ``causes`` name."""
    place = job.pose(job.root(_parts(goal)[0]))[:3, 3]
    return Blocked(job.cell.scene, place, job.motions.state, frozenset(cause for cause, _ in causes), None)
