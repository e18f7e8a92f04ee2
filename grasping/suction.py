"""Grasps for suction cups (paper, section IV.A), and two checks beyond the paper: seal and peel."""

from __future__ import annotations

from math import pi
from time import process_time

import numpy as np
from trimesh.ray.ray_pyembree import RayMeshIntersector

from ..errors import InputError
from ..robots.hand import Hand, Lip
from ..transforms import Array, compose, invert
from .collision import HandCollision, Mask
from .contacts import Contacts, at_most, boundary_distance
from .facets import Facets
from .grasps import GraspSet
from .parallel import TOUCHING, directions_about, quality
from .parameters import GraspParameters
from .part import Part
from .record import Stage
from .softfinger import GRAVITY, eccentricity, stability_margin

_LIP_POINTS = 72  # where the lip is looked at: every 5 deg
_MOST = 160_000  # contacts times turns that are looked at


def plan_suction(
    part: Part,
    facets: Facets,
    contacts: Contacts,
    hand: Hand,
    parameters: GraspParameters,
    *,
    colliding: bool = False,
) -> tuple[GraspSet, tuple[Stage, ...]]:
    """Grasps of a suction cup: where its lip seals, turned about the normal, free of the part, held against gravity.

    At most 160,000 contacts times turns are looked at: on parts so large that there are more (20,000 contacts with the
    default ``n_da``: 0.2 m2 of surface or so) contacts are as far apart as a larger ``t_rnn`` would bring them.

    The force that presses the part on is what the vacuum leaves when the weight pulls straight off: f_n = vacuum force
    - m g.

    Returns:
        The grasps, and the stages ``"seal"``, ``"hand collision"``, ``"stability"`` and ``"peel"``.
    """
    if hand.lip is None:
        raise InputError(f"hand {hand.name}", "has no lip", "plan suction grasps with a suction cup")
    started = process_time()
    taken, contacts = len(contacts), at_most(contacts, _MOST // parameters.n_da, parameters.t_rnn)
    edge, leaky, stand_off = lip_seals(part, facets, contacts, hand.lip)
    sealed = np.flatnonzero(~(edge | leaky))
    dropped = {
        "near another contact, of more than can be looked at": taken - len(contacts),
        "nearer the edge than the lip's radius": int(edge.sum()),
        "the lip leaks": int((leaky & ~edge).sum()),
    }
    seal = Stage("seal", taken, len(sealed), dropped, process_time() - started)

    started = process_time()
    rotation = turn_about_normals(contacts.smooth_normals[sealed], parameters.n_da)
    contact = np.repeat(sealed, parameters.n_da)
    outward = contacts.smooth_normals[contact]
    part_from_hand = compose(rotation, contacts.points[contact] + stand_off[contact, None] * outward)
    off_the_part = compose(rotation, part_from_hand[:, :3, 3] + parameters.contact_tolerance * outward)
    openings = np.zeros(len(contact))
    hits = HandCollision(part, hand).hand_hits(off_the_part @ invert(hand.base_from_hand(openings)), openings)
    free = np.flatnonzero(hits == colliding)
    dropped = {TOUCHING[not colliding]: len(hits) - len(free)}
    collision = Stage("hand collision", len(hits), len(free), dropped, process_time() - started)

    started = process_time()
    force = hand.lip.force - part.mass * GRAVITY
    lever = np.linalg.norm(contacts.points[contact] - part.center_of_mass, axis=-1)
    e_n = eccentricity(facets.radius[contacts.facet[contact]], parameters.h_max, hand.lip.radius)
    margin = stability_margin(lever, e_n, part.mass, hand.friction, force)
    firm = free[margin[free] >= 0.0]
    dropped = {"turns under gravity": len(free) - len(firm)}
    stability = Stage("stability", len(free), len(firm), dropped, process_time() - started)

    started = process_time()
    peel_margin = 1.0 - part.mass * GRAVITY * lever / max(force * hand.lip.radius, 1e-12)
    held = firm[peel_margin[firm] >= 0.0]
    peel = Stage("peel", len(firm), len(held), {"peels off": len(firm) - len(held)}, process_time() - started)

    margin = np.minimum(margin, peel_margin)[held]
    distance = np.linalg.norm(part_from_hand[held, :3, 3] - part.center_of_mass, axis=-1)
    opposed = np.full(len(held), pi)
    grasps = GraspSet(
        part=part.name,
        hand=hand.name,
        part_from_hand=part_from_hand[held],
        opening=openings[held],
        approach_opening=openings[held],
        contacts=contacts.points[contact[held], None],
        normals=contacts.normals[contact[held], None],
        facets=contacts.facet[contact[held], None],
        force=np.full(len(held), force),
        margin=margin,
        distance=distance,
        parallelness=opposed,
        quality=quality(part, margin, distance, opposed),
    )
    return grasps, (seal, collision, stability, peel)


def lip_seals(part: Part, facets: Facets, contacts: Contacts, lip: Lip) -> tuple[Mask, Mask, Array]:
    """Where a lip seals: it stays inside its facet and lies on the surface all around within the cup's compliance.

    Returns:
        Whether each contact (n,) is nearer the facet's edge than the lip's radius; whether the lip leaks there; and how
        far the cup's lip stands off the contact point [m].
    """
    reach = 2.0 * lip.radius
    edge = boundary_distance(part, facets, contacts.points, contacts.facet, reach) < lip.radius
    inside = np.flatnonzero(~edge)
    outward = contacts.smooth_normals[inside]
    ring = turn_about_normals(outward, _LIP_POINTS)[:, :, 0].reshape(len(inside), _LIP_POINTS, 3)
    start = contacts.points[inside, None] + lip.radius * (ring + outward[:, None])
    down = np.broadcast_to(-outward[:, None], start.shape).reshape(-1, 3)
    hits, ray, _ = RayMeshIntersector(part.mesh).intersects_location(start.reshape(-1, 3), down, multiple_hits=False)
    depth = np.full(len(inside) * _LIP_POINTS, np.inf)
    depth[ray] = np.linalg.norm(hits - start.reshape(-1, 3)[ray], axis=-1)
    height = lip.radius - depth.reshape(len(inside), _LIP_POINTS)
    stand_off, leaky = np.zeros(len(contacts)), np.zeros(len(contacts), dtype=bool)
    stand_off[inside] = height.max(axis=1, initial=0.0)
    leaky[inside] = stand_off[inside] - height.min(axis=1, initial=np.inf) > lip.compliance
    return edge, leaky, stand_off


def turn_about_normals(normals: Array, count: int) -> Array:
    """Orientations (n count, 3, 3) that approach against unit ``normals`` (n, 3), each turned ``count`` times about it.

    Turns count from the part's x axis (its y axis where the normal is along x).
    """
    x = directions_about(normals, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), count).reshape(-1, 3)
    z = -np.repeat(normals, count, axis=0)
    return np.stack([x, np.cross(z, x), z], axis=-1)
