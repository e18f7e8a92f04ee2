"""What simulation measured of grasps: how far the part moved as the fingers closed, and whether the hand kept it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..transforms import Array


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of n grasps, each tried on a part that lay on a table; zeros where it was not tried.

    Attributes:
        tried: (n,) bool, whether the grasp was tried.
        shift: (n,) how far the part's centre of mass moved along the table while the fingers closed [m].
        turn: (n,) by how much the part turned meanwhile [rad].
        slip: (n,) how far the centre of mass moved in the hand while the part was lifted [m].
        held: (n,) bool, whether the part was lifted, and still in the hand after shaking.
    """

    tried: npt.NDArray[np.bool_]
    shift: Array
    turn: Array
    slip: Array
    held: npt.NDArray[np.bool_]

    def __post_init__(self) -> None:
        """Check shapes, kinds and values.

        Raises:
            InputError: An array is not what this class promises.
        """
        shape = (np.size(self.tried),)
        for name, kind in _KINDS.items():
            array, place = getattr(self, name), f"measured: {name}"
            if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype.kind != kind:
                given = f"shape {np.shape(array)} and dtype {getattr(array, 'dtype', type(array).__name__)}"
                raise InputError(place, given, f"give {'truth values' if kind == 'b' else 'floats'} of shape {shape}")
            if not (np.isfinite(array).all() and (array >= 0).all()):
                raise InputError(place, "a number is negative or not finite", "give finite numbers of at least 0")
            if array[~self.tried].any():
                raise InputError(place, "told of a grasp that was not tried", "give 0 or False there")
            array.setflags(write=False)

    def __len__(self) -> int:
        """Number of grasps n."""
        return len(self.tried)

    def take(self, chosen: npt.NDArray[np.int64] | npt.NDArray[np.bool_] | slice) -> Measured:
        """What was measured of the chosen grasps: a mask, indices or a slice."""
        return Measured(*(getattr(self, name)[chosen] for name in _KINDS))

    def joined(self, other: Measured) -> Measured:
        """What was measured of these grasps, then of the other ones."""
        return Measured(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _KINDS))


_KINDS = {item.name: "b" if item.name in ("tried", "held") else "f" for item in fields(Measured)}
