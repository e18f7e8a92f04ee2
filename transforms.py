"""The few helpers on (4, 4) and (n, 4, 4) arrays that numpy and pinocchio lack.

A pose is named after both of its frames, so that chains read off:
``world_from_hand = world_from_part @ part_from_hand``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .errors import InputError

Array = npt.NDArray[np.float64]
_ROTATION_TOLERANCE = 1e-6
_LEVEL = 1e-6


def rotation_from_rpy(rpy: Sequence[float] | Array) -> Array:
    """Rotation (3, 3) of fixed-axis roll, pitch, yaw about x, y, z [rad]."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_about(axes: Sequence[float] | Array, angles: float | Array) -> Array:
    """Rotations (..., 3, 3) about unit ``axes`` (..., 3) by ``angles`` (...) [rad] (Rodrigues)."""
    axes, angles = np.asarray(axes, dtype=float), np.asarray(angles, dtype=float)
    shape = np.broadcast_shapes(axes.shape[:-1], angles.shape)
    x, y, z = np.moveaxis(np.broadcast_to(axes, (*shape, 3)), -1, 0)
    zero = np.zeros(shape)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*shape, 3, 3)
    sine, cosine = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
    rotation: Array = np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross)
    return rotation


def compose(rotation: Array, translation: Sequence[float] | Array) -> Array:
    """Poses (..., 4, 4) from ``rotation`` (..., 3, 3) and ``translation`` (..., 3) [m], broadcast together."""
    rotation, translation = np.asarray(rotation, dtype=float), np.asarray(translation, dtype=float)
    shape = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    poses = np.zeros((*shape, 4, 4))
    poses[..., :3, :3] = rotation
    poses[..., :3, 3] = translation
    poses[..., 3, 3] = 1.0
    return poses


def pose(xyz: Sequence[float] | Array = (0.0, 0.0, 0.0), rpy: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """One pose (4, 4) from a position [m] and fixed-axis roll, pitch, yaw [rad].

    Raises:
        InputError: Either is not three finite numbers.
    """
    vectors = {"xyz": checked_numbers(xyz, "pose: xyz"), "rpy": checked_numbers(rpy, "pose: rpy")}
    for name, vector in vectors.items():
        if vector.shape != (3,) or not np.isfinite(vector).all():
            raise InputError(f"pose: {name}", f"{vector} is no vector", "give three finite numbers [m, rad]")
    return compose(rotation_from_rpy(vectors["rpy"]), vectors["xyz"])


def rpy_from_rotation(rotation: Array) -> tuple[float, float, float]:
    """Fixed-axis roll, pitch, yaw [rad] of a rotation (3, 3); roll is 0 where it turns about the axis that yaw does."""
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], level))
    if level < _LEVEL:  # x points up or down
        return 0.0, pitch, float(np.arctan2(-rotation[0, 1], rotation[1, 1]))
    roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return float(roll), pitch, float(yaw)


def invert(poses: Array) -> Array:
    """Inverse of rigid ``poses`` (..., 4, 4)."""
    rotation = np.swapaxes(poses[..., :3, :3], -1, -2)
    return compose(rotation, -(rotation @ poses[..., :3, 3:])[..., 0])


def transform_points(poses: Array, points: Array) -> Array:
    """Points (..., k, 3) of frame b expressed in frame a, for ``poses`` a_from_b (..., 4, 4)."""
    moved: Array = points @ np.swapaxes(poses[..., :3, :3], -1, -2) + poses[..., None, :3, 3]
    return moved


def rotation_angle(rotation: Array) -> Array:
    """Angle (...) [rad] of rotations (..., 3, 3), accurate near zero too."""
    skew = np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    angle: Array = np.arctan2(np.linalg.norm(skew, axis=-1), np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    return angle


def pose_distance(a: Array, b: Array) -> tuple[Array, Array]:
    """Distance (...) [m] and angle (...) [rad] between poses a and b (..., 4, 4)."""
    relative = np.swapaxes(a[..., :3, :3], -1, -2) @ b[..., :3, :3]
    return np.linalg.norm(a[..., :3, 3] - b[..., :3, 3], axis=-1), rotation_angle(relative)


def checked_numbers(values: npt.ArrayLike, place: str) -> Array:
    """``values`` as a float array of any shape.

    Raises:
        InputError: They are no numbers, or rows of different lengths.
    """
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(place, f"no array of numbers ({error})", "give numbers, every row as long") from error


def checked_pose(pose: npt.ArrayLike, place: str) -> Array:
    """``pose`` as a float array (4, 4).

    Raises:
        InputError: Wrong shape, a number that is not finite, or a matrix that is no rigid pose.
    """
    array = checked_poses(pose, place)
    if array.ndim != 2:
        raise InputError(place, f"shape {array.shape} is not one pose", "give one array of shape (4, 4)")
    return array


def checked_poses(poses: npt.ArrayLike, place: str) -> Array:
    """``poses`` as a float array (..., 4, 4).

    Raises:
        InputError: Wrong shape, a number that is not finite, or a matrix that is no rigid pose.
    """
    array = checked_numbers(poses, place)
    if array.shape[-2:] != (4, 4):
        raise InputError(place, f"shape {array.shape} is no pose", "give arrays of shape (4, 4) or (n, 4, 4)")
    rotation = array[..., :3, :3]
    rigid = (
        np.isfinite(array).all()
        and np.allclose(rotation @ np.swapaxes(rotation, -1, -2), np.eye(3), atol=_ROTATION_TOLERANCE)
        and (np.linalg.det(rotation) > 0).all()
        and np.allclose(array[..., 3, :], [0.0, 0.0, 0.0, 1.0], atol=_ROTATION_TOLERANCE)
    )
    if not rigid:
        raise InputError(place, "a matrix is no rigid pose", "give a rotation and a translation [m], all finite")
    return array
