"""The motions of a job, one after the other: free ones, straight ones and grips, each checked, timed and recorded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..errors import BlockedError, NoPathError, PlanningError, StartInCollisionError
from ..grasping.grasps import GraspSet
from ..robots.grip import plan_grip
from ..robots.motion import plan_motion
from ..robots.scene import Scene
from ..robots.state import Contact, SceneState
from ..robots.straight import LineTolerance, plan_linear
from ..robots.timing import time_motion
from ..robots.trajectory import Trajectory
from ..transforms import Array, invert
from .reach import Holder
from .rest import apart, rest_contacts

Kind = Literal[
    "transit", "approach", "close", "lift", "transfer", "lower", "open", "retreat", "insert", "press", "withdraw"
]
_STILL = 1e-9  # rad: less is no motion
_LINE = LineTolerance()


@dataclass(frozen=True)
class Event:
    """At a step's end (or its start) a carrier, an arm or another part, takes a part or lets it go."""

    kind: Literal["attach", "detach"]
    part: str
    carrier: str
    at_end: bool


@dataclass(frozen=True, eq=False)
class Step:
    """One motion, from one state to the next.

    Attributes:
        kind: What it is for.
        arms: The arms that move, or whose hand does.
        part: The part it is about.
        words: What happens, in words.
        start: Where everything is at its start.
        trajectory: The motion of all joints.
        openings: For each hand that moves, its opening at the start and the end [m].
        events: Takings and lettings go.
        grasp: The grasp (a set of one) with which the arm holds the part, or is about to.
        end: Where everything is at its end.
    """

    kind: Kind
    arms: tuple[str, ...]
    part: str | None
    words: str
    start: SceneState
    trajectory: Trajectory
    openings: Mapping[str, tuple[float, float]]
    events: tuple[Event, ...]
    grasp: GraspSet | None
    end: SceneState


class StepError(PlanningError):
    """A motion of a step was not found.

    Attributes:
        kind: The step's kind.
        arm: The arm.
        part: The part.
        cause: What stopped it.
    """

    def __init__(self, kind: str, arm: str, part: str, cause: PlanningError) -> None:
        """Name the step, and what stopped it."""
        self.kind, self.arm, self.part, self.cause = kind, arm, part, cause
        super().__init__(f"{kind} of {part} by the {arm} arm: {cause}")

    @property
    def bodies(self) -> tuple[str, ...]:
        """The two bodies that stopped it, as far as bodies did."""
        if isinstance(self.cause, NoPathError):
            return self.cause.blocking[0][0] if self.cause.blocking else ()
        pairs = self.cause.pairs if isinstance(self.cause, BlockedError | StartInCollisionError) else ()
        return pairs[0] if pairs else ()


class Attempt(str):
    """A candidate of a search that a motion was not found for: the segment and what stopped it, in words.

    Attributes:
        bodies: The two bodies that stopped it, as far as bodies did.
    """

    bodies: tuple[str, ...]

    def __new__(cls, error: StepError, segment: str = "") -> Attempt:
        """What ``error`` tells, on the way named ``segment``."""
        attempt = super().__new__(cls, f"{segment}: {error}" if segment else str(error))
        attempt.bodies = error.bodies
        return attempt


class Motions:
    """Builds steps, each from the state in which the one before ended.

    Args:
        scene: The scene.
        state: Where everything is.
        speed: Share of the velocity limits to use.
        seed: Seed of the searches for free motions.
        watch: Called before each motion is planned; what it raises ends the planning.
    """

    def __init__(
        self, scene: Scene, state: SceneState, speed: float, seed: int, watch: Callable[[], None] = lambda: None
    ) -> None:
        self.scene, self.state, self.speed, self._seed, self.watch = scene, state, speed, seed, watch
        self.steps: list[Step] = []

    def mark(self) -> tuple[int, SceneState]:
        """Where to come back to with `back_to`."""
        return len(self.steps), self.state

    def back_to(self, mark: tuple[int, SceneState]) -> None:
        """Forget all steps since `mark`."""
        count, self.state = mark
        del self.steps[count:]

    # What hands do with a part ----------------------------------------------------------------------------------------

    def take(self, holder: Holder, part: str, grasp: int, before: Array) -> None:
        """Come to ``part`` from ``before`` (dof,) and close the hand on it; whoever else holds it lets go later.

        Raises:
            StepError: A motion was not found.
        """
        arm, opening = holder.arm.name, float(holder.grasps.approach_opening[grasp])
        self.free(
            {arm: before},
            "transit",
            f"{arm} hand goes to {part}",
            part,
            opening=(arm, opening),
            grasp=holder.row(grasp),
        )
        hand = holder.part_from_flange[grasp] @ holder.arm.flange_from_hand(opening)[0]
        pads, early = holder.pads(part, grasp), holder.open_contacts(part, grasp)
        self.state = self.state.with_contacts([*self.state.contacts, *early])
        self.line(
            arm, self._world_from(part) @ hand, "approach", f"{arm} hand comes to {part}", part, grasp=holder.row(grasp)
        )
        self.state = self.state.with_contacts([*self.state.contacts, *([] if early else pads)])
        attach = Event("attach", part, arm, at_end=True)
        self.grip(
            arm,
            float(holder.grasps.opening[grasp]),
            "close",
            f"{arm} hand takes {part}",
            part,
            (attach,),
            holder.row(grasp),
        )

    def give(self, holder: Holder, part: str, grasp: int) -> None:
        """Let ``part`` go, which now rests or is held by something else, and draw the hand back.

        Raises:
            StepError: A motion was not found.
        """
        arm, opening = holder.arm.name, float(holder.grasps.approach_opening[grasp])
        detach = Event("detach", part, arm, at_end=False)
        self.grip(arm, opening, "open", f"{arm} hand lets {part} go", part, (detach,), holder.row(grasp))
        if not holder.open_contacts(part, grasp):
            self._forget(holder.pads(part, grasp))

    def retreat(self, holder: Holder, part: str, grasp: int, distance: float) -> None:
        """Draw the open hand back by ``distance`` [m] from where it held ``part``.

        Raises:
            StepError: The motion was not found.
        """
        arm = holder.arm.name
        hand = self.scene.robot.hand_pose(arm, self.state.q, self.state.openings[arm])
        hand[:3, 3] -= distance * hand[:3, 2]
        self.line(arm, hand, "retreat", f"{arm} hand leaves {part}", part, grasp=holder.row(grasp))
        if early := holder.open_contacts(part, grasp):
            self._forget(early)

    def lift(self, holder: Holder, part: str, grasp: int, distance: float) -> None:
        """Lift ``part`` straight off what it rests on, by ``distance`` [m].

        Raises:
            StepError: The motion was not found.
        """
        arm = holder.arm.name
        hand = self.scene.robot.hand_pose(arm, self.state.q, self.state.openings[arm])
        hand[2, 3] += distance
        self.line(arm, hand, "lift", f"{arm} hand lifts {part}", part, grasp=holder.row(grasp))
        self.state = apart(self.state, part, kept={contact.second for contact in holder.pads(part, grasp)})

    def lower(self, holder: Holder, part: str, grasp: int, world_from_part: Array, support: str) -> None:
        """Lower ``part`` straight onto ``support``, to its pose (4, 4) there.

        Raises:
            StepError: The motion was not found.
        """
        arm = holder.arm.name
        resting = rest_contacts(self.scene, self.state, support, part)
        self.state = self.state.with_contacts([*self.state.contacts, *resting])
        words = f"{arm} hand puts {part} on {support}"
        self.line(arm, self.hand_for(arm, part, world_from_part), "lower", words, part, grasp=holder.row(grasp))

    def hand_for(self, arm: str, part: str, world_from_part: Array) -> Array:
        """The pose (4, 4) of the hand of ``arm`` that puts ``part``, which it holds, at a pose (4, 4) in the world."""
        flange_from_part = self.state.carrier(part)[1]
        mounted = self.scene.robot.arm(arm)
        pose: Array = world_from_part @ invert(flange_from_part) @ mounted.flange_from_hand(self.state.openings[arm])[0]
        return pose

    # Motions ----------------------------------------------------------------------------------------------------------

    def free(
        self,
        joints: Mapping[str, Array],
        kind: Kind,
        words: str,
        part: str | None,
        *,
        opening: tuple[str, float] | None = None,
        grasp: GraspSet | None = None,
    ) -> None:
        """Bring arms to ``joints`` (dof,) each; arms that carry nothing and are not named go home meanwhile.

        Where those named are there already, it is a transit of the others. With ``opening`` a hand is first brought to
        another opening [m].

        Raises:
            StepError: The motion was not found.
        """
        robot, goal = self.scene.robot, np.array(self.state.q)
        named = next(iter(joints))
        busy = {self.state.carrier(body)[0] for body in self.state.attached}
        for name, arm in robot.arms.items():
            if name in joints or name not in busy:
                goal[arm.indices] = joints.get(name, robot.home[arm.indices])
        if opening is not None and abs(self.state.openings[opening[0]] - opening[1]) > _STILL:
            self.grip(*opening, "open", f"{opening[0]} hand opens for {part}", part, (), grasp)
        moving = [n for n, a in robot.arms.items() if np.abs(goal - self.state.q)[a.indices].max() > _STILL]
        if not moving:
            return
        if joints.keys().isdisjoint(moving):  # what these hold, if anything, stays where it is
            kind, words, part, grasp = "transit", f"{' and '.join(moving)} arm goes home", None, None
        still = np.ones(len(goal), dtype=bool)
        still[robot.indices(moving)] = False
        goal[still] = self.state.q[still]
        self._seed += 1
        self.watch()
        try:
            path = plan_motion(self.scene, self.state, goal, moving, seed=self._seed)
            trajectory = time_motion(self.scene, self.state, path, moving, speed=self.speed)
        except PlanningError as error:
            raise StepError(kind, named, part or "nothing", error) from error
        self._add(kind, tuple(moving), part, words, trajectory, grasp=grasp)

    def line(
        self,
        arm: str,
        world_from_hand: Array,
        kind: Kind,
        words: str,
        part: str,
        *,
        grasp: GraspSet | None = None,
        tolerance: LineTolerance = _LINE,
        events: Sequence[Event] = (),
    ) -> None:
        """Bring a hand straight to a pose (4, 4).

        Raises:
            StepError: The motion was not found.
        """
        self.watch()
        try:
            path = plan_linear(self.scene, self.state, arm, world_from_hand, tolerance=tolerance)
            trajectory = time_motion(
                self.scene, self.state, path, [arm], speed=self.speed, line=tolerance, working={arm}
            )
        except PlanningError as error:
            raise StepError(kind, arm, part, error) from error
        self._add(kind, (arm,), part, words, trajectory, events=tuple(events), grasp=grasp)

    def grip(
        self,
        arm: str,
        opening: float,
        kind: Kind,
        words: str,
        part: str | None,
        events: tuple[Event, ...],
        grasp: GraspSet | None,
    ) -> None:
        """Bring a hand to an opening [m].

        Raises:
            StepError: A finger touches something on the way.
        """
        start = self.state.openings[arm]
        let_go = [event for event in events if not event.at_end]
        during = self._after(self.state, let_go)
        try:
            plan_grip(self.scene, during, arm, opening)
        except PlanningError as error:
            raise StepError(kind, arm, part or "nothing", error) from error
        hand = self.scene.robot.hands[arm]
        # From rest to rest on a cubic curve the fingers are at most 1.5 times as fast as on the mean.
        duration = 1.5 * abs(opening - start) / 2.0 / (hand.speed * self.speed) if hand.speed else 0.0
        trajectory = Trajectory.dwell(self.scene.robot.joint_names, self.state.q, duration)
        self._add(kind, (arm,), part, words, trajectory, {arm: (start, opening)}, events, grasp)

    def _add(
        self,
        kind: Kind,
        arms: tuple[str, ...],
        part: str | None,
        words: str,
        trajectory: Trajectory,
        openings: Mapping[str, tuple[float, float]] | None = None,
        events: tuple[Event, ...] = (),
        grasp: GraspSet | None = None,
    ) -> None:
        end = self.state.with_q(trajectory.positions[-1])
        for arm, (_, opening) in (openings or {}).items():
            end = end.with_opening(arm, opening)
        end = self._after(end, events)
        self.steps.append(Step(kind, arms, part, words, self.state, trajectory, openings or {}, events, grasp, end))
        self.state = end

    def _after(self, state: SceneState, events: Sequence[Event]) -> SceneState:
        """``state`` after ``events``; who lets go of a part that something else has taken changes nothing."""
        for event in events:
            if event.kind == "attach":
                state = self.scene.attach(state, event.part, event.carrier)
            elif event.part in state.attached and state.attached[event.part].carrier == event.carrier:
                state = self.scene.detach(state, event.part)
        return state

    def _forget(self, contacts: Sequence[Contact]) -> None:
        """Take off the contacts of the hand's pieces that are in ``contacts``."""
        pieces = {contact.second for contact in contacts}
        self.state = self.state.with_contacts(c for c in self.state.contacts if c.second not in pieces)

    def _world_from(self, part: str) -> Array:
        return self.scene.world_from_body(self.state, part)
