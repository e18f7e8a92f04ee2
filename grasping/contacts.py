"""Contact points: the surface sampled once, handed to the facets and refined twice (paper, section III.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..transforms import Array
from .facets import Facets, Indices
from .parameters import GraspParameters
from .part import Part
from .record import Stage


@dataclass(frozen=True, eq=False)
class Contacts:
    """n contact points in the part's frame, in ascending order of their facets.

    A sample of the surface that lies in several facets may be a contact of each of them: ``sample`` tells.

    Attributes:
        points: (n, 3) [m], on the surface.
        normals: (n, 3) outward unit normals of the triangles the points lie on.
        smooth_normals: (n, 3) outward unit normals of the contact regions: the mean over the facet's surface within
            ``t_rnn`` of the point.
        face: (n,) triangle of the mesh each point lies on.
        facet: (n,) facet each contact belongs to.
        sample: (n,) sample of the surface each contact is.
    """

    points: Array
    normals: Array
    smooth_normals: Array
    face: Indices
    facet: Indices
    sample: Indices

    def __len__(self) -> int:
        """Number of contacts n."""
        return len(self.points)

    def take(self, chosen: npt.NDArray[np.int64] | npt.NDArray[np.bool_]) -> Contacts:
        """The chosen contacts: indices or a mask."""
        raise NotImplementedError


def sample_contacts(part: Part, facets: Facets, parameters: GraspParameters) -> tuple[Contacts, tuple[Stage, ...]]:
    """Sample the surface once, hand each sample to its facets, and refine twice (section III.B.1 and 2).

    Returns:
        The contacts, and the stages ``"sampling"``, ``"refinement 1"`` and ``"refinement 2"``.
    """
    raise NotImplementedError


def boundary_distance(part: Part, facets: Facets, points: Array, facet: Indices, reach: float) -> Array:
    """Distance (n,) [m] of each point (n, 3) to the boundary of its facet (n,), infinite where it is ``reach`` or more.

    The boundary of a facet is the edges that exactly one of its triangles has: its rim and those of its holes. The
    distance is the straight one in space.
    """
    raise NotImplementedError
