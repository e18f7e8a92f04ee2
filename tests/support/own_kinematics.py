"""Where the flanges of a shipped robot are: pinocchio on the URDF, and nothing of the package."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

import kumitate.robots.library

LIBRARY = Path(kumitate.robots.library.__file__).parent


class Flanges:
    """The flanges of a robot whose configurations have the joints in the given order."""

    def __init__(self, robot: str, joints: Sequence[str]) -> None:
        self.model = pin.buildModelFromUrdf(str(LIBRARY / f"{robot}.urdf"))
        self.data = self.model.createData()
        self._columns = [self.model.joints[self.model.getJointId(name)].idx_q for name in joints]

    def at(self, q: Sequence[float]) -> dict[str, np.ndarray]:
        """Pose (4, 4) of each arm's flange in the world."""
        ordered = pin.neutral(self.model)
        ordered[self._columns] = q
        pin.framesForwardKinematics(self.model, self.data, ordered)
        frames = {name: self.model.getFrameId(f"{name}_flange") for name in ("left", "right")}
        return {name: np.array(self.data.oMf[frame].homogeneous) for name, frame in frames.items()}
