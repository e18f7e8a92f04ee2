"""Damped Newton steps towards poses, for whole arrays of configurations at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..transforms import Array
from .chain import Chain

TOLERANCE = 1e-6  # how exactly an answer must meet its pose [m and rad]
_DONE = 1e-9  # an error below this is rounding [m and rad]
_DAMPING = 0.03  # damping for each unit of squared error: cautious far away, quadratic convergence nearby
_LEAST_DAMPING = 1e-10
_Z = np.array([[0.0], [0.0], [1.0]])


def newton(chain: Chain, q: Array, world_from_tip: Array, iterations: int) -> Array:
    """Configurations (n, dof) within the limits, moved from ``q`` towards the poses.

    Levenberg-Marquardt with a damping that falls with the squared error (Sugihara 2011). A joint at its limit that
    would have to leave it stands still and the others make up for it; with more than six joints steps are the shortest.

    Args:
        chain: The arm.
        q: (n, dof) where to start [rad or m].
        world_from_tip: (n, 4, 4) a pose for each.
        iterations: Steps at most.
    """
    q = np.clip(q, chain.lower, chain.upper)
    goals = np.ascontiguousarray(world_from_tip[:, :3].transpose(2, 1, 0))
    rows = np.arange(len(q))
    for _ in range(iterations):
        frames = chain.sweep(q[rows])
        error = pose_error(frames[-1], goals[..., rows])
        square = (error**2).sum(axis=0)
        going = square > _DONE**2
        rows, error, square = rows[going], error[:, going], square[going]
        if not rows.size:
            break
        jacobian = chain.jacobian_of(frames[..., going])
        at = q[rows].T
        step = _damped_step(jacobian, error, _DAMPING * square + _LEAST_DAMPING)
        blocked = np.where(step > 0.0, at >= chain.upper[:, None], at <= chain.lower[:, None])
        stuck = blocked.any(axis=0)
        if stuck.any():
            eased = jacobian[..., stuck] * ~blocked[:, stuck]
            step[:, stuck] = _damped_step(eased, error[:, stuck], _DAMPING * square[stuck] + _LEAST_DAMPING)
        q[rows] = np.clip((at + step).T, chain.lower, chain.upper)
    return q


def pose_error(columns: Array, goals: Array) -> Array:
    """Translation above rotation vector (6, n), along the world's axes, from poses to goals as columns (4, 3, n)."""
    a, b = columns[:3], goals[:3]
    sine = 0.5 * np.stack(
        [
            (a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]).sum(axis=0),
            (a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(axis=0),
            (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(axis=0),
        ]
    )
    size = np.sqrt((sine**2).sum(axis=0))
    angle = np.arctan2(size, 0.5 * ((a * b).sum(axis=(0, 1)) - 1.0))
    # Half a turn has no sine, but must not look like none: any axis will do.
    axis = np.where(size > 0.0, sine / np.maximum(size, 1e-300), _Z)
    return np.concatenate([goals[3] - columns[3], axis * angle])


def is_at(chain: Chain, q: Array, world_from_tip: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether ``q`` (n, dof) puts the tip within 1e-6 m and 1e-6 rad of the poses (n, 4, 4)."""
    error = pose_error(chain.sweep(q)[-1], world_from_tip[:, :3].transpose(2, 1, 0))
    square = (error.reshape(2, 3, -1) ** 2).sum(axis=1)
    return np.asarray((square <= TOLERANCE**2).all(axis=0))


def _damped_step(jacobian: Array, error: Array, damping: Array) -> Array:
    """The step (dof, n) J^T (J J^T + damping I)^-1 error, for Jacobians (6, dof, n)."""
    square = np.einsum("ikn,jkn->nij", jacobian, jacobian)
    square[:, range(6), range(6)] += damping[:, None]
    multiplier = np.linalg.solve(square, error.T[..., None])[..., 0]
    return np.asarray(np.einsum("ikn,ni->kn", jacobian, multiplier))
