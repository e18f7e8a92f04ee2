"""A second look at whole motions: every step of a regrasp by the reference, five times finer than it was planned.

Pairs in nominal contact are excused only where they are apart once moved by the contact tolerance along the contact's
normal; which pairs may be in contact is told here by what the steps take, hold and put down.
"""

from __future__ import annotations

from collections.abc import Sequence

import fcl
import numpy as np
import pinocchio as pin
from reference import Reference

from kumitate.regrasp.steps import Step
from kumitate.robots.scene import Scene
from kumitate.robots.state import Contact, SceneState
from kumitate.transforms import Array, invert, pose_distance, transform_points

FREE_STEP, LINE_STEP = 1e-3, 0.2e-3  # m between two looks: a fifth of the planner's
STRAIGHT = {"approach", "retreat", "lift", "lower", "insert", "press", "withdraw"}
_SAME = 1e-9


class Witness(Reference):
    """A reference that looks at many configurations at once."""

    def along(self, state: SceneState, q: Array) -> Array:
        """Poses (n, bodies, 4, 4) of all bodies at configurations ``q`` (n, nq)."""
        joints = np.zeros((len(q), self.model.njoints, 4, 4))
        for i, configuration in enumerate(q):
            pin.forwardKinematics(self.model, self.data, configuration)
            joints[i] = [placement.homogeneous for placement in self.data.oMi]
        frames = [self.model.frames[self.model.getFrameId(f"{arm}_flange")] for arm in self.scene.robot.arms]
        first = {arm: len(self._links) + i for arm, i in self._first_piece().items()}
        poses = np.tile(self.poses(state, q[0]), (len(q), 1, 1, 1))
        poses[:, : len(self._links)] = joints[:, self._links]
        for arm, frame in zip(self.scene.robot.arms, frames, strict=True):
            flange = joints[:, frame.parentJoint] @ frame.placement.homogeneous
            moved = flange @ np.linalg.inv(flange[0])
            if arm in first:
                pieces = slice(first[arm], first[arm] + len(self.hands[arm][1]))
                poses[:, pieces] = moved[:, None] @ poses[0, pieces]
            for body in self.scene.bodies:
                if state.carrier(body)[0] == arm:
                    poses[:, self.names.index(body)] = moved @ poses[0, self.names.index(body)]
        return poses

    def crossing(self, poses: Array, contacts: Sequence[Contact]) -> set[tuple[str, str]]:
        """Pairs whose surfaces cross at any of ``poses`` (n, bodies, 4, 4), and deeper than a contact may."""
        points = transform_points(poses, self._corners)
        low, high = points.min(axis=2), points.max(axis=2)
        first, second = self.pairs.T
        near = ((low[:, first] <= high[:, second]) & (low[:, second] <= high[:, first])).all(axis=2)
        allowed = {frozenset((contact.first, contact.second)): contact for contact in contacts}
        found: set[tuple[str, str]] = set()
        for k in np.flatnonzero(near.any(axis=0)):
            i, j = self.pairs[k]
            contact = allowed.get(frozenset((self.names[i], self.names[j])))
            between = invert(poses[near[:, k], i]) @ poses[near[:, k], j]
            moved = np.abs(np.diff(between, axis=0)).max(axis=(1, 2), initial=0.0) > _SAME
            between = between[np.append(True, moved)]  # one look is enough at what does not move
            if any(self._deep(i, j, pose, contact) for pose in between[self._boxes_meet(i, j, between)]):
                found.add((self.names[i], self.names[j]))
        return found

    def _boxes_meet(self, i: int, j: int, between: Array) -> Array:
        """Whether (n,) boxes around two bodies meet, told along the axes of either; ``between`` are poses (n, 4, 4)."""
        meet = np.ones(len(between), dtype=bool)
        for mine, theirs, at in ((i, j, between), (j, i, invert(between))):
            points, own = transform_points(at, self._corners[theirs]), self._corners[mine]
            meet &= (points.min(axis=1) <= own.max(axis=0)).all(axis=1)
            meet &= (points.max(axis=1) >= own.min(axis=0)).all(axis=1)
        return meet

    def _deep(self, i: int, j: int, between: Array, contact: Contact | None) -> bool:
        """Whether two surfaces cross, in contact even once the second has moved off by the tolerance."""
        if not self._cross(i, j, between):
            return False
        if contact is None:
            return True
        moved, way = between.copy(), self.scene.contact_tolerance * contact.normal
        moved[:3, 3] += way if contact.first == self.names[i] else -between[:3, :3] @ way
        return self._cross(i, j, moved)

    def _cross(self, i: int, j: int, between: Array) -> bool:
        objects = self._objects[i], self._objects[j]
        objects[0].setTransform(fcl.Transform())
        objects[1].setTransform(fcl.Transform(between[:3, :3], between[:3, 3]))
        return bool(fcl.collide(*objects, fcl.CollisionRequest(), fcl.CollisionResult()))

    def _first_piece(self) -> dict[str, int]:
        counts = np.cumsum([0, *(len(pieces) for _, pieces in self.hands.values())])
        return dict(zip(self.hands, counts.tolist(), strict=False))


def faults(scene: Scene, start: SceneState, steps: Sequence[Step], part: str, witness: Witness) -> list[str]:
    """What is wrong with ``steps`` of ``part`` from ``start``: jumps, contacts that nothing explains, collisions."""
    found: list[str] = []
    state = start
    for number, step in enumerate(steps):
        name = f"step {number}, {step.kind} by {'/'.join(step.arms)}"
        found += [f"{name}: {problem}" for problem in _jumps(scene, state, step)]
        pairs = {(c.first, c.second) for c in step.start.contacts}
        found += [f"{name}: contact {pair}" for pair in pairs - _explained(scene, step, part)]
        found += [f"{name}: {a} / {b} cross" for a, b in sorted(_crossing(scene, step, witness))]
        state = step.end
    return found


def looks(scene: Scene, step: Step, witness: Witness) -> Array:
    """Poses (n, bodies, 4, 4) along ``step``, near enough to each other that no corner moves farther than a look."""
    state = step.start
    for event in step.events:
        if not event.at_end and event.part in state.attached and state.attached[event.part].carrier == event.carrier:
            state = scene.detach(state, event.part)
    if step.openings:
        ((arm, (opening, wanted)),) = step.openings.items()
        return _refined(
            lambda shares: np.array(
                [
                    witness.poses(state.with_opening(arm, opening + share * (wanted - opening)), state.q)
                    for share in shares
                ]
            ),
            witness,
            LINE_STEP,
        )
    duration, longest = step.trajectory.duration, LINE_STEP if step.kind in STRAIGHT else FREE_STEP
    return _refined(lambda shares: witness.along(state, step.trajectory.sample(duration * shares)), witness, longest)


def _refined(poses_at, witness: Witness, longest: float) -> Array:
    shares = np.linspace(0.0, 1.0, 51)
    poses = poses_at(shares)
    while True:
        corners = transform_points(poses, witness._corners).reshape(len(shares), -1, 3)
        way = np.linalg.norm(np.diff(corners, axis=0), axis=-1).max(axis=1)
        if (way <= longest).all():
            return poses
        parts = np.ceil(1.05 * way / longest).astype(int).clip(1)
        between = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(shares, shares[1:], parts, strict=False)]
        shares = np.append(np.concatenate(between), 1.0)
        poses = poses_at(shares)


def _crossing(scene: Scene, step: Step, witness: Witness) -> set[tuple[str, str]]:
    return witness.crossing(looks(scene, step, witness), step.start.contacts)


def _explained(scene: Scene, step: Step, part: str) -> set[tuple[str, str]]:
    """Contacts of ``part`` that there may be: with pads that hold, take or let it go; with the support it stands on."""
    holding = {e.carrier for e in step.events} | {
        state.attached[part].carrier for state in (step.start, step.end) if part in state.attached
    }
    fingers = {
        (part, f"{arm}/{piece.name}")
        for arm in holding
        for piece in scene.robot.hands[arm].pieces
        if any(pad.joint == piece.joint for pad in scene.robot.hands[arm].pads) or not scene.robot.hands[arm].pads
    }
    level = {
        (body, part)
        for body in scene.bodies
        for state in (step.start, step.end)
        if body != part and _rests(scene, state, body, part)
    }
    return fingers | level


def _rests(scene: Scene, state: SceneState, body: str, part: str) -> bool:
    """Whether the lowest point of ``part`` is as high as the top of ``body``, within the contact tolerance."""
    lowest, highest = (
        transform_points(scene.world_from_body(state, name), scene.bodies[name].mesh.vertices)[:, 2]
        for name in (part, body)
    )
    return bool(abs(lowest.min() - highest.max()) < scene.contact_tolerance)


def _jumps(scene: Scene, before: SceneState, step: Step) -> list[str]:
    """What differs between the end of the step before and the start of this one, and the ends of its motion."""
    found, motion = [], step.trajectory
    if not np.array_equal(before.q, step.start.q) or dict(before.openings) != dict(step.start.openings):
        found.append("joints or openings jump")
    if np.abs(motion.positions[[0, -1]] - [step.start.q, step.end.q]).max() > _SAME:
        found.append("the motion has other ends")
    if np.abs(motion.velocities[[0, -1]]).max() > 0.0:
        found.append("the motion does not begin and end at rest")
    if (motion.peak_velocity() > scene.robot.velocity * 1.001).any():
        found.append("too fast")
    if (motion.peak_acceleration() > scene.robot.acceleration * 1.001).any():
        found.append("too strong")
    moving = np.ones(len(step.start.q), dtype=bool)
    moving[scene.robot.indices(step.arms)] = False
    if np.abs(np.ptp(motion.positions, axis=0)[moving]).max(initial=0.0) > 0.0:
        found.append("an arm moves that is not named")
    for body in scene.bodies:
        for a, b in ((before, step.start), (step.start, step.end)):
            held = any(state.carrier(body)[0] in step.arms and not step.openings for state in (a, b))
            distance, angle = pose_distance(scene.world_from_body(a, body), scene.world_from_body(b, body))
            if (distance > _SAME or angle > _SAME) and not (held and a is step.start):
                found.append(f"{body} jumps")
    return found
