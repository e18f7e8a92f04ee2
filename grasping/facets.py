"""Superimposed segmentation: a mesh peeled into facets that overlap (paper, section III.A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..transforms import Array
from .part import Part

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Facets:
    """k facets; facet i holds the triangles ``faces[offsets[i]:offsets[i + 1]]`` of the mesh, in ascending order.

    Attributes:
        faces: (total,) triangles, facet by facet; a triangle may lie in several facets.
        offsets: (k + 1,) where each facet starts in ``faces``.
        seed: (k,) the triangle each facet grew from.
        normal: (k, 3) area-weighted mean of the triangles' unit normals, of unit length.
        radius: (k,) radius of curvature [m], infinite where the facet is flat (section III.B.3).
    """

    faces: Indices
    offsets: Indices
    seed: Indices
    normal: Array
    radius: Array

    def __len__(self) -> int:
        """Number of facets k."""
        return len(self.seed)

    def __getitem__(self, facet: int) -> Indices:
        """Triangles of one facet."""
        return self.faces[self.offsets[facet] : self.offsets[facet + 1]]

    @property
    def owner(self) -> Indices:
        """(total,) the facet of each entry of ``faces``."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))


def segment(part: Part, theta_pln: float, theta_fct: float) -> Facets:
    """Peel the part's mesh into superimposed facets.

    Args:
        part: The part.
        theta_pln: Largest angle between a triangle of a facet and its seed [rad].
        theta_fct: A triangle whose facets' seeds are all farther than this from its own normal starts a new facet [rad].
    """
    raise NotImplementedError
