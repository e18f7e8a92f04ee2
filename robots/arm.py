"""One arm of a robot: its joints, its flange, and the hand on it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..transforms import Array, checked_poses, invert
from .chain import Chain
from .hand import Hand
from .ik import IKSolutions, IKSolver, make_solver, track


@dataclass(frozen=True, eq=False)
class Arm:
    """A serial group of joints that carries a flange, and the hand on it.

    Attributes:
        name: The SRDF group's name.
        chain: Joints and kinematics from the world to the flange, the robot's other joints at home.
        indices: Places (dof,) of its joints in the robot's configuration.
        flange: Name of the flange's link.
        flange_joint: Index of the pinocchio joint that moves the flange.
        joint_from_flange: Pose (4, 4) of the flange in that joint's frame.
        hand: The mounted hand, if there is one.
        flange_from_base: Pose (4, 4) of the hand's base on the flange.
    """

    name: str
    chain: Chain
    indices: npt.NDArray[np.intp]
    flange: str
    flange_joint: int
    joint_from_flange: Array
    hand: Hand | None = None
    flange_from_base: Array = field(default_factory=lambda: np.eye(4))

    def flange_from_hand(self, openings: npt.ArrayLike) -> Array:
        """Pose (n, 4, 4) of the hand frame on the flange at ``openings`` (n,) [m].

        Raises:
            InputError: No hand is mounted, or an opening lies outside the stroke.
        """
        if self.hand is None:
            raise InputError(f"arm {self.name}", "no hand is mounted", "use Robot.with_hand")
        return self.flange_from_base @ self.hand.base_from_hand(openings)

    def checked_opening(self, opening: float) -> float:
        """``opening`` [m] as a number within the stroke.

        Raises:
            InputError: No hand is mounted, it is no number, or it lies outside the stroke.
        """
        if np.ndim(opening):
            raise InputError(f"arm {self.name}", f"opening {opening!r} is no number", "give one opening [m]")
        self.flange_from_hand(opening)
        return float(opening)

    @cached_property
    def solver(self) -> IKSolver:
        """Inverse kinematics of the flange, with its tables."""
        return make_solver(self.chain)

    def solve_ik(self, world_from_hand: npt.ArrayLike, openings: npt.ArrayLike) -> IKSolutions:
        """Configurations of the arm's joints that put its hand at poses (n, 4, 4) in the world, at openings (n,) [m].

        Raises:
            InputError: No hand is mounted, a pose is not rigid, an opening lies outside the stroke, or there are
                several openings but not one for each pose.
        """
        hands = checked_poses(world_from_hand, "inverse kinematics: targets").reshape(-1, 4, 4)
        flange_from_hand = self.flange_from_hand(openings)
        if len(flange_from_hand) not in (1, len(hands)):
            problem = f"{len(flange_from_hand)} openings for {len(hands)} targets"
            raise InputError("inverse kinematics: openings", problem, "give one for all, or one for each")
        return self.solver(hands @ invert(flange_from_hand))

    def track(self, q: Array, world_from_hand: Array, opening: float) -> tuple[Array, int]:
        """Follow poses of the hand (k, 4, 4) from joint positions ``q`` (dof,), without changing branch.

        Returns:
            Joint positions (k, dof), and how many leading poses were met.
        """
        flanges = world_from_hand @ invert(self.flange_from_hand(opening)[0])
        path, reached = track(self.chain, q[None], flanges[:, None])
        return path[:, 0], int(reached[0])
