"""Parts that nobody holds stand on something, and safely: what they rest on lies around below their centre of mass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from ..transforms import Array, pose, transform_points
from .verify_cell import Cell
from .verify_contacts import TOLERANCE
from .verify_faults import Findings
from .verify_holds import Stretch
from .verify_motion import Curve

BELOW = 1e-3  # m within which a support must lie below a part
LEAST_TILT = float(np.deg2rad(2.0))  # that the centre of mass must be from toppling; less is balancing on an edge
_HALVINGS = 8
_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass
class Resting:
    """Looks at parts at rest; each way of resting is looked at once.

    Attributes:
        cell: The cell.
        findings: Where faults go.
    """

    cell: Cell
    findings: Findings
    _known: dict[bytes, tuple[str, str]] = field(default_factory=dict)
    _weights: dict[str, tuple[float, Array]] = field(default_factory=dict)

    def look(self, stretch: Stretch, curve: Curve) -> None:
        """Look at every part that nobody holds, at the end of a stretch."""
        at = curve.at(np.array([stretch.end]))
        poses = {name: where[0] for name, where in stretch.poses(self.cell.flanges(at)).items()}
        free = {name: poses[name] for name in poses if not stretch.hands(stretch.assembly(name))}
        for name in free:
            members = sorted(stretch.assembly(name))
            if members[0] == name:
                fault, words = self._fault(members, free)
                if fault:
                    self.findings.add(fault, words, action=stretch.action, time=stretch.end, bodies=members)

    def _fault(self, members: list[str], free: dict[str, Array]) -> tuple[str, str]:
        """Name and words of what is wrong with an assembly at rest; empty if nothing is."""
        key = b"".join([*(name.encode() for name in members), *(np.round(p, 9).tobytes() for p in free.values())])
        key += " ".join(free).encode()
        if key not in self._known:
            self._known[key] = self._looked_at(members, free)
        return self._known[key]

    def _looked_at(self, members: list[str], free: dict[str, Array]) -> tuple[str, str]:
        others = {name: where for name, where in free.items() if name not in members}
        supports = {body.name for body in self.cell.bodies if body.support}
        others |= {name: where for name, where in self.cell.standing.items() if name in supports}
        below = touched(self.cell, members, free, others, BELOW)
        if not below:
            return "unsupported", f"nothing lies within {1e3 * BELOW:g} mm below {' and '.join(members)}"
        low, high = -TOLERANCE, BELOW
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            low, high = (low, middle) if touched(self.cell, members, free, others, middle) else (middle, high)
        center = self._center(members, free)
        points = self._region(members, free, others, high + TOLERANCE)
        tilt = _tilt(points, center)
        if tilt < LEAST_TILT:
            words = f"{' and '.join(members)} would topple off {' and '.join(below)}: "
            words += f"the centre of mass is {np.rad2deg(tilt):.1f} deg from toppling, {np.rad2deg(LEAST_TILT):.0f} deg"
            return "topples", words + " is the least"
        return "", ""

    def _region(self, members: list[str], free: dict[str, Array], others: dict[str, Array], drop: float) -> Array:
        """Points (k, 3) around where the assembly rests: its surface and its supports' cross there once it is lower."""
        down, number = pose(drop * _DOWN), self.cell.number
        crossings = [
            self.cell.solids.crossings(number[member], down @ free[member], number[other], where)
            for member in members
            for other, where in others.items()
        ]
        return np.concatenate(crossings) - drop * _DOWN

    def _center(self, members: list[str], free: dict[str, Array]) -> Array:
        """Centre of mass (3,) of the assembly in the world [m]."""
        weights = [self._weight(member) for member in members]
        centers = [transform_points(free[member], weights[i][1][None])[0] for i, member in enumerate(members)]
        return np.average(centers, axis=0, weights=[mass for mass, _ in weights])

    def _weight(self, part: str) -> tuple[float, Array]:
        """Mass [kg] and centre of mass (3,) of a part, of uniform density; of its hull if its surface is open."""
        if part not in self._weights:
            given = self.cell.solids.meshes[self.cell.number[part]]
            mesh = trimesh.Trimesh(given.vertices, given.faces)  # merges what a file writes for every triangle anew
            solid = mesh if mesh.is_watertight else mesh.convex_hull
            entry = self.cell.task.parts[part]
            mass = entry.mass if entry.mass is not None else float(entry.density or 1.0) * abs(solid.volume)
            self._weights[part] = float(mass), np.asarray(solid.center_mass)
        return self._weights[part]


def touched(
    cell: Cell, members: Iterable[str], poses: Mapping[str, Array], others: Mapping[str, Array], drop: float
) -> list[str]:
    """What parts touch once they are lower by ``drop`` [m].

    Args:
        cell: The cell.
        members: The parts.
        poses: Pose (4, 4) in the world of every part.
        others: The same of what they may touch.
        drop: How much lower they are [m].
    """
    down, number = pose(drop * _DOWN), cell.number
    return [
        other
        for other, where in others.items()
        if any(cell.solids.touch(number[m], down @ poses[m], number[other], where) for m in members)
    ]


def _tilt(points: Array, center: Array) -> float:
    """The least tilt [rad] that brings ``center`` (3,) over the edge of the hull of ``points`` (k, 3) seen from above.

    Negative where it lies beyond already.
    """
    try:
        hull = ConvexHull(points[:, :2])
    except (QhullError, ValueError, IndexError):  # a line, a point or nothing
        return 0.0
    inside = -(hull.equations[:, :2] @ center[:2] + hull.equations[:, 2]).max()
    return float(np.arctan2(inside, center[2] - points[:, 2].min()))
