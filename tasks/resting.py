"""How parts stand at the start: what each rests on, or by how much it does not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import atan2, degrees, radians, sin

import numpy as np
import trimesh
from scipy.spatial import QhullError

from ..errors import InputError
from ..grasping.part import Part
from ..regrasp.placements import SMALLEST_MARGIN, find_placements
from ..regrasp.polygons import outline
from ..robots.scene import Scene
from ..robots.state import Contact, SceneState
from ..transforms import Array, compose, invert, rotation_about, rpy_from_rotation, transform_points

_LARGEST_TILT = radians(1.0)
_UP = np.array([0.0, 0.0, 1.0])
_STEP, _STEPS = 5e-3, 100  # m; how far up and down the right height is looked for
_SMALL_RISE = 0.02  # m; parts that overlap by more stand in each other, not too low
_EXACT = 1e-6  # m
_REACH = 2e-3  # m below or above a part's bottom within which what lies there carries it
_FINENESS = 30  # points along the longest side of a part's bottom


def resting_contacts(scene: Scene, state: SceneState, parts: Mapping[str, Part]) -> tuple[Contact, ...]:
    """What each of ``parts`` rests on in ``state``: obstacles or other parts.

    A part rests if it stands in a stable placement, to 1 deg, if once it is lower by the scene's contact tolerance it
    touches something that it does not touch once it is higher by as much, and if its centre of mass lies above that.

    Raises:
        InputError: A part would topple, floats or overlaps something; with how much, and the height or turn to give.
    """
    contacts: list[Contact] = []
    for name, part in parts.items():
        upright = _upright(part, state.poses[name], f"parts.{name}.at")
        carriers = _carriers(scene, state, name, f"parts.{name}.at")
        _check_balance(scene, state, part, upright, carriers, f"parts.{name}.at")
        contacts += [Contact(other, name, state.poses[other][2, :3].copy()) for other in carriers]
    return tuple(contacts)


def _upright(part: Part, world_from_part: Array, place: str) -> Array:
    """The pose (4, 4) turned about the centre of mass into the stable placement that it stands in, to 1 deg."""
    ups = find_placements(part).surface_from_part[:, 2, :3] @ world_from_part[:3, :3].T
    if not len(ups):
        raise InputError(place, "the part has no stable placement on a plane", "leave it out: it needs a fixture")
    up = ups[ups[:, 2].argmax()]
    across = np.cross(up, _UP)
    tilt = atan2(float(np.linalg.norm(across)), float(up[2]))
    axis = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-9 else np.array([1.0, 0.0, 0.0])
    rotation = rotation_about(axis, tilt) @ world_from_part[:3, :3]
    if tilt > _LARGEST_TILT:
        problem = f"it would topple: it is tilted by {degrees(tilt):.1f} deg from the nearest stable placement"
        rpy = ", ".join(f"{degrees(angle):.2f} deg" for angle in rpy_from_rotation(rotation))
        raise InputError(place, problem, f"give rpy: [{rpy}]")
    center = transform_points(world_from_part, part.center_of_mass[None])[0]
    return compose(rotation, center - rotation @ part.center_of_mass)


def _carriers(scene: Scene, state: SceneState, name: str, place: str) -> list[str]:
    """The bodies that the part ``name`` rests on."""
    body, tolerance = scene.bodies[name], scene.contact_tolerance

    def touched(rise: float) -> list[str]:
        part_from_world = invert(compose(np.eye(3), rise * _UP) @ state.poses[name])
        others = [other for other in scene.bodies if other != name]
        return [other for other in others if body.touches(scene.bodies[other], part_from_world @ state.poses[other])]

    z = state.poses[name][2, 3]
    above, below = touched(tolerance), touched(-tolerance)
    if overlapped := [other for other in above if other in below]:
        rise = _first(lambda height: not set(overlapped).intersection(touched(height)))
        listed = " and ".join(overlapped)
        if rise is None or rise > _SMALL_RISE:
            raise InputError(place, f"it overlaps {listed}", "put it elsewhere")
        cure = f"give z = {z + rise:.5f} m, or put it elsewhere"
        raise InputError(place, f"it overlaps {listed} by {rise * 1e3:.2f} mm", cure)
    if not below:
        drop = _first(lambda height: bool(touched(-height)))
        if drop is None:
            raise InputError(place, "it floats, and nothing is below it", "put it on a support")
        listed = " and ".join(touched(-drop - _EXACT))
        raise InputError(place, f"it floats {drop * 1e3:.2f} mm above {listed}", f"give z = {z - drop:.5f} m")
    return below


def _first(holds: Callable[[float], bool]) -> float | None:
    """The smallest distance [m], found in steps and then halved in, from which on ``holds`` is true."""
    for step in range(1, _STEPS + 1):
        if holds(step * _STEP):
            low, high = (step - 1) * _STEP, step * _STEP
            while high - low > _EXACT:
                middle = (low + high) / 2.0
                low, high = (low, middle) if holds(middle) else (middle, high)
            return high
    return None


def _check_balance(
    scene: Scene, state: SceneState, part: Part, world_from_part: Array, carriers: list[str], place: str
) -> None:
    """Whether the centre of mass lies above what carries the part, far enough inside to bear some tilt."""
    points = transform_points(world_from_part, _bottom(part, world_from_part))
    carried = np.zeros(len(points), dtype=bool)
    for other in carriers:
        other_from_world = invert(state.poses[other])
        origins = transform_points(other_from_world, points + _REACH * _UP)
        downward = np.tile(-other_from_world[:3, 2], (len(points), 1))
        mesh = scene.bodies[other].mesh
        where, ray, _ = mesh.ray.intersects_location(origins, downward, multiple_hits=False)
        carried[ray[np.linalg.norm(where - origins[ray], axis=1) < 2.0 * _REACH]] = True
    center = transform_points(world_from_part, part.center_of_mass[None])[0]
    inside = _distance_inside(points[carried], center)
    if atan2(inside, center[2] - points[:, 2].min()) < SMALLEST_MARGIN:
        listed = " and ".join(carriers)
        far = f"{abs(inside) * 1e3:.1f} mm {'within' if inside > 0.0 else 'outside'}"
        problem = f"it would topple off {listed}: its centre of mass lies {far} the edge of what carries it"
        raise InputError(place, problem, "move it over what shall carry it")


def _bottom(part: Part, world_from_part: Array) -> Array:
    """Points (n, 3) all over the bottom of the part as it stands, in its own frame [m]."""
    vertices, faces = part.mesh.vertices, part.mesh.faces
    height = vertices @ world_from_part[2, :3]
    size = float(np.ptp(vertices, axis=0).max())
    low = height < height.min() + size * sin(_LARGEST_TILT)
    flat = faces[low[faces].all(axis=1)]
    if not len(flat):
        return np.asarray(vertices[low])
    fine, _ = trimesh.remesh.subdivide_to_size(vertices, flat, size / _FINENESS, max_iter=20)
    return np.vstack([vertices[low], fine])


def _distance_inside(points: Array, center: Array) -> float:
    """How far ``center`` (3,) lies inside the convex outline of ``points`` (n, 3) seen from above [m]."""
    try:
        start = outline(points)
    except (QhullError, ValueError):  # too few points, or all in a line: their edge is all there is
        nearest = np.linalg.norm(points[:, :2] - center[:2], axis=1).min(initial=np.inf)
        return -float(nearest)
    along = np.roll(start, -1, axis=0) - start
    inward = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    return float(((center[:2] - start) * inward).sum(axis=1).min())
