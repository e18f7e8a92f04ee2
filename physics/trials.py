"""Trials of a set of grasps: which can be tried on a table, and what became of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from ..grasping.collision import looks_the_same_turned
from ..grasping.grasps import GraspSet
from ..grasping.measured import Measured
from ..grasping.part import Part
from ..regrasp.placements import Placements
from ..robots.hand import Hand
from ..transforms import Array, invert, transform_points

if TYPE_CHECKING:
    from .trial import Outcome

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]
STEEPEST = np.radians(40.0)  # of an approach from the vertical
_CLEARANCE = 5e-4  # m, of the hand above the table
_OPENINGS = 5  # looked at, from the approach opening to that of the grasp
_SAME = 6  # decimals of metres and of unit vectors


@dataclass(frozen=True, eq=False)
class Trials:
    """n trials of grasps of a part by a hand.

    Attributes:
        grasp: (n,) indices of the grasps, ascending.
        placement: (n,) indices of the placements in which the part lay.
        shift: (n, 3) way of the centre of mass while the fingers closed: along the table's x and y, and upwards [m].
        turn: (n,) by which the part turned meanwhile [rad].
        slip: (n,) way of the centre of mass in the hand while it was lifted [m].
        slip_turn: (n,) turn of the part in the hand meanwhile [rad].
        lifted: (n,) whether the hand had it after lifting.
        held: (n,) whether the hand had it after shaking too.
        seconds: (n,) processor time of each; 0 of one that is another's mirror image and was not simulated again.
    """

    grasp: Indices
    placement: Indices
    shift: Array
    turn: Array
    slip: Array
    slip_turn: Array
    lifted: Mask
    held: Mask
    seconds: Array

    def __len__(self) -> int:
        """Number of trials n."""
        return len(self.grasp)

    @property
    def displacement(self) -> Array:
        """(n,) way of the centre of mass along the table while the fingers closed [m]."""
        return np.hypot(self.shift[:, 0], self.shift[:, 1])

    def measured(self, n: int) -> Measured:
        """The values of n grasps, tried or not."""
        tried, held = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        shift, turn, slip = np.zeros((3, n))
        tried[self.grasp], held[self.grasp] = True, self.held
        shift[self.grasp], turn[self.grasp], slip[self.grasp] = self.displacement, self.turn, self.slip
        return Measured(tried=tried, shift=shift, turn=turn, slip=slip, held=held)


class OnTheTable(NamedTuple):
    """Which of n grasps can be tried.

    Attributes:
        grasp: (m,) their indices, ascending.
        placement: (m,) the placement for each: where its approach is nearest to the vertical.
        upright: (n,) whether the approach is near the vertical in some placement, the hand clear of the table or not.
    """

    grasp: Indices
    placement: Indices
    upright: Mask


def on_the_table(hand: Hand, grasps: GraspSet, placements: Placements) -> OnTheTable:
    """Grasps that can be tried.

    The approach is within 40 deg of the vertical, as in the paper's experiment, and the hand stays clear of the table
    from its approach opening until it has closed.
    """
    upright = np.zeros(len(grasps), dtype=bool)
    best, steepness = np.full(len(grasps), -1), np.full(len(grasps), np.cos(STEEPEST))
    for k, surface_from_part in enumerate(placements.surface_from_part):
        down = -(grasps.part_from_hand[:, :3, 2] @ surface_from_part[2, :3])
        upright |= down > np.cos(STEEPEST)
        steeper = np.flatnonzero(down > steepness)
        steeper = steeper[_clear(hand, grasps[steeper], surface_from_part)]
        best[steeper], steepness[steeper] = k, down[steeper]
    tried = np.flatnonzero(best >= 0)
    return OnTheTable(tried, best[tried], upright)


def _clear(hand: Hand, grasps: GraspSet, surface_from_part: Array) -> Mask:
    """Whether hands (n,) are above the table at every opening on their way."""
    surface_from_base = surface_from_part @ grasps.part_from_hand @ invert(hand.base_from_hand(grasps.opening))
    corners = [piece.mesh.vertices[ConvexHull(piece.mesh.vertices).vertices] for piece in hand.pieces]
    clear = np.ones(len(grasps), dtype=bool)
    for share in np.linspace(0.0, 1.0, _OPENINGS):
        openings = grasps.opening + share * (grasps.approach_opening - grasps.opening)
        poses = surface_from_base[:, None] @ hand.base_from_piece(openings)
        for k, points in enumerate(corners):
            clear &= transform_points(poses[:, k], points)[..., 2].min(axis=1) > _CLEARANCE
    return clear


def run_trials(
    part: Part,
    hand: Hand,
    grasps: GraspSet,
    placements: Placements,
    *,
    count: int | None = None,
    off: float = 0.0,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> Trials:
    """Try all grasps that can be tried on a table, or ``count`` of them.

    Two grasps of a hand that looks the same turned by half a turn, which differ by that turn, are one trial.

    Args:
        part: The part.
        hand: The hand.
        grasps: Planned grasps.
        placements: Of the part.
        count: At most so many, evenly from the first to the last: good and bad ones alike, as grasps go by quality.
        off: The hand stands off by this much at random, along the table [m]; the same at every call.
        progress: Called with the number of trials done and of all.

    Raises:
        ModuleNotFoundError: MuJoCo or Manifold is not there (``pip install 'kumitate[sim]'``).
    """
    from .trial import try_grasp
    from .world import build_world

    tried, placement, _ = on_the_table(hand, grasps, placements)
    if count is not None:
        chosen = np.linspace(0, len(tried) - 1, min(count, len(tried))).round().astype(np.int64)
        tried, placement = tried[chosen], placement[chosen]
    first, twin = _twins(hand, grasps[tried])
    rng = np.random.default_rng(0)
    world, seconds = build_world(part, hand), np.zeros(len(tried))
    outcomes: list[Outcome] = []
    for done, i in enumerate(first.tolist()):
        progress(done, len(first))
        started, angle = process_time(), rng.uniform(0.0, 2.0 * np.pi)
        aside = off * np.sqrt(rng.uniform()) * np.array([np.cos(angle), np.sin(angle), 0.0])
        surface_from_part = placements.surface_from_part[placement[i]]
        outcomes.append(try_grasp(world, hand, grasps, int(tried[i]), surface_from_part, aside))
        seconds[i] = process_time() - started
    shift, turn, slip, slip_turn, lifted, held = _columns(outcomes)
    numbers = (shift[twin], turn[twin], slip[twin], slip_turn[twin])
    return Trials(tried, placement, *numbers, lifted[twin], held[twin], seconds)


def _columns(outcomes: list[Outcome]) -> tuple[Array, Array, Array, Array, Mask, Mask]:
    """Outcomes as arrays."""
    numbers = np.array([[*o.shift, o.turn, o.slip, o.slip_turn] for o in outcomes]).reshape(-1, 6)
    kept = np.array([[o.lifted, o.held] for o in outcomes], dtype=bool).reshape(-1, 2)
    return numbers[:, :3], numbers[:, 3], numbers[:, 4], numbers[:, 5], kept[:, 0], kept[:, 1]


def _twins(hand: Hand, grasps: GraspSet) -> tuple[Indices, Indices]:
    """The first of grasps that are the same but for a half turn, and for each grasp (n,) the place of its first."""
    if not hand.pads or not looks_the_same_turned(hand):
        everyone = np.arange(len(grasps))
        return everyone, everyone
    poses = np.round(grasps.part_from_hand, _SAME) + 0.0  # no negative zeros
    closing = poses[:, :3, 0]
    leading = np.take_along_axis(closing, np.argmax(closing != 0.0, axis=1)[:, None], axis=1)
    same = np.hstack([poses[:, :3, 3], poses[:, :3, 2], closing * np.sign(leading), grasps.opening[:, None]])
    _, first, twin = np.unique(same, axis=0, return_index=True, return_inverse=True)
    return first, twin.ravel()
