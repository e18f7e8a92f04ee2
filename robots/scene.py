"""A robot among bodies: the one door to their states and to collision checks between them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy.typing as npt

from ..errors import InputError, UnknownNameError
from ..transforms import Array, checked_pose, invert
from .collision import CollisionEngine, StateChecker
from .robot import Robot
from .state import CONTACT_TOLERANCE, Attachment, Body, Margins, SceneState

_MOST_TOLERANCE = 0.01  # m


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot among bodies.

    Attributes:
        robot: The robot with its hands.
        bodies: Parts and obstacles by name.
        margins: Distances to keep.
        contact_tolerance: How far bodies in contact may sink into each other [m].

    Raises:
        InputError: The tolerance is no small distance.
    """

    robot: Robot
    bodies: Mapping[str, Body]
    margins: Margins = field(default_factory=Margins)
    contact_tolerance: float = CONTACT_TOLERANCE

    def __post_init__(self) -> None:
        if not 0.0 <= self.contact_tolerance <= _MOST_TOLERANCE:
            cure = f"give 0 to {_MOST_TOLERANCE} m"
            raise InputError("contact_tolerance", f"{self.contact_tolerance} m is no tolerance", cure)

    @classmethod
    def of(
        cls,
        robot: Robot,
        bodies: Iterable[Body],
        margins: Margins | None = None,
        contact_tolerance: float = CONTACT_TOLERANCE,
    ) -> Scene:
        """A scene of ``robot`` and ``bodies``.

        Raises:
            InputError: Two things have the same name.
        """
        listed = list(bodies)
        pieces = [f"{arm}/{piece.name}" for arm, hand in robot.hands.items() for piece in hand.pieces]
        taken = [link.name for link in robot.links] + pieces + list(robot.arms) + [body.name for body in listed]
        double = [name for i, name in enumerate(taken) if name in taken[:i] and name in {b.name for b in listed}]
        if double:
            raise InputError("scene", f"the name {double[0]!r} is taken", "give every body a name of its own")
        return cls(robot, {body.name: body for body in listed}, margins or Margins(), contact_tolerance)

    def state(
        self,
        poses: Mapping[str, npt.ArrayLike],
        q: npt.ArrayLike | None = None,
        openings: Mapping[str, float] | None = None,
    ) -> SceneState:
        """A checked state: ``poses`` (4, 4) of all bodies; home and open hands unless given.

        Raises:
            InputError: A body is missing or unknown, a pose is not rigid, an opening is outside the stroke, or ``q`` is
                no configuration within the limits.
        """
        for name in poses:
            if name not in self.bodies:
                raise UnknownNameError("poses", "body", name, tuple(self.bodies))
        for name in self.bodies:
            if name not in poses:
                raise InputError(f"pose of {name}", "missing", "give a pose (4, 4) for every body of the scene")
        widest = {name: hand.stroke[1] for name, hand in self.robot.hands.items()}
        asked = {**widest, **(openings or {})}
        return SceneState(
            q=self.robot.home if q is None else self.robot.checked_configuration(q),
            openings={name: self.robot.arm(name).checked_opening(opening) for name, opening in asked.items()},
            poses={name: checked_pose(pose, f"pose of {name}") for name, pose in poses.items()},
        )

    def world_from_body(self, state: SceneState, body: str) -> Array:
        """Pose (4, 4) of ``body`` in the world.

        Raises:
            UnknownNameError: There is no such body.
        """
        arm, pose = state.carrier(body)
        return self.robot.flange(arm, state.q) @ pose if arm else pose

    def checker(self, state: SceneState, working: Collection[str] = ()) -> StateChecker:
        """The collision checker of ``state`` at any configuration; hands of arms in ``working`` keep no margins.

        Raises:
            InputError: An opening lies outside the stroke.
            UnknownNameError: There is no arm that is working, or no body that a contact names.
        """
        for arm in working:
            self.robot.arm(arm)
        return self._engine.checker(state, working)

    def touching(self, state: SceneState) -> tuple[tuple[str, str], ...]:
        """Names of all touching pairs in ``state``.

        Raises:
            InputError: Its configuration has the wrong length or lies outside the limits, or an opening does.
        """
        return self.checker(state).touching(self.robot.checked_configuration(state.q, "state"))

    @cached_property
    def _engine(self) -> CollisionEngine:
        return CollisionEngine(self.robot, self.bodies, self.margins, self.contact_tolerance)

    def attach(self, state: SceneState, body: str, carrier: str) -> SceneState:
        """``state`` with ``body`` carried, as it stands now, by an arm's hand or by another body.

        Raises:
            InputError: The body is an obstacle, or carries the carrier itself.
            UnknownNameError: There is no such body or carrier.
        """
        world_from_body = self.world_from_body(state, body)
        if self.bodies[body].fixed:
            raise InputError(f"attach {body}", "it is an obstacle", "make it a part (fixed=False)")
        above = carrier
        while above in state.attached and above != body:
            above = state.attached[above].carrier
        if above == body:
            raise InputError(f"attach {body}", f"{carrier} is carried by it", "attach it to something else")
        if carrier in self.robot.arms:
            world_from_carrier = self.robot.flange(carrier, state.q)
        else:
            world_from_carrier = self.world_from_body(state, carrier)
        entry = Attachment(carrier, invert(world_from_carrier) @ world_from_body)
        poses = {name: pose for name, pose in state.poses.items() if name != body}
        return replace(state, poses=poses, attached={**state.attached, body: entry})

    def detach(self, state: SceneState, body: str) -> SceneState:
        """``state`` with ``body`` left where it is, carried by nothing.

        Raises:
            UnknownNameError: Nothing carries it.
        """
        if body not in state.attached:
            raise UnknownNameError("detach", "attached body", body, tuple(state.attached))
        return state.with_pose(body, self.world_from_body(state, body))
