"""What the planners share: turning about an axis, standing on a pair of contacts, opening, holding, quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import pi
from time import process_time

import numpy as np

from ..robots.hand import Hand
from ..transforms import Array, compose, invert, rotation_about
from .collision import HandCollision, Mask
from .couple import force_offsets
from .facets import Facets, Indices
from .grasps import GraspSet
from .pairs import ContactPairs
from .parameters import GraspParameters
from .part import Part
from .record import Stage
from .softfinger import eccentricity, stability_margin
from .touch import first_touch

_ALONG = 0.95  # cosine from which an axis counts as along another
TOUCHING = ("hand clear of the part", "hand touches the part")  # why the check drops a hand
FLUSH = 1e-6  # m; what rises less than this above a contact does not hold a pad off
_WAY_OPEN = np.arange(1, 9) / 8.0  # where fingers are looked at on their way open, as shares of it


@dataclass(frozen=True, eq=False)
class Candidates:
    """n ways to put a gripper on contact pairs: one row for each pair, way round and rotation.

    Attributes:
        pair: (n,) index of the contact pair.
        swapped: (n,) whether the single finger goes to the pair's second point.
        closing: (n, 3) x axis of the hand: from the single finger to the other side.
        approach: (n, 3) z axis of the hand.
    """

    pair: Indices
    swapped: Mask
    closing: Array
    approach: Array

    def __len__(self) -> int:
        """Number of candidates n."""
        return len(self.pair)

    @property
    def rotation(self) -> Array:
        """(n, 3, 3) orientation of the hand in the part's frame."""
        return np.stack([self.closing, np.cross(self.approach, self.closing), self.approach], axis=-1)

    def ends(self, pairs: ContactPairs) -> Array:
        """(n, 2, 3) contact points: the single finger's, then the other side's [m]."""
        points = pairs.points[self.pair]
        return np.where(self.swapped[:, None, None], points[:, ::-1], points)

    def take(self, chosen: Indices | Mask) -> Candidates:
        """The chosen candidates: indices or a mask."""
        return Candidates(*(getattr(self, item.name)[chosen] for item in fields(self)))


def turn_about(pairs: ContactPairs, n_da: int, both_ways: bool) -> Candidates:
    """Every pair at ``n_da`` rotations about its closing axis, one way round or both.

    Rotations count from the part's -z axis seen along the closing axis (from its -x axis when the closing axis is
    vertical), so that a vertical approach is among them.
    """
    axis, ways = pairs.axis, 1 + both_ways
    approach = directions_about(axis, (0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), n_da)
    shape = (len(pairs), ways, n_da)
    swapped = np.broadcast_to((np.arange(ways) == 1)[:, None], shape).ravel()
    pair = np.repeat(np.arange(len(pairs)), ways * n_da)
    return Candidates(
        pair=pair,
        swapped=swapped,
        closing=np.where(swapped[:, None], -axis[pair], axis[pair]),
        approach=np.broadcast_to(approach[:, None], (*shape, 3)).reshape(-1, 3),
    )


def directions_about(axis: Array, first: Sequence[float], otherwise: Sequence[float], count: int) -> Array:
    """Unit directions (n, count, 3) at right angles to unit axes (n, 3), evenly turned about them.

    They count from the direction nearest to ``first``; where the axis is nearly along that, to ``otherwise``. Both are
    axes of the part.
    """
    along = np.abs(axis @ np.asarray(first)) > _ALONG
    start = np.where(along[:, None], otherwise, first)
    start -= np.sum(start * axis, axis=-1, keepdims=True) * axis
    start /= np.linalg.norm(start, axis=-1, keepdims=True)
    turns = rotation_about(axis[:, None], 2.0 * pi * np.arange(count) / count)
    return np.asarray((turns @ start[:, None, :, None])[..., 0])


@dataclass(frozen=True, eq=False)
class Stand:
    """How the pads stand on the part (n candidates).

    Attributes:
        stand_off: (n, 2) how far each side stands off its contact point [m], the single finger first: what has to sink
            in. Infinite where another pad was already too far off for this one to be looked at.
        gap: (n,) how far the farther finger of a pair hangs above the surface [m], infinite where it meets none; 0 for
            one finger.
        opening: (n,) opening of the hand [m].
    """

    stand_off: Array
    gap: Array
    opening: Array

    def take(self, chosen: Indices | Mask) -> Stand:
        """The chosen candidates: indices or a mask."""
        return Stand(self.stand_off[chosen], self.gap[chosen], self.opening[chosen])


def stand(part: Part, hand: Hand, pairs: ContactPairs, candidates: Candidates, h_max: float, floor: float) -> Stand:
    """Move the pads of each candidate in along the closing axis until the whole face of one a side first touches.

    Where the faces turn while closing they are put as they are at the opening: first at that of the contacts, then, for
    candidates that come near enough, at the one that this gives.

    Args:
        part: The part.
        hand: A hand with fingers.
        pairs: Contact pairs.
        candidates: How the hand is put on them; the contacts are within the stroke.
        h_max: Deepest penetration of a pad [m].
        floor: How far below the contacts a surface of the second side is looked for, not above zero [m].
    """
    width = pairs.width[candidates.pair]
    hopeless = 2.0 * h_max + FLUSH  # farther off than turning to the final opening makes good
    touch = _touch(part, hand, pairs, candidates, width, floor, hopeless)
    near = np.flatnonzero((touch <= hopeless).all(axis=1) & _pads_turn(hand))
    if len(near):
        opening = np.clip(width[near] + _stand_off(touch[near]).sum(axis=1), *hand.stroke)
        touch[near] = _touch(part, hand, pairs, candidates.take(near), opening, floor, hopeless)
    stand_off, gap = _stand_off(touch), np.zeros(len(touch))
    if len(hand.pads) > 2:
        looked = (stand_off < np.inf).all(axis=1)
        gap[looked] = np.maximum(stand_off[looked, 1], 0.0) - touch[looked, 1:].min(axis=1)
    return Stand(stand_off, gap, width + stand_off.sum(axis=1))


def _stand_off(touch: Array) -> Array:
    """Stand-off (n, 2) of both sides from the first touch of each pad (n, pads); one finger cannot pass its contact."""
    single, other = np.maximum(touch[:, 0], 0.0), touch[:, 1:].max(axis=1)
    return np.stack([single, np.maximum(other, 0.0) if touch.shape[1] == 2 else other], axis=1)


def _touch(
    part: Part, hand: Hand, pairs: ContactPairs, candidates: Candidates, opening: Array, floor: float, hopeless: float
) -> Array:
    """First touch of each pad (n, pads), put on the contact the way it faces at ``opening`` (n,) [m]."""
    width = pairs.width[candidates.pair]
    placed = compose(candidates.rotation, candidates.ends(pairs).mean(axis=1))[:, None] @ hand.hand_from_pad(opening)
    touch = np.full((len(candidates), len(hand.pads)), np.inf)
    left = np.arange(len(candidates))
    for i, pad in enumerate(hand.pads):
        outward = (-1.0 if i == 0 else 1.0) * candidates.closing
        at_contact = placed[:, i].copy()
        at_contact[:, :3, 3] -= 0.5 * (opening - width)[:, None] * outward
        centred = i == 0 or len(hand.pads) == 2
        place = 2 * candidates.pair + (candidates.swapped ^ (i > 0)) if centred else np.arange(len(candidates))
        touch[left, i] = first_touch(
            part.mesh,
            place[left],
            outward[left],
            at_contact[left],
            pad.size,
            floor=FLUSH if centred else floor,
            reach=(hand.stroke[1] - width[left]) / 2.0,
        )
        left = left[touch[left, i] <= hopeless]
    return touch


def _pads_turn(hand: Hand) -> bool:
    """Whether the faces of the pads turn while the fingers close."""
    open_, closed = hand.hand_from_pad(np.array(hand.stroke))[:, :, :3, 0]
    return not np.allclose(open_, closed, atol=1e-6)


def finger_ways(
    body: HandCollision, hand: Hand, part_from_hand: Array, opening: Array, tolerance: float
) -> tuple[Mask, Array]:
    """Whether fingers close on the part with their pads first (n,), and from which approach opening (n,) [m].

    Pieces that carry no pad are looked at closed by ``tolerance`` a side: knuckles that meet the part there may hold it
    in place of the pads. With the base where it grasps the fingers are then opened in steps, as far as every step is
    free: to the stroke's end, or to the last step before the part is in the way, so that fingers that close from there
    meet nothing else.
    """
    part_from_base = part_from_hand @ invert(hand.base_from_hand(opening))
    pads_first = ~body.hand_hits(
        part_from_base, np.maximum(opening - 2.0 * tolerance, hand.stroke[0]), body.behind_pads
    )
    approach = opening + 2.0 * tolerance
    way, left = hand.stroke[1] - approach, np.arange(len(opening))
    for share in _WAY_OPEN:
        tried = hand.stroke[1] - (1.0 - share) * way[left]
        free = ~body.hand_hits(part_from_base[left], tried, body.moving)
        left = left[free]
        approach[left] = tried[free]
    return pads_first, approach


def holding_margin(part: Part, hand: Hand, facets: Facets, pairs: ContactPairs, parameters: GraspParameters) -> Array:
    """Stability margin (n,) of pairs (eq. 4): e_n of the weaker one, lever from the centre of mass to their middle."""
    e_n = eccentricity(facets.radius[pairs.facets], parameters.h_max, hand.pads[0].radius).min(axis=-1)
    lever = np.linalg.norm(pairs.points.mean(axis=1) - part.center_of_mass, axis=-1)
    return stability_margin(lever, e_n, part.mass, hand.friction, hand.grip_force)


def finish(
    part: Part,
    hand: Hand,
    body: HandCollision,
    facets: Facets,
    pairs: ContactPairs,
    candidates: Candidates,
    standing: Stand,
    parameters: GraspParameters,
    *,
    colliding: bool,
) -> tuple[GraspSet, tuple[Stage, ...]]:
    """The last steps of both planners: the whole hand, stability (IV.B, lines 15 to 22), the closing of the fingers.

    With ``colliding`` the hands that touch the part go on, in place of those that do not.

    Returns:
        The grasps, in the order of the candidates and without a record, and the stages ``"hand collision"``,
        ``"stability"`` and ``"closing fingers"``.
    """
    started = process_time()
    off = standing.stand_off
    origin = candidates.ends(pairs).mean(axis=1) + 0.5 * (off[:, 1] - off[:, 0])[:, None] * candidates.closing
    part_from_hand = compose(candidates.rotation, origin)
    # Pads may touch what they hold and nothing else.
    tolerance = parameters.contact_tolerance
    loose = standing.opening + 2.0 * tolerance
    hits = body.hand_hits(part_from_hand @ invert(hand.base_from_hand(standing.opening)), loose)
    free = np.flatnonzero(hits == colliding)
    dropped = {TOUCHING[not colliding]: len(hits) - len(free)}
    collision = Stage("hand collision", len(hits), len(free), dropped, process_time() - started)

    started = process_time()
    margin = holding_margin(part, hand, facets, pairs, parameters)[candidates.pair]
    held = free[margin[free] >= 0.0]
    stability = Stage(
        "stability", len(free), len(held), {"turns under gravity": len(free) - len(held)}, process_time() - started
    )

    started = process_time()
    pads_first, approach = finger_ways(body, hand, part_from_hand[held], standing.opening[held], tolerance)
    kept = np.asarray(pads_first | colliding)
    dropped = {"knuckles meet the part": len(held) - int(kept.sum())}
    taken, held, approach = len(held), held[kept], approach[kept]
    pair, swap, opening = candidates.pair[held], candidates.swapped[held], standing.opening[held]
    offsets = np.zeros((len(held), 2))
    # Where both pads touch at their contacts, both forces can run along the line between these: no need to look.
    beside = np.flatnonzero((off[held] > FLUSH).any(axis=1) | (len(hand.pads) > 2))
    ends = 2 * pair[beside] + swap[beside]
    offsets[beside] = force_offsets(part, hand, part_from_hand[held[beside]], opening[beside], ends)
    ways = Stage("closing fingers", taken, len(held), dropped, process_time() - started)

    distance = np.linalg.norm(origin[held] - part.center_of_mass, axis=-1)
    share = offsets / (hand.friction * np.maximum(opening, FLUSH)[:, None])  # of what friction bears
    grasps = GraspSet(
        part=part.name,
        hand=hand.name,
        part_from_hand=part_from_hand[held],
        opening=opening,
        approach_opening=approach,
        contacts=candidates.ends(pairs)[held],
        normals=np.where(swap[:, None, None], pairs.normals[pair][:, ::-1], pairs.normals[pair]),
        facets=np.where(swap[:, None], pairs.facets[pair][:, ::-1], pairs.facets[pair]),
        force=np.full(len(held), hand.grip_force),
        margin=margin[held],
        distance=distance,
        parallelness=pairs.parallelness[pair],
        quality=quality(part, margin[held], distance, pairs.parallelness[pair]) * np.exp(-np.sum(share**2, axis=1)),
    )
    return grasps, (collision, stability, ways)


def quality(part: Part, margin: Array, distance: Array, parallelness: Array) -> Array:
    """Margin x nearness to the centre of mass x cosine of the misalignment (n,), each in [0, 1].

    The quality of a grasp by a cup; for fingers ``finish`` has a further factor.
    """
    size = np.linalg.norm(part.mesh.vertices - part.center_of_mass, axis=-1).max()
    return np.asarray(margin * np.clip(1.0 - distance / size, 0.0, 1.0) * -np.cos(parallelness))
