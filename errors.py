"""One root error, one class per reason; the evidence travels as attributes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path


class KumitateError(Exception):
    """Root of every error that Kumitate raises on purpose."""


class InputError(KumitateError):
    """What the user gave is wrong.

    Attributes:
        place: File, field or argument at fault.
        problem: What is wrong there.
        cure: What to write or do instead.
    """

    def __init__(self, place: str | Path, problem: str, cure: str) -> None:
        """Build the one-line message from place, problem and cure."""
        self.place = str(place)
        self.problem = problem
        self.cure = cure
        super().__init__(f"{place}: {problem}; {cure}")


class UnknownNameError(InputError):
    """A name that does not exist was asked for; the message lists those that do.

    Attributes:
        name: The name asked for.
        known: The names that exist.
    """

    def __init__(self, place: str | Path, kind: str, name: str, known: Sequence[str]) -> None:
        """Name the wrong name and the right ones."""
        self.name = name
        self.known = tuple(known)
        listed = ", ".join(self.known) or "none"
        super().__init__(place, f"there is no {kind} named {name!r}", f"known: {listed}")


class PlanningError(KumitateError):
    """Sound input, but no answer was found."""


class StartInCollisionError(PlanningError):
    """A motion was asked for from a state that already collides.

    Attributes:
        pairs: Names of the touching pairs.
    """

    def __init__(self, what: str, pairs: Sequence[tuple[str, str]]) -> None:
        """Name the touching pairs."""
        self.pairs = tuple(pairs)
        listed = ", ".join(f"{a} / {b}" for a, b in self.pairs)
        super().__init__(f"{what} is in collision: {listed}")


class NoPathError(PlanningError):
    """The motion planner ended without a path.

    Attributes:
        blocking: How often each pair of bodies stopped the search, most frequent first.
    """

    def __init__(self, message: str, blocking: Sequence[tuple[tuple[str, str], int]] = ()) -> None:
        """Name the bodies that blocked the search most often."""
        self.blocking = tuple(blocking)
        listed = ", ".join(f"{a} / {b} ({n} times)" for (a, b), n in self.blocking[:3])
        super().__init__(message + (f"; in the way: {listed}" if listed else ""))


class BlockedError(PlanningError):
    """A path touches something.

    Attributes:
        pairs: Names of the touching pairs.
        share: Where along the path, from 0 to 1.
    """

    def __init__(self, pairs: Sequence[tuple[str, str]], share: float) -> None:
        """Name the touching pairs and the place."""
        self.pairs = tuple(pairs)
        self.share = share
        listed = ", ".join(f"{a} / {b}" for a, b in self.pairs)
        super().__init__(f"blocked after {100.0 * share:.0f}% of the way: {listed}")


class UnreachableLineError(PlanningError):
    """Inverse kinematics does not follow a straight line to its end.

    Attributes:
        arm: The arm.
        reached: How far it comes [m].
        length: Length of the line [m].
        angle: Turn along the line [rad].
    """

    def __init__(self, arm: str, share: float, length: float, angle: float) -> None:
        """Tell what share of the line the arm follows, from 0 to 1."""
        self.arm = arm
        self.reached = share * length
        self.length = length
        self.angle = angle
        line = f"{1e3 * length:.0f} mm and {math.degrees(angle):.0f} degrees"
        super().__init__(f"arm {arm} follows the line of {line} for {100.0 * share:.0f}% of its way only")


class OffLineError(PlanningError):
    """A straight motion leaves its line by more than is allowed, however finely it is followed.

    Attributes:
        arm: The arm.
    """

    def __init__(self, arm: str, position: float, angle: float) -> None:
        """Tell how far the motion may leave the line [m, rad]."""
        self.arm = arm
        allowed = f"{1e3 * position:g} mm and {math.degrees(angle):g} degrees"
        super().__init__(f"arm {arm} does not keep to the line within {allowed}")


class NoRegraspError(PlanningError):
    """A part does not come from where it is to where it must be.

    Attributes:
        part: The part.
        report: What was tried and why it failed, a sentence each.
    """

    def __init__(self, part: str, cause: str, report: Sequence[str]) -> None:
        """Name the cause."""
        self.part = part
        self.cause = cause
        self.report = tuple(report)
        super().__init__(f"no way for {part}: {cause}")


class TimeLimitError(PlanningError):
    """The overall time limit is over.

    Attributes:
        seconds: The limit [s].
        doing: What was being done.
    """

    def __init__(self, seconds: float, doing: str) -> None:
        """Tell what was being done."""
        self.seconds, self.doing = seconds, doing
        super().__init__(f"the time limit of {seconds:g} s was over while planning: {doing}; give more time")
