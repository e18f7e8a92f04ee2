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
    from .grasping.parameters import GraspParameters as GraspParameters
    from .grasping.part import Part as Part
    from .grasping.planner import plan_grasps as plan_grasps
    from .grasping.store import cached_grasps as cached_grasps
    from .regrasp.placements import Placements as Placements
    from .regrasp.placements import find_placements as find_placements
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
    from .transforms import pose as pose

_HOMES = {
    "errors": ("InputError", "KumitateError", "PlanningError"),
    "grasping.grasps": ("GraspSet",),
    "grasping.parameters": ("GraspParameters",),
    "grasping.part": ("Part",),
    "grasping.planner": ("plan_grasps",),
    "grasping.store": ("cached_grasps",),
    "regrasp.placements": ("Placements", "find_placements"),
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
