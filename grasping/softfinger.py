"""Soft-finger contact: does a grasp hold the part whichever way gravity turns it (paper, section III.B.3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..transforms import Array

GRAVITY = 9.80665  # m/s2, standard
_COPLANAR = np.radians(0.5)  # triangles that turn less than this are noise of the tessellation


def curvature_radius(distance: Array, angle: Array, offsets: npt.NDArray[np.int64]) -> Array:
    """Radius of curvature (k,) [m] of facets, from how their triangles lie to their seeds.

    One over the largest curvature: the smallest distance / angle over the triangles that turn away from the seed by
    more than 0.5 deg; infinite where none does.

    Args:
        distance: (total,) from each triangle's centre to its seed's [m], facet by facet.
        angle: (total,) between each triangle's normal and its seed's [rad].
        offsets: (k + 1,) where each facet starts; no facet is empty.
    """
    turned = angle > _COPLANAR
    radius = np.full(len(angle), np.inf)
    np.divide(distance, angle, out=radius, where=turned)
    return np.minimum.reduceat(radius, offsets[:-1]) if len(offsets) > 1 else np.zeros(0)


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
