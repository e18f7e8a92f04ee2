"""Tables with one part on them, before a robot with two grippers: where regrasps are tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import trimesh
from cells import MAKERS

from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.reach import Holder, Node, Reacher
from kumitate.regrasp.supports import Support
from kumitate.robots.library import load_robot
from kumitate.robots.robot import Robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact, SceneState
from kumitate.transforms import Array, pose

HANDS = {"left": "robotiq_2f85", "right": "robotiq_2f85"}
TABLES = {"ur3_dual": ((0.8, 1.83, 0.024), (0.45, 0.0, 1.082)), "nextage": ((0.3, 1.32, 0.02), (0.4, 0.0, -0.06))}
PARTS = {
    "block": lambda: trimesh.creation.box([0.03, 0.03, 0.1]),
    "bracket": lambda: MAKERS["bracket"](0.06, 0.012, 0.05),
    "wheel": lambda: MAKERS["wheel"](0.008, 0.03, 0.02),
    "bar": lambda: trimesh.creation.box([0.02, 0.02, 0.3]),
    "slab": lambda: trimesh.creation.box([0.1, 0.1, 0.1]),  # wider than the hand opens
}


@dataclass(frozen=True, eq=False)
class Tabletop:
    """A robot, a table and a part.

    Attributes:
        scene: The scene.
        part: The part.
        grasps: Its grasps by either hand.
        world_from_table: Pose (4, 4) of the table.
    """

    scene: Scene
    part: Part
    grasps: GraspSet
    world_from_table: Array

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.scene.robot

    @cached_property
    def support(self) -> Support:
        """The table's top."""
        return Support.top_of(self.scene.bodies["table"], self.world_from_table)

    @property
    def top(self) -> float:
        """Height of the table's top [m]."""
        return float(self.support.world_from_support[2, 3])

    def at(self, xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
        """A pose (4, 4) of the part, z from the table's top."""
        return pose([xyz[0], xyz[1], xyz[2] + self.top], rpy)

    def resting(self, world_from_part: Array) -> SceneState:
        """The part on the table, the arms at home."""
        state = self.scene.state({"table": self.world_from_table, self.part.name: world_from_part})
        return state.with_contacts([Contact("table", self.part.name, [0.0, 0.0, 1.0])])

    def reacher(self, world_from_part: Array, grasps: GraspSet, arms: Sequence[str] = ("left", "right")) -> Reacher:
        """A reacher with the part on the table."""
        holders = {arm: Holder.of(self.robot, arm, grasps) for arm in arms}
        return Reacher(self.scene, self.resting(world_from_part), self.part.name, holders)

    def node(self, name: str, world_from_part: Array) -> Node:
        """A node at which the part rests on the table."""
        return Node(name, world_from_part, "table")


@cache
def robot_with_hands(name: str) -> Robot:
    """A shipped robot with two 2F-85."""
    return load_robot(name, HANDS)


@cache
def tabletop(robot: str, part: str) -> Tabletop:
    """A shipped robot before its table with one of the parts."""
    equipped, made = robot_with_hands(robot), Part.from_mesh(PARTS[part](), mass=0.1, name=part)
    size, at = TABLES[robot]
    bodies = [Body.box("table", size, fixed=True), Body.from_mesh(part, made.mesh)]
    return Tabletop(Scene.of(equipped, bodies), made, _grasps(part), pose(at))


@cache
def _grasps(part: str) -> GraspSet:
    hand = robot_with_hands("ur3_dual").hands["left"]
    return plan_grasps(Part.from_mesh(PARTS[part](), mass=0.1, name=part), hand)
