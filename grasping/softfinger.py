"""Soft-finger contact: does a grasp hold the part whichever way gravity turns it (paper, section III.B.3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import trimesh

from ..transforms import Array

Indices = npt.NDArray[np.int64]

GRAVITY = 9.80665  # m/s2, standard
_COPLANAR = np.radians(0.5)  # triangles that turn less than this are noise of the tessellation


def curvature_radius(mesh: trimesh.Trimesh, faces: Indices, offsets: Indices, seed: Indices, theta_pln: float) -> Array:
    """Radius of curvature (k,) [m] of facets: one over the largest curvature; infinite where no triangle turns.

    The curvature is that of Cohen-Steiner and Morvan's normal cycle: every edge across which the surface turns smoothly
    counts its angle times its length, in the direction across it, over the area. Edges on the facet's rim belong to it
    by half; turns either way add up, so that bumps and hollows do not cancel; where the direction of bending itself
    turns round within a facet (a ring of a torus) the radius is up to twice too large. Cut finer, the same surface has
    the same radius. The paper's d_i / theta_i of a triangle and its seed does not give that: its smallest value (the
    sharpest turn) falls with the size of the triangles, to a fifth on a cylinder of 20 mm cut into triangles of 3 mm,
    and its largest one is infinite wherever a neighbour is coplanar with the seed.

    Args:
        mesh: The part's triangles [m].
        faces: (total,) triangles of the facets, facet by facet.
        offsets: (k + 1,) where each facet starts; no facet is empty.
        seed: (k,) seeds. A facet is flat where no triangle turns more than 0.5 deg away from its seed.
        theta_pln: Planarity of the facets: what turns more across an edge is an edge of the part [rad].
    """
    bending = np.add.reduceat(_bending(mesh, theta_pln + _COPLANAR)[faces], offsets[:-1])
    area = np.add.reduceat(mesh.area_faces[faces], offsets[:-1])
    curvature = np.linalg.eigvalsh(bending / area[:, None, None])[:, -1]
    own = np.repeat(seed, np.diff(offsets))
    aligned = np.einsum("ni,ni->n", mesh.face_normals[faces], mesh.face_normals[own])
    turned = np.minimum.reduceat(aligned, offsets[:-1]) < np.cos(_COPLANAR)
    return np.asarray(np.divide(1.0, curvature, out=np.full(len(seed), np.inf), where=turned & (curvature > 0.0)))


def _bending(mesh: trimesh.Trimesh, smooth: float) -> Array:
    """Half of angle x length of each triangle's three edges as tensors along the edges (n, 3, 3) [m].

    Edges that turn more than ``smooth`` [rad] or do not join two triangles count nothing.
    """
    start, end = np.swapaxes(mesh.vertices.view(np.ndarray)[mesh.face_adjacency_edges], 0, 1)
    angle, length = mesh.face_adjacency_angles, np.linalg.norm(end - start, axis=1)
    weight = np.where(angle <= smooth, angle, 0.0) / (2.0 * length)
    tensors = weight[:, None, None] * (end - start)[:, :, None] * (end - start)[:, None]
    bending = np.zeros((len(mesh.faces), 3, 3))
    for side in mesh.face_adjacency.T:
        np.add.at(bending, side, tensors)
    return bending


def eccentricity(radius: npt.ArrayLike, h_max: float, pad_radius: float) -> Array:
    """Eccentricity e_n (n,) [m] of soft contacts: largest frictional torque over largest frictional force (eq. 2).

    With the penetration h = min(h_max, R), the contact radius a = sqrt(2 R h - h^2) and the part of it that the pad
    covers, p = min(a, pad radius), eq. 2 under eq. 3 is e_n = p (a^2/3 - p^2/5) / (a^2/2 - p^2/4): 8 a / 15 where the
    pad covers the contact, 2 p / 3 on a flat facet.

    Args:
        radius: (n,) radius of curvature R of the surface, infinite where flat [m].
        h_max: Deepest penetration of the pad [m].
        pad_radius: Half the shorter side of the pad's face [m].
    """
    radius = np.asarray(radius, dtype=np.float64)
    if h_max == 0.0:
        return np.zeros_like(radius)
    penetration = np.minimum(h_max, radius)
    contact = np.sqrt(2.0 * radius * penetration - penetration**2)
    covered = np.minimum(contact, pad_radius)
    ratio = np.divide(covered, contact, out=np.ones_like(contact), where=contact > 0.0) ** 2  # (p / a)^2
    return np.asarray(covered * (1.0 / 3.0 - ratio / 5.0) / (1.0 / 2.0 - ratio / 4.0))


def stability_margin(
    lever: npt.ArrayLike, eccentricity: npt.ArrayLike, mass: float, friction: float, force: npt.ArrayLike
) -> Array:
    """Margin (n,) of eq. 4: 1 - m g c / (e_n sqrt(mu^2 f_n^2 - (m g)^2)); the grasp holds where it is not negative.

    One where the lever is zero, minus infinity where friction cannot even carry the weight (mu f_n <= m g) or the
    contact resists no torque (e_n = 0).

    Args:
        lever: (n,) distance c from the centre of mass to the centre of the contacts [m].
        eccentricity: (n,) e_n of the weaker contact [m].
        mass: Mass of the part [kg].
        friction: Coefficient of friction mu.
        force: (n,) or one: normal force f_n [N].
    """
    weight = mass * GRAVITY
    spare = np.maximum((friction * np.asarray(force, dtype=np.float64)) ** 2 - weight**2, 0.0)
    lever, torque = np.broadcast_arrays(np.asarray(lever, dtype=np.float64), np.asarray(eccentricity) * np.sqrt(spare))
    share = np.divide(weight * lever, torque, out=np.full(lever.shape, np.inf), where=torque > 0.0)
    return np.asarray(1.0 - share)
