"""Goals reached, each in its turn; insertions straight and whole; arms home at the end."""

from __future__ import annotations

import numpy as np

from ..transforms import Array, invert, pose, pose_distance
from .document import Plan
from .task import At, Attach, Goal, Place
from .verify_cell import Cell
from .verify_faults import Findings
from .verify_holds import REACHED, TURNED, Stretch
from .verify_motion import SAME, Curve

OFF_LINE = 0.3e-3  # m
OFF_TURN = float(np.deg2rad(0.3))
_LOOKS = 20  # along each segment of an insertion


class Goals:
    """The goals of a plan against what its actions do.

    Args:
        plan: The plan.
        cell: Its cell.
        curves: The curve of each action.
        ends: What carries what at the end of each action.
        findings: Where faults go.
    """

    def __init__(self, plan: Plan, cell: Cell, curves: list[Curve], ends: list[Stretch], findings: Findings) -> None:
        self._plan, self._cell, self._curves, self._ends, self._findings = plan, cell, curves, ends, findings
        flanges = [cell.flanges(curve.values[-1:]) for curve in curves]
        self._poses = [
            {part: where[0] for part, where in end.poses(at).items()} for end, at in zip(ends, flanges, strict=True)
        ]

    def check(self) -> None:
        """Look at all goals, in their order, and at the way home."""
        goals, last = self._cell.task.goals, len(self._ends) - 1
        moment = 0
        for number, goal in enumerate(goals):
            misses = [self._missed(goal, k) for k in range(moment, last + 1)]
            mine = [k for k, action in enumerate(self._plan.actions) if action.goal == number]
            at = mine[-1] if mine else last
            if all(misses):
                words = f"goal {number} is not reached: {self._missed(goal, max(at, moment))}"
                self._report("goal", words, max(at, moment), _named(goal))
                continue
            moment += next(k for k, missed in enumerate(misses) if not missed)
            if misses[-1] and not goal.hand_over and not self._taken_on(goal, goals[number + 1 :]):
                words = f"goal {number} is undone at the end: {misses[-1]}"
                self._report("goal", words, last, _named(goal))
        for goal in goals:
            if goal.attach is not None:
                self._check_insertion(goal.attach)
        if self._cell.task.end == "home":
            self._check_home()

    def _report(self, name: str, words: str, k: int, bodies: tuple[str, ...]) -> None:
        self._findings.add(name, words, action=k, time=self._ends[k].end, bodies=bodies)

    def _missed(self, goal: Goal, k: int) -> str:
        """What is missing to the goal at the end of action ``k``; empty if it is reached."""
        end, poses = self._ends[k], self._poses[k]
        part = _named(goal)[0]
        hands = " and ".join(end.hands(end.assembly(part))) or "nothing"
        if goal.attach is not None:
            to = goal.attach.to
            attached = to in [hold.carrier for hold in end.holds[part]]
            then = "place" if hands == "nothing" else "hold"
            right = then == goal.attach.then or (then == "place" and self._stood(goal.attach))
            off = _off(part, invert(poses[to]) @ poses[part], goal.attach.at)
            wrong = "" if right else f"{part} on {to} is held by {hands}, and the goal says {goal.attach.then}"
            return (wrong or off) if attached else f"{part} is not attached to {to}"
        if goal.place is not None:
            arm = goal.place.arm
            held = hands == "nothing" and arm in (None, self._released_by(goal.place, k))
            wrong = f"{part} is held by {hands}, or was not put down by the {arm or 'right'} arm"
            return _off(part, poses[part], goal.place.at) if held else wrong
        if goal.hand_over is not None:
            off = _off(part, poses[part], goal.hand_over.at)
            return off if hands == goal.hand_over.to else f"{part} is held by {hands}"
        return "it says nothing"

    def _stood(self, goal: Attach) -> bool:
        """Whether the part that another is joined to stood somewhere then: there is nothing to be held on to."""
        for before, action in zip(self._ends, self._plan.actions[1:], strict=False):
            if any((e.kind, e.part, e.carrier) == ("attach", goal.part, goal.to) for e in action.events):
                return not before.hands(before.assembly(goal.to))
        return False

    def _released_by(self, goal: Place, k: int) -> str | None:
        """The arm that last let go of the part of ``goal``, or of what it is assembled to, up to action ``k``."""
        whole = self._ends[k].assembly(goal.part)
        events = [event for action in self._plan.actions[: k + 1] for event in action.events]
        return next((e.carrier for e in reversed(events) if e.kind == "detach" and e.part in whole), None)

    def _taken_on(self, goal: Goal, later: tuple[Goal, ...]) -> bool:
        """Whether later goals move the part of ``goal``, so that its place need not last."""
        whole = frozenset().union(*(self._ends[-1].assembly(part) for part in _named(goal)))
        return any(whole & set(_named(other)) for other in later)

    def _check_insertion(self, goal: Attach) -> None:
        """The part came straight, over the whole distance, held by the arms and at the place that the goal pins."""
        for k, action in enumerate(self._plan.actions):
            for event in action.events:
                if (event.kind, event.part, event.carrier) != ("attach", goal.part, goal.to):
                    continue
                before = self._ends[k - 1] if k else self._ends[0]
                words = self._crooked(goal, k, event.time, before) or self._elsewhere(goal, k, before)
                if words:
                    self._findings.add("insertion", words, action=k, time=event.time, bodies=[goal.part, goal.to])

    def _crooked(self, goal: Attach, k: int, end: float, before: Stretch) -> str:
        curve = self._curves[k]
        knots = np.append(curve.times[curve.times < end], end)
        places = np.linspace(0.0, len(knots) - 1.0, _LOOKS * (len(knots) - 1) + 1)
        poses = before.poses(self._cell.flanges(curve.at(np.interp(places, np.arange(len(knots)), knots))))
        to_from_part = invert(poses[goal.to]) @ poses[goal.part]
        wanted, way = pose(goal.at.xyz, goal.at.rpy), np.array(goal.insert.direction)
        way /= np.linalg.norm(way)
        offset = to_from_part[:, :3, 3] - wanted[:3, 3]
        left = -offset @ way
        short = float(goal.insert.distance) - left[0]
        if short > OFF_LINE:
            return f"{goal.part} comes straight for {1e3 * left[0]:.2f} mm, {1e3 * short:.2f} mm too short a way"
        inside = left <= goal.insert.distance
        aside = np.linalg.norm(offset + left[:, None] * way, axis=1)[inside].max(initial=0.0)
        turned = pose_distance(to_from_part, wanted)[1][inside].max(initial=0.0)
        if aside > OFF_LINE or turned > OFF_TURN:
            return f"{goal.part} comes {1e3 * aside:.2f} mm and {np.rad2deg(turned):.2f} deg off the straight way"
        return ""

    def _elsewhere(self, goal: Attach, k: int, before: Stretch) -> str:
        for part, arm in ((goal.part, goal.arm), (goal.to, goal.to_arm)):
            if arm is not None and arm not in before.hands(before.assembly(part)):
                return f"{part} is not held by the {arm} arm"
        return "" if goal.where is None else _off(goal.to, self._poses[k][goal.to], goal.where)

    def _check_home(self) -> None:
        machine, end, values = self._cell.machine, self._ends[-1], self._curves[-1].values[-1]
        for arm, (joints, _) in machine.arms.items():
            off = np.abs(values[joints] - machine.home[joints])
            if not _holds(end, arm) and off.max() > SAME:
                joint = machine.joint_names[int(joints[off.argmax()])]
                words = f"{joint} of the {arm} arm, whose hand is empty, ends {off.max():.6f} off home"
                self._report("end", words, len(self._ends) - 1, (joint,))


def _holds(stretch: Stretch, arm: str) -> bool:
    return any(arm == hold.carrier for holds in stretch.holds.values() for hold in holds)


def _named(goal: Goal) -> tuple[str, ...]:
    """The parts that a goal names."""
    if goal.attach is not None:
        return goal.attach.part, goal.attach.to
    return tuple(entry.part for entry in (goal.place, goal.hand_over) if entry is not None)


def _off(part: str, at: Array, wanted: At) -> str:
    """By how much a part misses a pose; empty if it is there."""
    apart, turned = (float(x) for x in pose_distance(at, pose(wanted.xyz, wanted.rpy)))
    if apart <= REACHED and turned <= TURNED:
        return ""
    return f"{part} is {1e3 * apart:.3f} mm and {np.rad2deg(turned):.3f} deg off"
