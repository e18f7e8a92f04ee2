"""Handovers: where both arms reach, how the part is turned there, and which pairs of grasps go together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..robots.arm import Arm
from ..robots.robot import Robot
from ..transforms import Array, compose
from .clearance import HandPoses, Mask
from .reach import APPROACH, Holder, Node

MOST_GRASPS = 100  # well-spread grasps a side of a handover that are paired
_SAMPLES = 4000  # configurations of each arm that tell where it reaches
_VOXEL = 0.05  # m
_OFTEN = 0.25  # of the most frequent voxel's share
_RAISED = np.array([0.0, 0.0, 0.3])  # m
_APART = 0.1  # m between places of handovers
_PLACES = 8
_OPENED = (0.25, 0.5, 0.75)  # shares of the way from the grasp to the approach opening that are looked at
_BACK = (0.0, 0.01, 0.025, APPROACH)  # m from the grasp at which a coming or leaving hand is looked at


def sample_handovers(
    robot: Robot, arms: Sequence[str], near: Array, turned: Sequence[Array], rng: np.random.Generator
) -> list[Node]:
    """Poses of a part in the air that two arms may both reach, in random order.

    Places are the middles of voxels in which random configurations of both arms put their hands often, those nearest to
    30 cm above ``near`` (3,), so that there is room for hands below, and apart from each other. There the part is
    turned as in ``turned`` (3, 3), by each of the 24 rotations of a cube.
    """
    counts = []
    for name in arms:
        arm = robot.arm(name)
        hands = arm.chain.forward(arm.chain.random(rng, _SAMPLES)) @ arm.flange_from_hand(0.0)
        voxels, count = np.unique(np.floor(hands[:, :3, 3] / _VOXEL).astype(int), axis=0, return_counts=True)
        counts.append({tuple(v): int(c) for v, c in zip(voxels.tolist(), count, strict=True)})
    often = {v: min(count[v] for count in counts) for v in set(counts[0]).intersection(*counts[1:])}
    well = np.array(sorted(v for v, count in often.items() if count >= _OFTEN * max(often.values())))
    middles = (well.reshape(-1, 3) + 0.5) * _VOXEL
    places: list[Array] = []
    for place in middles[np.argsort(np.linalg.norm(middles - near - _RAISED, axis=1), kind="stable")]:
        if all(np.linalg.norm(place - other) >= _APART for other in places):
            places.append(place)
        if len(places) == _PLACES:
            break
    rotations: list[Array] = []
    for rotation in (cube @ base for base in turned for cube in _CUBE):
        if all(np.abs(rotation - other).max() > 1e-6 for other in rotations):
            rotations.append(rotation)
    poses = [compose(rotation, place) for place in places for rotation in rotations]
    return [Node(f"handover {i}", poses[k], None) for i, k in enumerate(rng.permutation(len(poses)))]


class HandoverPairs:
    """Which grasps of a giver and a taker go together: the hands are clear of each other from coming to leaving.

    It depends on the part's frame alone, so each pair is looked at once, when asked for.
    """

    def __init__(self, giver: Holder, taker: Holder) -> None:
        self._known = np.full((len(giver.grasps), len(taker.grasps)), -1, dtype=np.int8)
        self._closed = [_hands(holder, holder.grasps.opening, 0.0) for holder in (giver, taker)]
        self._open = [[_hands(holder, opening, back) for opening, back in _passes(holder)] for holder in (giver, taker)]

    def clear(self, given: npt.NDArray[np.intp], taken: npt.NDArray[np.intp]) -> Mask:
        """Which of the grasps ``given`` (g,) and ``taken`` (t,) go together (g, t)."""
        rows, columns = np.unique(given), np.unique(taken)
        unknown = np.argwhere(self._known[np.ix_(rows, columns)] < 0)
        if len(unknown):
            pairs = np.column_stack([rows[unknown[:, 0]], columns[unknown[:, 1]]])
            self._known[pairs[:, 0], pairs[:, 1]] = self._look(pairs)
        return np.asarray(self._known[np.ix_(given, taken)] == 1)

    def _look(self, pairs: npt.NDArray[np.intp]) -> Mask:
        """Whether ``pairs`` (k, 2) are clear: the taker comes open to the giver, who then leaves open."""
        clear = np.ones(len(pairs), dtype=bool)
        looks = [(self._closed[0], self._closed[1])]
        looks += [(self._closed[0], taker) for taker in self._open[1]]
        looks += [(giver, self._closed[1]) for giver in self._open[0]]
        for giver, taker in looks:
            (left,) = np.nonzero(clear)
            clear[left] = ~giver.hit(taker, pairs[left])
        return clear


def _passes(holder: Holder) -> list[tuple[Array, float]]:
    """Openings (n,) and distances back [m] of the hands that come or leave: closing where they grasp, and open."""
    closed, wide = holder.grasps.opening, holder.grasps.approach_opening
    return [(closed + share * (wide - closed), 0.0) for share in _OPENED] + [(wide, back) for back in _BACK]


def _hands(holder: Holder, openings: Array, back: float) -> HandPoses:
    """The hands of all grasps in the part's frame, ``back`` [m] along their approach."""
    arm: Arm = holder.arm
    assert arm.hand is not None
    base = holder.part_from_flange @ arm.flange_from_base
    base[:, :3, 3] -= back * holder.grasps.part_from_hand[:, :3, 2]
    return HandPoses.of(arm.hand, base, openings)


def _cube_rotations() -> list[Array]:
    """The 24 rotations that map a cube onto itself."""
    found = []
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            rotation = np.zeros((3, 3))
            rotation[range(3), axes] = signs
            if np.linalg.det(rotation) > 0.0:
                found.append(rotation)
    return found


_CUBE = _cube_rotations()
