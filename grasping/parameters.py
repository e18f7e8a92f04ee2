"""The paper's tunable parameters, under the paper's names."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi, radians
from numbers import Real

from ..errors import InputError

_RANGES: dict[str, tuple[float, float, str]] = {
    "theta_pln": (0.0, pi, "rad"),
    "theta_fct": (0.0, pi, "rad"),
    "t_bdry": (0.0, 0.1, "m"),
    "t_rnn": (1e-4, 0.1, "m"),
    "h_max": (0.0, 0.02, "m"),
    "theta_parl": (pi / 2, pi, "rad"),
    "t_dct": (0.0, 0.1, "m"),
    "n_da": (1, 360, ""),
    "contact_tolerance": (0.0, 0.005, "m"),
}


@dataclass(frozen=True)
class GraspParameters:
    """The eight knobs of the paper (section V.A) with its defaults, and the tolerance of a nominal contact.

    Attributes:
        theta_pln: Planarity of a facet: the largest angle between a triangle of a facet and its seed [rad].
        theta_fct: Overlap of facets: the largest angle between a triangle and the nearest seed of its facets [rad].
        t_bdry: Smallest distance of a contact from the boundary of its facet [m].
        t_rnn: Smallest distance between two contacts of a facet: the radius of the contact region [m].
        h_max: Deepest penetration of the soft pad [m].
        theta_parl: Smallest angle between the normals of two opposing facets [rad].
        t_dct: How far from the surface a finger of a three-finger gripper may stop [m].
        n_da: Number of rotations about a contact normal or a closing axis.
        contact_tolerance: Opening a side at which fingers that touch the part must be free of it [m].

    Raises:
        InputError: A value outside its range; the message has the range.
    """

    theta_pln: float = radians(20.0)
    theta_fct: float = radians(20.0)
    t_bdry: float = 2e-3
    t_rnn: float = 3e-3
    h_max: float = 1.5e-3
    theta_parl: float = radians(160.0)
    t_dct: float = 3e-3
    n_da: int = 8
    contact_tolerance: float = 0.5e-3

    def __post_init__(self) -> None:
        """Check every field against its range."""
        for item in fields(self):
            value, (low, high, unit) = getattr(self, item.name), _RANGES[item.name]
            wanted = (
                f"give {'an integer' if item.type == 'int' else 'a number'} from {low:g} to {high:g} {unit}".rstrip()
            )
            number = isinstance(value, Real) and not isinstance(value, bool)
            if not number or (item.type == "int" and value % 1 != 0):
                raise InputError(item.name, f"{value!r} is not what is expected", wanted)
            if not low <= value <= high:
                raise InputError(item.name, f"{value!r} is out of range", wanted)
