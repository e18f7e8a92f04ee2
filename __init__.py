"""Kumitate: assembly planning for dual-arm robots, from CAD meshes to a verified, timed plan.

Heavy libraries load when a name that needs them is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .errors import InputError as InputError
    from .errors import KumitateError as KumitateError
    from .errors import PlanningError as PlanningError
    from .grasping.grasps import GraspSet as GraspSet
    from .grasping.measured import Measured as Measured
    from .grasping.parameters import GraspParameters as GraspParameters
    from .grasping.part import Part as Part
    from .grasping.planner import plan_grasps as plan_grasps
    from .grasping.store import cached_grasps as cached_grasps
    from .physics.trials import Trials as Trials
    from .physics.trials import run_trials as run_trials
    from .regrasp.graph import Held as Held
    from .regrasp.placements import Placements as Placements
    from .regrasp.placements import find_placements as find_placements
    from .regrasp.planner import Regrasp as Regrasp
    from .regrasp.planner import plan_regrasp as plan_regrasp
    from .regrasp.reach import Node as Node
    from .regrasp.supports import Spots as Spots
    from .regrasp.supports import Support as Support
    from .regrasp.supports import find_spots as find_spots
    from .robots.grip import plan_grip as plan_grip
    from .robots.hand import Hand as Hand
    from .robots.library import load_hand as load_hand
    from .robots.library import load_robot as load_robot
    from .robots.motion import plan_motion as plan_motion
    from .robots.robot import Robot as Robot
    from .robots.scene import Scene as Scene
    from .robots.state import Body as Body
    from .robots.state import Contact as Contact
    from .robots.state import Margins as Margins
    from .robots.state import SceneState as SceneState
    from .robots.straight import INSERTION as INSERTION
    from .robots.straight import LineTolerance as LineTolerance
    from .robots.straight import plan_linear as plan_linear
    from .robots.timing import time_motion as time_motion
    from .robots.trajectory import Trajectory as Trajectory
    from .tasks.document import Plan as Plan
    from .tasks.planner import plan as plan
    from .tasks.replay import write_replay as write_replay
    from .tasks.task import Area as Area
    from .tasks.task import At as At
    from .tasks.task import Attach as Attach
    from .tasks.task import Goal as Goal
    from .tasks.task import Grasping as Grasping
    from .tasks.task import HandOver as HandOver
    from .tasks.task import Insert as Insert
    from .tasks.task import Mounted as Mounted
    from .tasks.task import Obstacle as Obstacle
    from .tasks.task import OwnRobot as OwnRobot
    from .tasks.task import PartEntry as PartEntry
    from .tasks.task import Place as Place
    from .tasks.task import Region as Region
    from .tasks.task import Task as Task
    from .tasks.task import Use as Use
    from .tasks.task_file import read_task as read_task
    from .tasks.verify import Fault as Fault
    from .tasks.verify import Verification as Verification
    from .tasks.verify import verify as verify
    from .transforms import pose as pose

_HOMES = {
    "errors": ("InputError", "KumitateError", "PlanningError"),
    "grasping.grasps": ("GraspSet",),
    "grasping.measured": ("Measured",),
    "grasping.parameters": ("GraspParameters",),
    "grasping.part": ("Part",),
    "grasping.planner": ("plan_grasps",),
    "grasping.store": ("cached_grasps",),
    "physics.trials": ("Trials", "run_trials"),
    "regrasp.graph": ("Held",),
    "regrasp.placements": ("Placements", "find_placements"),
    "regrasp.planner": ("Regrasp", "plan_regrasp"),
    "regrasp.reach": ("Node",),
    "regrasp.supports": ("Spots", "Support", "find_spots"),
    "robots.grip": ("plan_grip",),
    "robots.hand": ("Hand",),
    "robots.library": ("load_hand", "load_robot"),
    "robots.motion": ("plan_motion",),
    "robots.robot": ("Robot",),
    "robots.scene": ("Scene",),
    "robots.state": ("Body", "Contact", "Margins", "SceneState"),
    "robots.straight": ("INSERTION", "LineTolerance", "plan_linear"),
    "robots.timing": ("time_motion",),
    "robots.trajectory": ("Trajectory",),
    "tasks.document": ("Plan",),
    "tasks.planner": ("plan",),
    "tasks.replay": ("write_replay",),
    "tasks.task": (
        "Area",
        "At",
        "Attach",
        "Goal",
        "Grasping",
        "HandOver",
        "Insert",
        "Mounted",
        "Obstacle",
        "OwnRobot",
        "PartEntry",
        "Place",
        "Region",
        "Task",
        "Use",
    ),
    "tasks.task_file": ("read_task",),
    "tasks.verify": ("Fault", "Verification", "verify"),
    "transforms": ("pose",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}
__all__ = sorted(_HOME_OF)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use (PEP 562)."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'kumitate' has no attribute {name!r}")
    value = getattr(import_module(f".{_HOME_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return __all__
