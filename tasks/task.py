"""The task file: what is there, what shall be done; typed, with quantities in any unit, and every mistake told."""

from __future__ import annotations

from typing import Literal

import msgspec


class Length(float):
    """A length: a number [m] or text such as "2 mm"."""


class Angle(float):
    """An angle: a number [rad] or text such as "20 deg"."""


class Mass(float):
    """A mass: a number [kg] or text such as "50 g"."""


class Density(float):
    """A density: a number [kg/m3] or text such as "2.7 g/cm3"."""


Point = tuple[Length, Length, Length]
Rpy = tuple[Angle, Angle, Angle]
_ZERO = Length(0.0)
_STRAIGHT = Angle(0.0)


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A record of the task file."""


class At(Record):
    """A pose: position and fixed-axis roll, pitch, yaw."""

    xyz: Point = (_ZERO, _ZERO, _ZERO)
    rpy: Rpy = (_STRAIGHT, _STRAIGHT, _STRAIGHT)


class OwnRobot(Record):
    """A robot of the user's own, paths relative to the task file."""

    urdf: str
    srdf: str
    limits: str | None = None
    packages: tuple[str, ...] = ()
    base: At = At()
    home: str = "home"


class Mounted(Record):
    """A hand (a shipped one by name, or a YAML file relative to the task file) and where its base sits on the flange."""

    hand: str
    mount: At = At()


class Obstacle(Record):
    """Something that stands in the cell: a box about its own origin, or a mesh with its unit."""

    name: str
    at: At
    box: Point | None = None
    mesh: str | None = None
    unit: Literal["mm", "cm", "m", "in"] | None = None
    support: bool = False


class Grasping(Record):
    """Grasp parameters of a part, under the paper's names; the paper's defaults unless given."""

    theta_pln: Angle | None = None
    theta_fct: Angle | None = None
    t_bdry: Length | None = None
    t_rnn: Length | None = None
    h_max: Length | None = None
    theta_parl: Angle | None = None
    t_dct: Length | None = None
    n_da: int | None = None


class PartEntry(Record):
    """A part: mesh (relative to the task file) with unit, mass or density, and the pose at the start."""

    mesh: str
    unit: Literal["mm", "cm", "m", "in"]
    at: At
    mass: Mass | None = None
    density: Density | None = None
    grasps: Grasping = Grasping()


class Insert(Record):
    """The straight way into place: ``direction`` in the frame of the other part, and its length."""

    direction: tuple[float, float, float]
    distance: Length


class Attach(Record):
    """Join ``part`` to the part ``to``: at a relative pose ``at`` (in the frame of ``to``), the last stretch straight.

    ``arm`` and ``to_arm`` pin who holds what, ``where`` pins the pose of ``to`` in the world at that moment.
    """

    part: str
    to: str
    at: At
    insert: Insert
    arm: str | None = None
    to_arm: str | None = None
    where: At | None = None
    then: Literal["hold", "place"] = "hold"


class Place(Record):
    """Put ``part`` down at a pose in the world; ``arm`` pins who does."""

    part: str
    at: At
    arm: str | None = None


class HandOver(Record):
    """Give ``part`` to an arm, which ends holding it at a pose in the world."""

    part: str
    to: str
    at: At


class Goal(Record):
    """Exactly one of the goals."""

    attach: Attach | None = None
    place: Place | None = None
    hand_over: HandOver | None = None


class Task(Record):
    """A task: robot, hands, cell, parts, goals."""

    robot: str | OwnRobot
    hands: dict[str, str | Mounted]
    parts: dict[str, PartEntry]
    goals: tuple[Goal, ...]
    cell: tuple[Obstacle, ...] = ()
    speed: float = 0.5
    start: dict[str, float] = {}
    end: Literal["home", "stay"] = "home"
