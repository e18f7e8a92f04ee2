"""Goals reached, in their order if they have one; insertions straight and whole; arms home at the end."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from ..transforms import invert, pose, transform_points
from .document import Plan
from .task import Area, Attach, Goal, Place
from .verify_cell import Cell
from .verify_faults import Findings
from .verify_holds import REACHED, Stretch
from .verify_interlock import apart
from .verify_motion import SAME, Curve
from .verify_rest import BELOW, touched
from .verify_use import Uses
from .verify_ways import allowed, crooked, looks, off, unit

_UPRIGHT = float(np.deg2rad(1.0))


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
        self._uses = Uses(plan, cell, curves, ends)
        flanges = [cell.flanges(curve.values[-1:]) for curve in curves]
        self._poses = [
            {part: where[0] for part, where in end.poses(at).items()} for end, at in zip(ends, flanges, strict=True)
        ]

    def check(self) -> None:
        """Look at all goals, and at the way home."""
        goals, last = self._cell.task.goals, len(self._ends) - 1
        moments = self._moments()
        for number, (goal, moment) in enumerate(zip(goals, moments, strict=True)):
            if goal.attach is not None:
                self._check_insertion(goal.attach)
            if moment is None or goal.hand_over or goal.use:
                continue
            later = goals[number + 1 :]
            if self._cell.task.order == "free":
                later = tuple(g for g, when in zip(goals, moments, strict=True) if when is not None and when > moment)
            missed = self._missed(goal, last)
            if missed and not self._taken_on(goal, later):
                self._report("goal", f"goal {number} is undone at the end: {missed}", last, _named(goal))
        if self._cell.task.end == "home":
            self._check_home()

    def _moments(self) -> list[int | None]:
        """The action at whose end each goal is first reached; none, and a fault, where it is not.

        In a fixed order that is not before the goal before it. In a free one it is one of the goal's own actions, if it
        has any: it may be reached from the start. A tool is used by a press of the goal's own in either.
        """
        free, last = self._cell.task.order == "free", len(self._ends) - 1
        moments: list[int | None] = []
        since = 0
        for number, goal in enumerate(self._cell.task.goals):
            mine = [k for k, action in enumerate(self._plan.actions) if action.goal == number]
            mine = [k for k in mine if goal.use is None or self._plan.actions[k].kind == "press"]
            ks = mine if goal.use or (free and mine) else range(since, last + 1)
            reached = [k for k in ks if k >= since and not self._missed(goal, k)]
            flaws = {k: self._flaw(goal, k) for k in reached}
            moment = next((k for k in reached if not flaws[k]), next(iter(reached), None))
            moments.append(moment)
            if moment is None:
                at = max(mine[-1] if mine else last, since)
                self._report("goal", f"goal {number} is not reached: {self._missed(goal, at)}", at, _named(goal))
                continue
            if flaws[moment]:
                self._report("use" if goal.use else "interlock", flaws[moment], moment, _named(goal))
            since = 0 if free else moment
        return moments

    def _report(self, name: str, words: str, k: int, bodies: tuple[str, ...]) -> None:
        self._findings.add(name, words, action=k, time=self._ends[k].end, bodies=bodies)

    def _flaw(self, goal: Goal, k: int) -> str:
        """What is wrong with how the goal was reached after action ``k``; empty if nothing is."""
        if goal.use is not None:
            return self._uses.flaw(goal.use, k)
        if goal.hand_over is not None and goal.hand_over.interlocked:
            return apart(goal.hand_over, self._plan, self._cell, self._curves, self._ends, k)
        return ""

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
            missed = off(part, invert(poses[to]) @ poses[part], pose(goal.attach.at.xyz, goal.attach.at.rpy))
            wrong = "" if right else f"{part} on {to} is held by {hands}, and the goal says {goal.attach.then}"
            return (wrong or missed) if attached else f"{part} is not attached to {to}"
        if goal.place is not None:
            if hands != "nothing" or goal.place.arm not in (None, self._released_by(goal.place, k)):
                return f"{part} is held by {hands}, or was not put down by the {goal.place.arm or 'right'} arm"
            if goal.place.area is not None:
                return self._astray(part, goal.place.area, k)
            assert goal.place.at is not None
            return off(part, poses[part], allowed(goal.place.at, goal.place.any_turn, poses[part]))
        if goal.hand_over is not None:
            missed = off(part, poses[part], allowed(goal.hand_over.at, goal.hand_over.any_turn, poses[part]))
            return missed if hands == goal.hand_over.to else f"{part} is held by {hands}"
        return self._uses.missed(goal.use, k) if goal.use is not None else "it says nothing"

    def _astray(self, part: str, area: Area, k: int) -> str:
        """What keeps a part, with what it is assembled to, from lying in an area as that asks; empty if nothing."""
        cell, poses, members = self._cell, self._poses[k], self._ends[k].assembly(part)
        on = cell.standing[area.on]
        if not touched(cell, members, poses, {area.on: on}, BELOW):
            return f"{part} does not lie on {area.on}"
        if area.up is not None:
            tilt = np.arccos(np.clip((poses[part][:3, :3] @ unit(area.up))[2], -1.0, 1.0))
            if tilt > _UPRIGHT:
                return f"{part} is {np.rad2deg(tilt):.2f} deg off the direction that shall point up"
        meshes = cell.solids.meshes
        within = transform_points(on, meshes[cell.number[area.on]].vertices)[:, :2]
        if area.corners is not None:
            (x, y), (u, v) = area.corners
            within = np.array([[x, y], [u, y], [u, v], [x, v]])
        outline = np.concatenate([transform_points(poses[m], meshes[cell.number[m]].vertices) for m in members])[:, :2]
        sides = ConvexHull(within).equations
        beyond = (outline @ sides[:, :2].T + sides[:, 2]).max()
        return f"{part} reaches {1e3 * beyond:.2f} mm out of its area" if beyond > REACHED else ""

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
                poses = looks(self._cell, self._curves[k], before, event.time)
                wanted = pose(goal.at.xyz, goal.at.rpy)
                words = crooked(goal.part, invert(poses[goal.to]) @ poses[goal.part], wanted, goal.insert)
                words = words or self._elsewhere(goal, k, before)
                if words:
                    self._findings.add("insertion", words, action=k, time=event.time, bodies=[goal.part, goal.to])

    def _elsewhere(self, goal: Attach, k: int, before: Stretch) -> str:
        for part, arm in ((goal.part, goal.arm), (goal.to, goal.to_arm)):
            if arm is not None and arm not in before.hands(before.assembly(part)):
                return f"{part} is not held by the {arm} arm"
        if goal.where is None:
            return ""
        return off(goal.to, self._poses[k][goal.to], pose(goal.where.xyz, goal.where.rpy))

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
    return tuple(entry.part for entry in (goal.place, goal.hand_over, goal.use) if entry is not None)
