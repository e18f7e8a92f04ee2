"""Which pairs of a robot's own links need no collision check: sampled, for robots whose SRDF does not say."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pinocchio as pin

from ..transforms import Array

# Sampling covers the motion of so few joints densely; a pair with more joints between stays enabled.
_DENSELY_SAMPLED = 4
_AT_A_LIMIT = 0.25
# A pair with at most two joints between is also safe with less clearance than a grid of this pitch can pass over.
_GRID = np.deg2rad(1.5)
_GRID_CLEARANCE = 5e-3
_TOUCH = 1e-5  # m; at zero GJK may stop early and miss a collision


def disabled_collisions(
    model: pin.Model, geometry: pin.GeometryModel, *, samples: int = 20_000, seed: int = 0, clearance: float = 0.02
) -> list[tuple[str, str, str]]:
    """Pairs of links that are joined, touch in every state, or never come near each other.

    Joined are links with nothing but joints between them, or rigidly connected ones ("Adjacent"). The others are
    tested in random states, a quarter of whose joints stand at a limit, where reach ends: "Always" touched in every
    one, "Never" kept ``clearance`` in every one. Of pairs with at most two joints between, those that kept 5 mm are
    tested on a fine grid of these joints too, and are "Never" if they keep it there. Every other pair, and every pair
    with more than four joints between, stays enabled.

    Args:
        model: The robot.
        geometry: Its collision shapes, meshes rather than their hulls; is not changed.
        samples: Number of random states.
        seed: Seed of the states.
        clearance: Distance [m] that a pair must keep to count as never touching.

    Returns:
        (link, link, reason) in the order of the links, reason being "Adjacent", "Always" or "Never".
    """
    shapes: dict[int, list[int]] = {}
    for index, item in enumerate(geometry.geometryObjects):
        shapes.setdefault(_link_of(model, item.parentFrame), []).append(index)
    links = sorted(shapes)

    reasons: dict[tuple[int, int], str] = {}
    sampled: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for first, second in combinations(links, 2):
        between = len(_between(model, first, second))
        joined = _nearest_ancestor(model, second, shapes) == first or _nearest_ancestor(model, first, shapes) == second
        if joined or not between:
            reasons[first, second] = "Adjacent"
        elif between <= _DENSELY_SAMPLED:
            sampled[first, second] = list(product(shapes[first], shapes[second]))
    states = _states(model, samples, seed)
    reasons.update(_sampled(model, geometry, sampled, states, clearance))
    near = {pair: sampled[pair] for pair in sampled if pair not in reasons and len(_between(model, *pair)) <= 2}
    for pair in _sampled(model, geometry, near, states[: samples // 10], _GRID_CLEARANCE):
        grid = _grid(model, _between(model, *pair))
        reasons.update(_sampled(model, geometry, {pair: near[pair]}, grid, _GRID_CLEARANCE))
    name = [frame.name for frame in model.frames]
    return [(name[a], name[b], reasons[a, b]) for a, b in sorted(reasons)]


def _states(model: pin.Model, samples: int, seed: int) -> Array:
    """Random configurations (samples, nq) within the limits; joints without limits turn once."""
    rng = np.random.default_rng(seed)
    low, high = np.full(model.nv, -np.pi), np.full(model.nv, np.pi)
    for joint in model.joints[1:]:
        if joint.nq == joint.nv:
            v, q = slice(joint.idx_v, joint.idx_v + joint.nv), slice(joint.idx_q, joint.idx_q + joint.nq)
            low[v] = np.maximum(low[v], model.lowerPositionLimit[q])
            high[v] = np.minimum(high[v], model.upperPositionLimit[q])
    shape = (samples, model.nv)
    steps = rng.uniform(low, high, shape)
    at_limit = rng.random(shape) < _AT_A_LIMIT
    steps[at_limit] = np.where(rng.random(shape) < 0.5, low, high)[at_limit]
    neutral = pin.neutral(model)
    return np.array([pin.integrate(model, neutral, step) for step in steps])


def _sampled(
    model: pin.Model,
    geometry: pin.GeometryModel,
    pairs: dict[tuple[int, int], list[tuple[int, int]]],
    states: Array,
    clearance: float,
) -> dict[tuple[int, int], str]:
    """The pairs that touch in every state ("Always") or keep the clearance in every state ("Never")."""
    geometry = pin.GeometryModel(geometry)
    geometry.removeAllCollisionPairs()
    indices: dict[tuple[int, int], range] = {}
    for pair, shapes in pairs.items():
        start = len(geometry.collisionPairs)
        for i, j in shapes:
            geometry.addCollisionPair(pin.CollisionPair(i, j))
        indices[pair] = range(start, start + len(shapes))
    data, geometry_data = model.createData(), pin.GeometryData(geometry)

    def within(pair: tuple[int, int], margin: float) -> bool:
        for index in indices[pair]:
            geometry_data.collisionRequests[index].security_margin = margin
        return any(pin.computeCollision(geometry, geometry_data, index) for index in indices[pair])

    always, never = set(pairs), set(pairs)
    for q in states:
        pin.updateGeometryPlacements(model, data, geometry, geometry_data, q)
        always -= {pair for pair in sorted(always) if not within(pair, _TOUCH)}
        never -= {pair for pair in sorted(never) if within(pair, clearance)}
    return dict.fromkeys(sorted(always), "Always") | dict.fromkeys(sorted(never), "Never")


def _link_of(model: pin.Model, frame: int) -> int:
    """The link (a BODY frame) that ``frame`` is or hangs on."""
    while frame and model.frames[frame].type != pin.FrameType.BODY:
        frame = model.frames[frame].parentFrame
    return int(frame)


def _nearest_ancestor(model: pin.Model, link: int, shapes: dict[int, list[int]]) -> int | None:
    """The next link towards the root that has shapes."""
    while link:
        link = _link_of(model, model.frames[link].parentFrame)
        if link in shapes:
            return link
    return None


def _between(model: pin.Model, first: int, second: int) -> list[int]:
    """The moving joints on the way from one link to the other."""
    a, b = (set(model.supports[model.frames[link].parentJoint]) for link in (first, second))
    return sorted(a ^ b)


def _grid(model: pin.Model, joints: list[int]) -> Array:
    """Configurations (n, nq) on a grid of ``joints``, ends included, the others neutral."""
    axes = []
    for joint in joints:
        at = model.joints[joint].idx_q
        low, high = model.lowerPositionLimit[at], model.upperPositionLimit[at]
        axes.append(np.linspace(low, high, int(np.ceil((high - low) / _GRID)) + 1))
    values = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(joints))
    grid = np.tile(pin.neutral(model), (len(values), 1))
    grid[:, [model.joints[joint].idx_q for joint in joints]] = values
    return grid
