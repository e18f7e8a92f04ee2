"""Soft-finger contact: does a grasp hold the part whichever way gravity turns it (paper, section III.B.3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..transforms import Array

GRAVITY = 9.80665  # m/s2, standard


def curvature_radius(distance: Array, angle: Array, offsets: npt.NDArray[np.int64]) -> Array:
    """Radius of curvature (k,) [m] of facets, from how their triangles lie to their seeds.

    One over the largest curvature: the smallest distance / angle over the triangles that turn away from the seed by more
    than 0.5 deg; infinite where none does.

    Args:
        distance: (total,) from each triangle's centre to its seed's [m], facet by facet.
        angle: (total,) between each triangle's normal and its seed's [rad].
        offsets: (k + 1,) where each facet starts.
    """
    raise NotImplementedError


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
    raise NotImplementedError


def stability_margin(
    lever: npt.ArrayLike, eccentricity: npt.ArrayLike, mass: float, friction: float, force: npt.ArrayLike
) -> Array:
    """Margin (n,) of eq. 4: 1 - m g c / (e_n sqrt(mu^2 f_n^2 - (m g)^2)); the grasp holds where it is not negative.

    One where the lever is zero, minus infinity where friction cannot even carry the weight (mu f_n <= m g).

    Args:
        lever: (n,) distance c from the centre of mass to the centre of the contacts [m].
        eccentricity: (n,) e_n of the weaker contact [m].
        mass: Mass of the part [kg].
        friction: Coefficient of friction mu.
        force: (n,) or one: normal force f_n [N].
    """
    raise NotImplementedError
