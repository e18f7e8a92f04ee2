"""The task: what is there, what shall be done; typed, with quantities in any unit.

``tasks.task_file`` reads it from YAML. In code every quantity is a plain number in SI:
``Task(robot="nextage", hands={"left": "robotiq_2f85"}, parts={...}, goals=(Goal(place=Place(...)),))``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec

if TYPE_CHECKING:  # in code any number will do
    Length: TypeAlias = float
    Angle: TypeAlias = float
    Mass: TypeAlias = float
    Density: TypeAlias = float
else:

    class Length(float):
        """A length: a number [m] or text such as "2 mm"."""

    class Angle(float):
        """An angle: a number [rad] or text such as "20 deg"."""

    class Mass(float):
        """A mass: a number [kg] or text such as "50 g"."""

    class Density(float):
        """A density: a number [kg/m3] or text such as "2.7 g/cm3"."""


Point = tuple[Length, Length, Length]
Corner = tuple[Length, Length]
Axis = tuple[float, float, float]
Rpy = tuple[Angle, Angle, Angle]
Unit = Literal["mm", "cm", "m", "in"]


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A record of the task file."""


class At(Record, frozen=True):
    """A pose: position [m] and fixed-axis roll, pitch, yaw [rad]."""

    xyz: Point = (0.0, 0.0, 0.0)
    rpy: Rpy = (0.0, 0.0, 0.0)


class OwnRobot(Record, frozen=True):
    """A robot of the user's own; paths are relative to the task file.

    Attributes:
        urdf: The URDF file.
        srdf: The SRDF file of its MoveIt configuration: arms, home, collisions that need no check.
        limits: The joint_limits.yaml of its MoveIt configuration, with the accelerations.
        packages: Folders in which ``package://`` addresses are looked up.
        base: Pose of its root in the world.
        home: State of the SRDF that is its home.
    """

    urdf: str
    srdf: str
    limits: str | None = None
    packages: tuple[str, ...] = ()
    base: At = At()
    home: str = "home"


class Mounted(Record, frozen=True):
    """A hand and where it sits.

    Attributes:
        hand: Name of a shipped hand, or a YAML file relative to the task file.
        mount: Pose of its base in the frame of the flange.
    """

    hand: str
    mount: At = At()


class Obstacle(Record, frozen=True):
    """Something that stands in the cell: a box, or a mesh with its unit.

    Attributes:
        name: Its name.
        at: Its pose in the world.
        box: Sides of a box about its own origin [m].
        mesh: A mesh file relative to the task file.
        unit: What one unit of the mesh is.
        support: Whether parts may be put down on it: anywhere on its top if that is a level rectangle, else where goals
            say.
    """

    name: str
    at: At
    box: Point | None = None
    mesh: str | None = None
    unit: Unit | None = None
    support: bool = False


class Grasping(Record, frozen=True):
    """How a part is grasped: with the paper's parameters, which `GraspParameters` explains; its defaults if none.

    Attributes:
        measured: Files that `kumitate simulate` wrote, relative to the task file, at most one a hand: of that hand's
            planned grasps only those are used that were tried and held. The taker's grasps of an interlocked handover
            are in no file: they are built on those of the giver.
    """

    theta_pln: Angle | None = None
    theta_fct: Angle | None = None
    t_bdry: Length | None = None
    t_rnn: Length | None = None
    h_max: Length | None = None
    theta_parl: Angle | None = None
    t_dct: Length | None = None
    n_da: int | None = None
    measured: tuple[str, ...] = ()

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters that are given, by name."""
        given = {name: getattr(self, name) for name in self.__struct_fields__ if name != "measured"}
        return {name: value for name, value in given.items() if value is not None}


class Region(Record, frozen=True):
    """A box in a part's frame.

    Attributes:
        box: Its sides [m].
        at: Pose of its middle in the part's frame.
    """

    box: Point
    at: At = At()


class PartEntry(Record, frozen=True):
    """A part; its frame is that of its mesh.

    Attributes:
        mesh: A mesh file relative to the task file.
        unit: What one unit of the mesh is.
        at: Its pose in the world at the start, where it must rest stably.
        mass: Its mass [kg]; either this or the density.
        density: Its density [kg/m3].
        grasps: How its grasps are planned.
        frames: Poses in its frame that goals speak of by name, such as the tip of a tool.
        no_touch: Where no hand that holds it may be.
    """

    mesh: str
    unit: Unit
    at: At
    mass: Mass | None = None
    density: Density | None = None
    grasps: Grasping = Grasping()
    frames: dict[str, At] = {}
    no_touch: tuple[Region, ...] = ()


class Insert(Record, frozen=True):
    """The straight way into place.

    Attributes:
        direction: Of the motion, in the frame in which the goal's pose is given; of any length but zero.
        distance: Length of the way [m].
    """

    direction: Axis
    distance: Length


class Attach(Record, frozen=True):
    """Join a part to another one.

    Attributes:
        part: The part.
        to: The other part.
        at: Pose of the part in the frame of the other one once they are joined.
        insert: The last, straight stretch of the way there.
        arm: The arm that holds the part, if it matters.
        to_arm: The arm that holds the other part, if it matters.
        where: Pose of the other part in the world at that moment, if it matters.
        grasp: Pose of the hand in the frame of the part, if it matters: planned grasps within 5 mm and 10 deg are used.
        to_grasp: The same for the other part.
        then: Whether the other part, with all that is joined to it, is still held afterwards or put down.
    """

    part: str
    to: str
    at: At
    insert: Insert
    arm: str | None = None
    to_arm: str | None = None
    where: At | None = None
    grasp: At | None = None
    to_grasp: At | None = None
    then: Literal["hold", "place"] = "hold"


class Area(Record, frozen=True):
    """A place on a support.

    Attributes:
        on: The obstacle, a support, on whose top it lies.
        corners: Two opposite corners (x, y) in the world of the rectangle within which a part's outline shall lie; the
            whole top if none are given.
        up: The direction of the part, in its own frame, that shall point up; any stable placement if none.
    """

    on: str
    corners: tuple[Corner, Corner] | None = None
    up: Axis | None = None


class Place(Record, frozen=True):
    """Put a part down, at a pose or anywhere in an area.

    Attributes:
        part: The part.
        at: Its pose in the world.
        area: In place of a pose: where it may rest in any stable placement, at any turn.
        any_turn: Axis in the part's frame, through its origin, about which it may be turned at ``at``.
        arm: The arm that does it, if it matters.
    """

    part: str
    at: At | None = None
    area: Area | None = None
    any_turn: Axis | None = None
    arm: str | None = None


class HandOver(Record, frozen=True):
    """Give a part to an arm.

    Attributes:
        part: The part.
        to: The arm, which ends holding it.
        at: Pose of the part in the world at the end.
        any_turn: Axis in the part's frame, through its origin, about which it may be turned at ``at``.
        interlocked: Whether the arm must be given the part by another one, hand in hand: three-finger hands, the single
            finger of the taker between the two of the giver.
    """

    part: str
    to: str
    at: At
    any_turn: Axis | None = None
    interlocked: bool = False


class Use(Record, frozen=True):
    """Bring a frame of a tool straight to a pose, and straight back; the tool stays in the hand.

    Attributes:
        part: The tool.
        frame: Name of the tool's frame.
        at: Pose of that frame at the end of the straight way.
        of: The obstacle or part in whose frame ``at`` and the approach's direction are given, and which the tool may
            touch there; the world, and nothing, if none.
        approach: The straight way there.
        any_turn: Axis in the tool's frame of that name, through its origin, about which it may be turned at ``at``.
        arm: The arm that does it, if it matters.
    """

    part: str
    frame: str
    at: At
    approach: Insert
    of: str | None = None
    any_turn: Axis | None = None
    arm: str | None = None


class Goal(Record, frozen=True):
    """Exactly one of the goals."""

    attach: Attach | None = None
    place: Place | None = None
    hand_over: HandOver | None = None
    use: Use | None = None

    @property
    def asked(self) -> Attach | Place | HandOver | Use:
        """The one goal that is given."""
        one = self.attach or self.place or self.hand_over or self.use
        assert one is not None
        return one


class Task(Record, frozen=True):
    """A whole task.

    Attributes:
        robot: Name of a shipped robot, or one of the user's own.
        hands: The hand of each arm that has one: a shipped one by name, a YAML file, or either with its mount.
        parts: The parts by name.
        goals: What shall be done.
        order: Whether the goals are reached in the order in which they are given, or in any that works.
        cell: What else stands around.
        speed: Share of the joints' velocity limits that motions use, above 0 and at most 1.
        start: Joints that do not start at home, by name [rad or m].
        end: Whether the arms go home in the end or stay where they are.
    """

    robot: str | OwnRobot
    hands: dict[str, str | Mounted]
    parts: dict[str, PartEntry]
    goals: tuple[Goal, ...]
    order: Literal["fixed", "free"] = "fixed"
    cell: tuple[Obstacle, ...] = ()
    speed: float = 0.5
    start: dict[str, Angle] = {}
    end: Literal["home", "stay"] = "home"
