"""What the verifier finds: faults by name, and the table that explains the names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

FAULTS = {
    "format": "The document is of another format, an array has the wrong length, or a number is not finite.",
    "names": "An arm, part, carrier or goal is named that the task does not have, or an arm twice.",
    "joints": "The joints are not those of the robot, each once.",
    "times": "The times of a motion do not increase from zero, or an event lies outside its action.",
    "mesh": "A mesh is missing, cannot be read, or is not the one that the task names.",
    "models": "A file of the robot or of a hand differs from the one that the plan was made with.",
    "start": "The first state is not what the task says.",
    "continuity": "An action does not start where the one before ended, or its motion does not join its states.",
    "standstill": "A joint or a hand is not at rest when an action starts or ends.",
    "idle": "A joint or a hand moves that belongs to none of the action's arms.",
    "position": "A joint leaves its range.",
    "velocity": "A joint is faster than its limit times the task's speed.",
    "acceleration": "A joint accelerates faster than its limit.",
    "stroke": "A hand is opened wider or narrower than it can be.",
    "finger-speed": "A finger is faster than its limit times the task's speed.",
    "kind": "Hands take or let go, or parts are joined, in an action of another kind; or joints move while hands do.",
    "carrier": "A carrier takes what it holds already or cannot hold, or lets go what it does not hold.",
    "grasp": "A hand takes a part otherwise than the action's grasp says, or the grasp is none of the action's hands.",
    "pads": "A hand takes a part, but its pads or its lip do not lie on the part.",
    "no-touch": "A hand that takes a part reaches into a region of it that no hand may touch.",
    "grip": "The opening of a hand changes while it holds something.",
    "two-hands": "A joint moves while two hands, or a hand and a support, hold one part or assembly.",
    "assembly": "A part is attached to another, or parted from it, otherwise than a goal says.",
    "attached": "A state tells other carriers, or other places in them, than the events give.",
    "slip": "A carried part is not where its carrier takes it.",
    "moved": "A part that nobody carries is not where it was left.",
    "collision": "Two bodies touch that may not.",
    "contact": "Two bodies that may touch lie in each other deeper than the contact tolerance.",
    "unsupported": "A part that nobody holds has no support within 1 mm below it.",
    "topples": "A part that nobody holds does not stand safely on what it rests on.",
    "insertion": "A part did not come into place straight, along the whole way that its goal asks for.",
    "use": "A tool did not come straight to where it is used and straight back, along the whole way, in the same hand.",
    "interlock": "A part did not go from hand to hand with the single finger of each between the two of the other.",
    "goal": "A goal is not reached, not in its turn, or undone later.",
    "end": "An arm whose hand is empty does not end at home, as the task asks.",
}
"""A sentence for every name that a fault can have."""


@dataclass(frozen=True)
class Fault:
    """Something wrong with a plan.

    Attributes:
        name: A key of ``FAULTS``.
        action: Number, from 0, of the action; none for the plan as a whole.
        time: When in the action [s]; none for all of it.
        words: What is wrong, and by how much.
        bodies: Joints, parts, links, pieces of hands (``arm/piece``) or obstacles concerned.
    """

    name: str
    action: int | None
    time: float | None
    words: str
    bodies: tuple[str, ...] = ()

    def __str__(self) -> str:
        where = "plan" if self.action is None else f"action {self.action}"
        when = "" if self.time is None else f" at {self.time:.3f} s"
        return f"{where}{when}: {self.name}: {self.words}"


@dataclass(frozen=True)
class Verification:
    """What the verifier found.

    Attributes:
        faults: What is wrong, by action; at most one of each name an action.
        clearance: Smallest distance measured between bodies that may not touch [m]; infinite if none was near.
        nearest: The two bodies that came so near.
        samples: Instants at which all bodies were placed.
        distances: Exact distances between two bodies measured.
        seconds: Time that it took [s].
    """

    faults: tuple[Fault, ...]
    clearance: float
    nearest: tuple[str, ...]
    samples: int
    distances: int
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults


class Findings:
    """Collects faults, the first of each name and action."""

    def __init__(self) -> None:
        self._faults: dict[tuple[str, int | None], Fault] = {}

    def add(
        self, name: str, words: str, *, action: int | None = None, time: float | None = None, bodies: Iterable[str] = ()
    ) -> None:
        """Keep a fault, unless one of the same name and action is there already."""
        self._faults.setdefault((name, action), Fault(name, action, time, words, tuple(bodies)))

    def __len__(self) -> int:
        """How many faults there are."""
        return len(self._faults)

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults by action, those of the whole plan first."""
        return tuple(sorted(self._faults.values(), key=lambda fault: -1 if fault.action is None else fault.action))
