"""Collision checks of a scene: convex pieces in a broadphase first, exact shapes where they touch.

A pair of bodies whose relative pose no joint can change (a part and the hand that holds it, a part and the table it
lies on) is decided once for each state; all other pairs are decided for each configuration. No pair is switched off: a
pair in contact is excused only if it is apart after a step of the contact tolerance along the contact's normal.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import NamedTuple

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from ..errors import UnknownNameError
from ..transforms import Array, invert, transform_points
from .rigid import BREAK_DISTANCE, Nest, Rigid
from .robot import Robot
from .shapes import Piece
from .state import Body, Margins, SceneState

Pair = tuple[str, str]

# Asked for yes or no without any distance to keep, GJK stops early where rounding tells it that shapes are apart: it
# misses one collision in some thousands, however deep. With this distance [m], ten times its tolerance, it misses none.
_LEAST_MARGIN = 1e-5
_OPPOSED = 0.5  # normals of contacts between which there is no way out


@dataclass(frozen=True, eq=False)
class _Mode:
    """One state as the engine sees it.

    ``joints`` (bodies,) and ``poses`` (bodies, 4, 4) tell the joint that carries each body and the body's pose in its
    frame. Over body pairs: ``moving`` where a joint can change the relative pose, ``margins`` the distance to keep [m],
    and for pairs that touch on purpose ``normals``: directions of the pair's second body out of the contacts, each with
    the body in whose frame it is told. ``clearance`` is what the margins hold beyond the scene's own [m].
    """

    joints: npt.NDArray[np.intp]
    poses: Array
    moving: npt.NDArray[np.bool_]
    margins: Array
    normals: dict[int, list[tuple[int, Array]]]
    clearance: float = 0.0


class _Lane:
    """What pinocchio keeps to check one mode after the other: active pairs and margins, alike but for some pairs.

    Modes of different clearance differ in nearly all margins, and to set those takes longer than many checks.
    """

    def __init__(self, model: pin.Model, geometry: pin.GeometryModel, exact: pin.GeometryModel) -> None:
        self.geometry, self.exact = pin.GeometryData(geometry), pin.GeometryData(exact)
        self.manager = pin.BroadPhaseManager_NaiveCollisionManager(model, geometry, self.geometry)
        self.callback = pin.CollisionCallBackDefault(geometry, self.geometry, True)
        self.mode: _Mode | None = None


class _Part(NamedTuple):
    """A piece of a body, the number of its object, and those of its exact shapes in the exact geometry."""

    piece: Piece
    number: int
    exact: list[int]


@dataclass(frozen=True, eq=False)
class _Meeting:
    """Two pieces of a pair of bodies: what decides whether the bodies touch there if the pieces do.

    ``exact`` are pairs of exact shapes, none where the pieces are the bodies themselves; ``nests`` are ways in which
    one body may lie inside the other, each with the numbers of the outer and the inner object.
    """

    pair: int
    exact: list[int]
    nests: list[tuple[Nest, int, int]]


class StateChecker:
    """Decides which configurations are free of collision, everything but the joints being as in one state.

    Attributes:
        state: The state; of its configuration only the place of bodies that nothing carries is taken.
        static: Touching pairs that no joint can part; while there are any, no configuration is free.
    """

    def __init__(self, engine: CollisionEngine, state: SceneState, working: Collection[str]) -> None:
        self._engine = engine
        self._mode = engine.mode(state, working)
        self.state = state
        self.static: tuple[Pair, ...] = engine.static(self._mode)

    def with_clearance(self, clearance: float) -> StateChecker:
        """This checker, asking for ``clearance`` [m] more between bodies that joints move, but none in contact."""
        wider = copy(self)
        wider._mode = self._engine.widened(self._mode, clearance)
        return wider

    def free(self, q: Array) -> bool:
        """Whether nothing touches at configuration ``q`` (nq,)."""
        return not (self.static or self._engine.touching(self._mode, q, first_only=True))

    def first_touching(self, q: Array) -> Pair | None:
        """A touching pair at configuration ``q`` (nq,), or None where it is free."""
        found = self.static or self._engine.touching(self._mode, q, first_only=True)
        return found[0] if found else None

    def touching(self, q: Array) -> tuple[Pair, ...]:
        """Names of all touching pairs at configuration ``q`` (nq,)."""
        return self.static + self._engine.touching(self._mode, q, first_only=False)


class CollisionEngine:
    """Owns the geometry of a scene; the checkers of all its states share it and take turns."""

    def __init__(self, robot: Robot, bodies: Mapping[str, Body], margins: Margins, contact_tolerance: float) -> None:
        self._robot = robot
        self._bodies = bodies
        self._asked = margins
        self._tolerance = contact_tolerance
        self._model = robot.model
        pieces = [(f"{arm}/{piece.name}", arm, piece) for arm, hand in robot.hands.items() for piece in hand.pieces]
        named: list[tuple[str, str, Rigid]] = [
            (link.name, _arm_moved_by(robot, link.joint), link) for link in robot.links
        ]
        named += pieces + [(body.name, "", body) for body in bodies.values()]
        self._names, self._arms, self._rigids = zip(*named, strict=True)
        self._index = {name: i for i, name in enumerate(self._names)}
        self._first_body = len(named) - len(bodies)
        self._is_hand = [len(robot.links) <= i < self._first_body for i in range(len(named))]
        self._balls = np.array([rigid.ball for rigid in self._rigids])
        self._pairs = self._body_pairs()
        self._pair_array = np.array(self._pairs, dtype=np.intp).reshape(-1, 2)
        self._pair_index = {pair: i for i, pair in enumerate(self._pairs)}
        self._build_geometry()
        self._current: _Mode | None = None

    def checker(self, state: SceneState, working: Collection[str] = ()) -> StateChecker:
        """The checker of ``state``; the hands of the arms in ``working`` need keep no margins."""
        return StateChecker(self, state, working)

    # Construction -----------------------------------------------------------------------------------------------------

    def _body_pairs(self) -> list[tuple[int, int]]:
        """All pairs of bodies but those that are rigid by construction and those that the robot's SRDF disables."""
        robot, bodies = self._robot, self._bodies
        links = {link.name: link for link in robot.links}
        flanges = {arm: robot.arms[arm].flange_joint for arm in robot.hands}
        fixed = {name for name, body in bodies.items() if body.fixed}
        fixed |= {link.name for link in robot.links if link.joint == 0}

        def checked(a: str, b: str) -> bool:
            if a in fixed and b in fixed:
                return False
            if a in links and b in links:
                return links[a].joint != links[b].joint and frozenset((a, b)) not in robot.disabled
            arm = b.partition("/")[0]
            if b in bodies or arm not in flanges:
                return True
            return links[a].joint != flanges[arm] if a in links else a.partition("/")[0] != arm

        numbered = itertools.combinations(range(len(self._names)), 2)
        return [(a, b) for a, b in numbered if checked(self._names[a], self._names[b])]

    def _build_geometry(self) -> None:
        """Two pinocchio geometries: convex pieces, paired over all body pairs, and the exact shapes they stand for."""
        self._geometry, self._exact = pin.GeometryModel(), pin.GeometryModel()
        self._placed: list[list[tuple[pin.GeometryModel, int, Array]]] = [[] for _ in self._names]
        parts = [[self._add_piece(body, piece) for piece in rigid.cover] for body, rigid in enumerate(self._rigids)]
        self._members: list[list[int]] = []
        self._meetings: list[_Meeting] = []
        for pair, (a, b) in enumerate(self._pairs):
            start = len(self._meetings)
            for first, second in itertools.product(parts[a], parts[b]):
                self._geometry.addCollisionPair(pin.CollisionPair(first.number, second.number))
                nests = [*self._nests(a, first, b, second), *self._nests(b, second, a, first)]
                self._meetings.append(_Meeting(pair, self._exact_pairs(first, second), nests))
            self._members.append(list(range(start, len(self._meetings))))
        self._data = self._model.createData()
        self._lanes: dict[float, _Lane] = {}
        self._opened: dict[tuple[str, float], Array] = {}
        self._settled: dict[tuple[object, ...], bool] = {}

    def _add_piece(self, body: int, piece: Piece) -> _Part:
        number = self._add(self._geometry, body, piece.geometry, piece.placement)
        shapes = piece.exact or ((piece.geometry, piece.placement),)
        return _Part(piece, number, [self._add(self._exact, body, *shape) for shape in shapes])

    def _add(self, model: pin.GeometryModel, body: int, geometry: coal.CollisionGeometry, placement: Array) -> int:
        name = f"{self._names[body]}:{model.ngeoms}"
        number: int = model.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3.Identity(), geometry))
        self._placed[body].append((model, number, placement))
        return number

    def _exact_pairs(self, first: _Part, second: _Part) -> list[int]:
        start = len(self._exact.collisionPairs)
        if first.piece.exact or second.piece.exact:
            for numbers in itertools.product(first.exact, second.exact):
                self._exact.addCollisionPair(pin.CollisionPair(*numbers))
        return list(range(start, len(self._exact.collisionPairs)))

    def _nests(self, outer: int, around: _Part, inner: int, part: _Part) -> list[tuple[Nest, int, int]]:
        nest = Nest.between(self._rigids[outer], around.piece, self._rigids[inner], part.piece)
        return [(nest, around.number, part.number)] if nest else []

    # States -----------------------------------------------------------------------------------------------------------

    def mode(self, state: SceneState, working: Collection[str]) -> _Mode:
        """Where ``state`` hangs every body, and what it asks of every pair."""
        robot = self._robot
        joints = np.zeros(len(self._names), dtype=np.intp)
        poses = np.tile(np.eye(4), (len(self._names), 1, 1))
        joints[: len(robot.links)] = [link.joint for link in robot.links]
        at = len(robot.links)
        for name, hand in robot.hands.items():
            arm, count = robot.arms[name], len(hand.pieces)
            base = arm.joint_from_flange @ arm.flange_from_base
            joints[at : at + count] = arm.flange_joint
            poses[at : at + count] = base @ self._base_from_piece(name, state.openings[name])
            at += count
        for name in self._bodies:
            body = self._index[name]
            carrier, poses[body] = state.carrier(name)
            if carrier:
                joints[body] = robot.arms[carrier].flange_joint
                poses[body] = robot.arms[carrier].joint_from_flange @ poses[body]
        first, second = self._pair_array.T
        normals = self._normals(state)
        return _Mode(joints, poses, joints[first] != joints[second], self._margins(state, normals, working), normals)

    def widened(self, mode: _Mode, clearance: float) -> _Mode:
        """``mode`` with ``clearance`` [m] more to keep for pairs that joints move and that are in no contact."""
        wider = mode.margins + np.where(mode.moving, clearance, 0.0)
        wider[list(mode.normals)] = mode.margins[list(mode.normals)]
        return replace(mode, margins=wider, clearance=mode.clearance + clearance)

    def static(self, mode: _Mode) -> tuple[Pair, ...]:
        """Touching pairs among those that no joint can part."""
        held = np.flatnonzero(~mode.moving)
        centres = transform_points(mode.poses, self._balls[:, None, :3])[:, 0]
        first, second = self._pair_array[held].T
        apart = np.linalg.norm(centres[first] - centres[second], axis=1)
        near = held[apart <= self._balls[first, 3] + self._balls[second, 3] + mode.margins[held]]
        return tuple(self._named(pair) for pair in near if self._touch_still(mode, int(pair)))

    def touching(self, mode: _Mode, q: Array, first_only: bool) -> tuple[Pair, ...]:
        """Touching pairs at ``q`` among those that joints move; at most one of them if ``first_only``."""
        lane = self._enter(mode)
        if not pin.computeCollisions(self._model, self._data, lane.manager, lane.callback, q):
            return ()
        found: list[Pair] = []
        silenced: list[int] = []
        try:
            while lane.callback.collision:
                member = lane.callback.collisionPairIndex
                touches, settled = self._decide(mode, lane, member)
                if touches:
                    found.append(self._named(self._meetings[member].pair))
                    if first_only:
                        break
                for other in settled:
                    lane.geometry.deactivateCollisionPair(other)
                silenced += settled
                pin.computeCollisions(lane.manager, lane.callback)
        finally:
            for member in silenced:
                lane.geometry.activateCollisionPair(member)
        return tuple(found)

    def _base_from_piece(self, arm: str, opening: float) -> Array:
        """Poses (pieces, 4, 4) of the pieces of a hand, remembered: one opening comes back in most states."""
        if (arm, opening) not in self._opened:
            self._opened[arm, opening] = self._robot.hands[arm].base_from_piece(opening)[0]
        return self._opened[arm, opening]

    def _touch_still(self, mode: _Mode, pair: int) -> bool:
        """Whether two bodies that no joint can part touch, remembered: most of them stand alike in many states."""
        a, b = self._pairs[pair]
        normals = b"".join((mode.poses[body] @ np.append(n, 0.0)).tobytes() for body, n in mode.normals.get(pair, ()))
        key = (pair, mode.poses[a].tobytes(), mode.poses[b].tobytes(), float(mode.margins[pair]), normals)
        if key not in self._settled:
            self._settled[key] = self._touch(mode, pair, np.eye(4), np.eye(4))
        return self._settled[key]

    # Modes ------------------------------------------------------------------------------------------------------------

    def _normals(self, state: SceneState) -> dict[int, list[tuple[int, Array]]]:
        """For pairs in contact, the directions of the pair's second body out of it: each in the frame of a body."""
        normals: dict[int, list[tuple[int, Array]]] = {}
        for contact in state.contacts:
            for name in (contact.first, contact.second):
                if name not in self._index:
                    raise UnknownNameError("contact", "body", name, self._names)
            first, second = self._index[contact.first], self._index[contact.second]
            pair = self._pair_index.get((min(first, second), max(first, second)))
            if pair is not None:
                normals.setdefault(pair, []).append((first, contact.normal if first < second else -contact.normal))
        return normals

    def _margins(self, state: SceneState, in_contact: Collection[int], working: Collection[str]) -> Array:
        """The distance to keep for each pair; none in contact, none for hands at work."""
        asked = self._asked
        margins = np.zeros(len(self._pairs))
        if not asked.arms and not asked.environment:
            return margins
        for pair, (a, b) in enumerate(self._pairs):
            at_work = any(self._is_hand[i] and self._arms[i] in working for i in (a, b))
            if pair in in_contact or at_work or a >= self._first_body:
                continue
            if b >= self._first_body:
                carried = state.carrier(self._names[b])[0] == self._arms[a] != ""
                margins[pair] = 0.0 if carried else asked.environment
            elif self._arms[a] and self._arms[b] and self._arms[a] != self._arms[b]:
                margins[pair] = asked.arms
        return margins

    def _enter(self, mode: _Mode) -> _Lane:
        """The lane of ``mode``, with placements, active pairs and margins changed in place where they differ."""
        if mode.clearance not in self._lanes:
            self._lanes[mode.clearance] = _Lane(self._model, self._geometry, self._exact)
        lane = self._lanes[mode.clearance]
        if self._current is not mode:
            self._place(mode)
        if lane.mode is not mode:
            self._set_pairs(lane, mode)
        return lane

    def _place(self, mode: _Mode) -> None:
        """Put all bodies where ``mode`` has them."""
        old, self._current = self._current, mode
        changed = np.ones(len(self._names), dtype=bool)
        if old is not None:
            changed = (mode.joints != old.joints) | (mode.poses != old.poses).any(axis=(1, 2))
        for body in np.flatnonzero(changed):
            for model, number, placement in self._placed[body]:
                model.geometryObjects[number].parentJoint = int(mode.joints[body])
                model.geometryObjects[number].placement = pin.SE3(mode.poses[body] @ placement)

    def _set_pairs(self, lane: _Lane, mode: _Mode) -> None:
        """Make ``lane`` check the pairs that move in ``mode``, with its margins."""
        old, lane.mode = lane.mode, mode
        flipped = remargined = np.ones(len(self._pairs), dtype=bool)
        if old is not None:
            flipped, remargined = mode.moving != old.moving, mode.margins != old.margins
        turn_on, turn_off = lane.geometry.activateCollisionPair, lane.geometry.deactivateCollisionPair
        for pair in np.flatnonzero(flipped):
            change = turn_on if mode.moving[pair] else turn_off
            for piece_pair in self._members[pair]:
                change(piece_pair)
        for pair in np.flatnonzero(remargined):
            margin = max(float(mode.margins[pair]), _LEAST_MARGIN)
            for member in self._members[pair]:
                lane.geometry.collisionRequests[member].security_margin = margin
                for exact in self._meetings[member].exact:
                    lane.exact.collisionRequests[exact].security_margin = margin
                    lane.exact.collisionRequests[exact].break_distance = BREAK_DISTANCE
        lane.manager.update(True)

    # Exact checks -----------------------------------------------------------------------------------------------------

    def _named(self, pair: int) -> Pair:
        a, b = self._pairs[pair]
        return self._names[a], self._names[b]

    def _decide(self, mode: _Mode, lane: _Lane, member: int) -> tuple[bool, list[int]]:
        """Whether bodies of which two pieces touch do so themselves, and the pairs of pieces that this settles."""
        meeting = self._meetings[member]
        whole = self._members[meeting.pair]
        if meeting.pair in mode.normals:
            frames = [self._data.oMi[int(mode.joints[i])].homogeneous for i in self._pairs[meeting.pair]]
            return self._touch(mode, meeting.pair, *frames), whole
        if not meeting.exact:
            return True, whole
        pin.updateGeometryPlacements(self._model, self._data, self._exact, lane.exact)
        if any(pin.computeCollision(self._exact, lane.exact, i) for i in meeting.exact):
            return True, whole
        poses = lane.geometry.oMg
        if any(nest.holds(poses[outer].actInv(poses[inner]).homogeneous) for nest, outer, inner in meeting.nests):
            return True, whole
        return False, [member]

    def _touch(self, mode: _Mode, pair: int, frame_a: Array, frame_b: Array) -> bool:
        """Whether two bodies, their joints' frames at ``frame_a`` and ``frame_b``, touch more than contacts excuse."""
        a, b = self._pairs[pair]
        pose_a, pose_b = frame_a @ mode.poses[a], frame_b @ mode.poses[b]
        bodies, margin = (self._rigids[a], self._rigids[b]), float(mode.margins[pair])
        contacts = mode.normals.get(pair)
        if contacts:
            normals = np.array([(pose_a if body == a else pose_b)[:3, :3] @ normal for body, normal in contacts])
            moved_b = pose_b.copy()
            moved_b[:3, 3] += self._tolerance * np.linalg.pinv(normals, rcond=_OPPOSED).sum(axis=1)
            if not bodies[0].touches(bodies[1], invert(pose_a) @ moved_b, margin):
                return False
        return bool(bodies[0].touches(bodies[1], invert(pose_a) @ pose_b, margin))


def _arm_moved_by(robot: Robot, joint: int) -> str:
    """The arm that has ``joint`` among its own; empty for torso and base."""
    model = robot.model
    owners = (
        (name for name, arm in robot.arms.items() if model.joints[joint].idx_q in arm.indices) if joint else iter(())
    )
    return next(owners, "")
