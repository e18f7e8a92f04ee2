"""Who carries what, followed through a plan's events with the verifier's own kinematics."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..transforms import Array, invert, pose, pose_distance, transform_points
from .document import Action, Event, GraspUse, Plan, State
from .verify_cell import Cell
from .verify_faults import Findings
from .verify_motion import SAME, Curve

REACHED = 1e-4  # m
TURNED = float(np.deg2rad(0.1))
ON_SURFACE = 1e-3  # m
_PAIR_OFF = 3e-3  # m that the farther finger of a pair may hang above the surface, unless the task says
_LIP_POINTS = 36
_DOT = 1e-6  # m; triangles that small stand for points


@dataclass(frozen=True, eq=False)
class Hold:
    """A carrier (an arm, by its flange, or a part) and the pose (4, 4) of what it carries in its frame."""

    carrier: str
    carrier_from_part: Array


@dataclass(frozen=True, eq=False)
class Stretch:
    """A time within one action in which nothing is taken or let go.

    Attributes:
        action: Number of the action.
        start: Its beginning in the action [s].
        end: Its end.
        holds: What carries each part, the latest last; that one moves it.
        standing: Pose (4, 4) in the world of the parts that nothing carries.
    """

    action: int
    start: float
    end: float
    holds: Mapping[str, tuple[Hold, ...]]
    standing: Mapping[str, Array]

    def poses(self, flanges: Mapping[str, Array]) -> dict[str, Array]:
        """Poses ((n or 1), 4, 4) of all parts in the world, the flanges being at (n, 4, 4)."""
        poses = {part: where[None] for part, where in self.standing.items()}
        left = [part for part, holds in self.holds.items() if holds]
        while left:
            for part in list(left):
                hold = self.holds[part][-1]
                frame = flanges.get(hold.carrier, poses.get(hold.carrier))
                if frame is not None:
                    poses[part] = frame @ hold.carrier_from_part
                    left.remove(part)
        return poses

    def root(self, part: str) -> str:
        """The arm that moves a part, directly or through others, or the part at the bottom that nothing carries."""
        while holds := self.holds.get(part, ()):
            part = holds[-1].carrier
        return part

    @property
    def carriers(self) -> dict[str, str]:
        """The arm that moves each part that one moves."""
        roots = {part: self.root(part) for part in self.holds}
        return {part: root for part, root in roots.items() if root not in self.holds}

    def assembly(self, part: str) -> frozenset[str]:
        """The parts that are attached to ``part``, to what it is attached to, and so on; itself too."""
        joints = [{p, hold.carrier} for p, holds in self.holds.items() for hold in holds if hold.carrier in self.holds]
        members = {part}
        while reached := set().union(*(both for both in joints if both & members)) - members:
            members |= reached
        return frozenset(members)

    def hands(self, parts: frozenset[str]) -> tuple[str, ...]:
        """The arms that hold one of ``parts``."""
        held = {hold.carrier for part in parts for hold in self.holds[part]}
        return tuple(sorted(held - set(self.holds)))


def follow(plan: Plan, cell: Cell, curves: list[Curve], findings: Findings) -> tuple[list[Stretch], list[Stretch]]:
    """Every stretch of the plan, and what carries what at the end of each action.

    Faults of events, grips and states are found on the way.
    """
    now = Stretch(
        action=0,
        start=0.0,
        end=0.0,
        holds=dict.fromkeys(cell.task.parts, ()),
        standing={part: pose(entry.at.xyz, entry.at.rpy) for part, entry in cell.task.parts.items()},
    )
    stretches: list[Stretch] = []
    ends: list[Stretch] = []
    for i, (action, curve) in enumerate(zip(plan.actions, curves, strict=True)):
        now = replace(now, action=i, start=0.0, end=0.0)
        before = len(stretches)
        events = _Events(cell, curve, action, i, findings)
        for event in action.events:
            if event.time > now.start:
                stretches.append(replace(now, end=event.time))
            now = replace(events.applied(event, now), start=event.time)
        if now.start < curve.times[-1] or len(stretches) == before:
            stretches.append(replace(now, end=float(curve.times[-1])))
        ends.append(replace(now, start=float(curve.times[-1]), end=float(curve.times[-1])))
        _check_state(action.end, now, cell, curve, i, findings)
    for stretch in stretches:
        _check_grips(stretch, cell, curves[stretch.action], findings)
    _check_grasps(plan, cell, findings)
    return stretches, ends


def _check_grasps(plan: Plan, cell: Cell, findings: Findings) -> None:
    """An action that names a grasp names that by which one of its hands took a part last, or takes one next."""
    takes = dict[str, list[int]]({arm: [] for arm in cell.machine.arms})
    for i, action in enumerate(plan.actions):
        for arm in {event.carrier for event in action.events if event.kind == "attach"} & takes.keys():
            takes[arm].append(i)
    for i, action in enumerate(plan.actions):
        near: list[int] = []
        for arm in action.arms:
            last, following = bisect_right(takes[arm], i) - 1, bisect_left(takes[arm], i)
            near += takes[arm][max(last, 0) : following + 1]
        if action.grasp is not None and not any(_alike(action.grasp, plan.actions[k].grasp) for k in near):
            hands = " and ".join(action.arms)
            findings.add("grasp", f"{hands} neither took a part by this grasp nor take one so next", action=i)


def _alike(one: GraspUse, other: GraspUse | None) -> bool:
    if other is None:
        return False
    apart = np.abs(np.array(one.part_from_hand) - np.array(other.part_from_hand)).max()
    return max(float(apart), abs(one.opening - other.opening)) <= SAME


def _check_grips(stretch: Stretch, cell: Cell, curve: Curve, findings: Findings) -> None:
    """Hands that hold something stay as they are; nothing moves while a part or an assembly is held twice."""
    moving = curve.moving(stretch.start, stretch.end)
    for part, holds in stretch.holds.items():
        for arm in (hold.carrier for hold in holds if hold.carrier in cell.hands):
            if moving[len(cell.order) + cell.hands.index(arm)]:
                words = f"the {arm} hand opens or closes while it holds {part}"
                findings.add("grip", words, action=stretch.action, time=stretch.start, bodies=[arm, part])
    for part in stretch.holds:
        hands = stretch.hands(stretch.assembly(part))
        stands = stretch.root(part) in stretch.holds
        if len(hands) + stands > 1 and hands and moving[: len(cell.order)].any():
            joint = cell.columns[int(np.argmax(moving))]
            both = " and ".join([*hands, *(["what it stands on"] if stands else [])])
            words = f"{joint} moves while {both} hold {part}"
            findings.add("two-hands", words, action=stretch.action, time=stretch.start, bodies=[*hands, part])


def _check_state(state: State, now: Stretch, cell: Cell, curve: Curve, i: int, findings: Findings) -> None:
    """A state at an action's end against carriers and kinematics."""
    end, at = float(curve.times[-1]), curve.values[-1:]
    poses = now.poses(cell.flanges(at))
    for part, where in poses.items():
        apart, turned = (float(x) for x in pose_distance(where[0], np.array(state.poses[part])))
        if max(apart, turned) > SAME:
            name = "slip" if now.holds[part] else "moved"
            words = f"{part} is {1e3 * apart:.4f} mm and {np.rad2deg(turned):.4f} deg off"
            findings.add(name, words, action=i, time=end, bodies=[part])
        hold, told = now.holds[part][-1:], state.attached.get(part)
        if (told.carrier if told else None) != (hold[0].carrier if hold else None):
            words = f"{part} is carried by {hold[0].carrier if hold else 'nothing'}, the state says "
            findings.add("attached", words + (told.carrier if told else "nothing"), action=i, time=end, bodies=[part])
        elif told is not None:
            off = np.abs(np.array(told.carrier_from_part) - hold[0].carrier_from_part).max()
            if off > SAME:
                words = f"{part} is {1e3 * off:.4f} mm or milliradian elsewhere in {told.carrier} than the state says"
                findings.add("attached", words, action=i, time=end, bodies=[part, told.carrier])


class _Events:
    """The events of one action."""

    def __init__(self, cell: Cell, curve: Curve, action: Action, number: int, findings: Findings) -> None:
        self._cell, self._curve, self._action, self._number, self._findings = cell, curve, action, number, findings

    def applied(self, event: Event, now: Stretch) -> Stretch:
        """What is carried after an event."""
        kind = {"attach": "close", "detach": "open"}[event.kind] if event.carrier in self._cell.hands else "insert"
        if self._action.kind != kind:
            self._fault(
                "kind", event, f"{event.kind} {event.part} in an action that is {self._action.kind}, not {kind}"
            )
        at = self._curve.at(np.array([event.time]))
        poses = now.poses(self._cell.flanges(at))
        holds = now.holds[event.part]
        held = event.carrier in [hold.carrier for hold in holds]
        if event.kind == "detach":
            if not held:
                self._fault("carrier", event, f"{event.carrier} lets {event.part} go, which it does not hold")
                return now
            if event.carrier not in self._cell.hands:
                self._fault("assembly", event, f"{event.part} is parted from {event.carrier}")
            left = tuple(hold for hold in holds if hold.carrier != event.carrier)
            standing = now.standing if left else {**now.standing, event.part: poses[event.part][0]}
            return replace(now, holds={**now.holds, event.part: left}, standing=standing)
        if held or event.carrier in now.assembly(event.part):
            self._fault("carrier", event, f"{event.carrier} takes {event.part}, which is joined to it already")
            return now
        if event.carrier in self._cell.hands:
            self._check_hand(event, now, at, poses[event.part][0])
            frame = self._cell.flanges(at)[event.carrier][0]
        else:
            frame = poses[event.carrier][0]
            self._check_joining(event, invert(frame) @ poses[event.part][0])
        taken = (*holds, Hold(event.carrier, invert(frame) @ poses[event.part][0]))
        standing = {part: where for part, where in now.standing.items() if part != event.part}
        return replace(now, holds={**now.holds, event.part: taken}, standing=standing)

    def _fault(self, name: str, event: Event, words: str) -> None:
        bodies = [event.part, event.carrier]
        self._findings.add(name, words, action=self._number, time=event.time, bodies=bodies)

    def _check_joining(self, event: Event, to_from_part: Array) -> None:
        """A part is attached to a part: some goal asks for it, at this pose."""
        goals = [goal.attach for goal in self._cell.task.goals if goal.attach is not None]
        asked = [goal.at for goal in goals if (goal.part, goal.to) == (event.part, event.carrier)]
        if not asked:
            self._fault("assembly", event, f"no goal attaches {event.part} to {event.carrier}")
            return
        apart, turned = (float(x) for x in pose_distance(to_from_part, pose(asked[0].xyz, asked[0].rpy)))
        if apart > REACHED or turned > TURNED:
            off = f"{1e3 * apart:.3f} mm and {np.rad2deg(turned):.3f} deg"
            self._fault("assembly", event, f"{event.part} is attached {off} off its place on {event.carrier}")

    def _check_hand(self, event: Event, now: Stretch, at: Array, world_from_part: Array) -> None:
        """A hand takes a part: empty, one of the action's, as the grasp says, its pads on the part."""
        arm, part = event.carrier, event.part
        others = [name for name, holds in now.holds.items() if arm in [hold.carrier for hold in holds]]
        if others or arm not in self._action.arms:
            words = f"{arm} takes {part}, but " + (f"holds {others[0]}" if others else "is no arm of the action")
            self._fault("carrier", event, words)
        grasp = self._action.grasp
        opening = float(self._cell.split(at)[1][arm][0])
        if grasp is None:
            self._fault("grasp", event, f"the {arm} hand takes {part}, and the action names no grasp")
        else:
            part_from_hand = invert(world_from_part) @ self._cell.hand(arm, at)[0]
            apart, turned = (float(x) for x in pose_distance(part_from_hand, np.array(grasp.part_from_hand)))
            wider = opening - grasp.opening
            if apart > REACHED or turned > TURNED or abs(wider) > REACHED:
                off = f"{1e3 * apart:.3f} mm, {np.rad2deg(turned):.3f} deg, opening {1e3 * wider:+.3f} mm"
                self._fault("grasp", event, f"the {arm} hand is off its grasp of {part}: {off}")
        off_surface = self._off_surface(arm, part, at, world_from_part)
        if off_surface > 0.0:
            words = f"a pad of the {arm} hand is {1e3 * off_surface:.2f} mm farther from {part} than it may be"
            self._fault("pads", event, words)
        self._check_no_touch(event, at, world_from_part)

    def _check_no_touch(self, event: Event, at: Array, world_from_part: Array) -> None:
        """No piece of the hand that takes a part reaches into a region of it that no hand may touch."""
        cell, arm = self._cell, event.carrier
        q, openings = cell.split(at)
        links = cell.machine.flanges(q)[arm][0] @ cell.machine.grippers[arm].links(openings[arm])[0]
        pieces = [(i, body) for i, body in enumerate(cell.bodies) if body.kind == "hand" and body.arm == arm]
        for k, region in enumerate(cell.task.parts[event.part].no_touch):
            world_from_region = world_from_part @ pose(region.at.xyz, region.at.rpy)
            sides = np.maximum(np.array(region.box) - 2.0 * REACHED, _DOT)
            for i, body in pieces:
                if cell.solids.touches_box(i, links[body.link], sides, world_from_region):
                    self._fault("no-touch", event, f"{body.name} is in region {k} of {event.part}")

    def _off_surface(self, arm: str, part: str, at: Array, world_from_part: Array) -> float:
        """How much farther than allowed the farthest pad, or point of the lip, is from the part [m]."""
        gripper, solids, number = self._cell.machine.grippers[arm], self._cell.solids, self._cell.number[part]
        q, openings = self._cell.split(at)
        flange = self._cell.machine.flanges(q)[arm][0]
        if gripper.lip is not None:
            link, radius, compliance = gripper.lip
            turns = np.linspace(0.0, 2.0 * np.pi, _LIP_POINTS, endpoint=False)
            ring = radius * np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
            points = transform_points(flange @ gripper.links(openings[arm])[0, link], ring)
            dots = points[:, None] + _DOT * np.eye(3)
            gaps = [solids.distance_to_triangles(dot[None], number, world_from_part) for dot in dots]
            return max(gaps) - max(ON_SURFACE, compliance)
        gaps = [
            solids.distance_to_triangles(face[[[0, 1, 2], [0, 2, 3]]], number, world_from_part)
            for face in transform_points(flange, gripper.faces(openings[arm])[0])
        ]
        allowed = self._cell.task.parts[part].grasps.t_dct
        farther = max(gaps[1:]) - (_PAIR_OFF if allowed is None else float(allowed))
        return max(gaps[0] - ON_SURFACE, min(gaps[1:]) - ON_SURFACE, farther if len(gaps) > 2 else -np.inf)
