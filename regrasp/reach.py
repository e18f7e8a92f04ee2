"""Which grasps of an arm work at a pose of the part: the hand, inverse kinematics, the straight ways, the robot."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from ..errors import InputError
from ..grasping.grasps import GraspSet
from ..robots.arm import Arm
from ..robots.ik import IKSolutions, track
from ..robots.robot import Robot
from ..robots.scene import Scene
from ..robots.state import Contact, SceneState
from ..transforms import Array, compose, invert
from .clearance import Hands, Mask
from .rest import at_rest, rest_contacts

APPROACH = 0.05  # m that a hand comes straight to the part, and leaves it
LIFT = 0.05  # m that a part goes straight up from its support, and comes down to it
_LINE_POSES = 6
ROOM = 1e-3  # m between a hand and what stands around
_SAME = 1e-6  # rad or m; joints of one branch are found anew within this
_UP = np.array([0.0, 0.0, 1.0])

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Holder:
    """An arm and the grasps of one part by its hand.

    Attributes:
        arm: The arm.
        grasps: The n grasps.
        part_from_flange: (n, 4, 4) poses of the arm's flange where it grasps, in the part's frame.
    """

    arm: Arm
    grasps: GraspSet
    part_from_flange: Array
    _hands: dict[tuple[bool, float], Hands] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, robot: Robot, arm: str, grasps: GraspSet) -> Holder:
        """``grasps`` by the hand of ``arm``.

        Raises:
            InputError: There is no such arm, it has no hand, or the grasps are another hand's.
        """
        mounted = robot.arm(arm)
        if mounted.hand is None or mounted.hand.name != grasps.hand:
            name = mounted.hand.name if mounted.hand else "no hand"
            raise InputError(
                f"arm {arm}", f"has {name}, and the grasps are for {grasps.hand}", "plan them for its hand"
            )
        return cls(mounted, grasps, grasps.part_from_hand @ invert(mounted.flange_from_hand(grasps.opening)))

    def hands(self, *, closed: bool, back: float = 0.0) -> Hands:
        """The hands of all grasps in the part's frame, closed on it or open, ``back`` [m] along their approach."""
        if (closed, back) not in self._hands:
            hand = self.arm.hand
            assert hand is not None
            base = self.part_from_flange @ self.arm.flange_from_base
            base[:, :3, 3] -= back * self.grasps.part_from_hand[:, :3, 2]
            openings = self.grasps.opening if closed else self.grasps.approach_opening
            self._hands[closed, back] = Hands.of(hand, base, openings)
        return self._hands[closed, back]

    def row(self, grasp: int) -> GraspSet:
        """One grasp, as a set."""
        return self.grasps[np.array([grasp])]

    @property
    def gripping(self) -> list[int]:
        """Indices of the hand's pieces that carry a pad, or the lip."""
        hand = self.arm.hand
        assert hand is not None
        joints = {pad.joint for pad in hand.pads} or {hand.pieces[0].joint}
        return [i for i, piece in enumerate(hand.pieces) if piece.joint in joints]

    def pads(self, part: str, grasp: int) -> list[Contact]:
        """The contacts of the hand's pads (or lip) with ``part`` in a grasp; free again when the fingers open a bit."""
        hand = self.arm.hand
        assert hand is not None
        pose = self.grasps.part_from_hand[grasp]
        if not hand.pads:
            return [Contact(part, f"{self.arm.name}/{hand.pieces[0].name}", -pose[:3, 2])]
        pieces = {piece.joint: piece.name for piece in hand.pieces}
        sides = [-pose[:3, 0], *[pose[:3, 0]] * (len(hand.pads) - 1)]
        return [
            Contact(part, f"{self.arm.name}/{pieces[pad.joint]}", side)
            for pad, side in zip(hand.pads, sides, strict=True)
        ]

    def open_contacts(self, part: str, grasp: int) -> list[Contact]:
        """The contacts that the open hand has with ``part`` where it grasps: those of a lip, for fingers none."""
        hand = self.arm.hand
        assert hand is not None
        return [] if hand.pads else self.pads(part, grasp)


@dataclass(frozen=True, eq=False)
class Node:
    """A pose of the part: resting on a support, or held in the air.

    Attributes:
        name: What reports call it.
        world_from_part: (4, 4).
        support: The body it rests on; None in the air.
        to_leave: Whether hands come and go here; false where the part is held at the end.
        touching: Contacts that the part may have here, beside those with its support.
    """

    name: str
    world_from_part: Array
    support: str | None
    to_leave: bool = True
    touching: tuple[Contact, ...] = ()

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for nodes at which the same is asked of hands and arms, whatever their names."""
        touching = tuple((contact.first, contact.second, contact.normal.tobytes()) for contact in self.touching)
        return self.world_from_part.tobytes(), self.support, self.to_leave, touching


@dataclass(frozen=True, eq=False)
class Reach:
    """m ways of one arm to have the part at a node: a grasp and a branch of inverse kinematics each.

    Attributes:
        grasp: (m,) index of the grasp, ascending.
        at: (m, dof) joints of the arm where it holds the part there.
        before: (m, dof) where the open hand comes from, and goes to; as ``at`` for a node that is not left.
        above: (m, dof) where the hand holds the part above its support; as ``at`` in the air.
    """

    grasp: Rows
    at: Array
    before: Array
    above: Array

    def mask(self, n: int) -> Mask:
        """Which of ``n`` grasps are among these (n,)."""
        mask = np.zeros(n, dtype=bool)
        mask[self.grasp] = True
        return mask

    def take(self, chosen: Mask | Rows) -> Reach:
        """The chosen ways: a mask or indices."""
        return Reach(self.grasp[chosen], self.at[chosen], self.before[chosen], self.above[chosen])

    def joined(self, other: Reach) -> Reach:
        """These ways and the other's, by grasp."""
        grasp = np.concatenate([self.grasp, other.grasp])
        pairs = ((self.at, other.at), (self.before, other.before), (self.above, other.above))
        return Reach(grasp, *(np.concatenate(pair) for pair in pairs)).take(np.argsort(grasp, kind="stable"))


@dataclass(eq=False)
class _Tested:
    """What is known of one arm at one node."""

    name: str
    tested: Mask
    reach: Reach
    dropped: Counter[str] = field(default_factory=Counter)
    given_up: dict[int, list[Array]] = field(default_factory=dict)
    admitted: bool = False


class Reacher:
    """Finds, when asked, which grasps of a part work at a node; remembers the answers, and why the others do not.

    Tests run from the cheap to the dear, each on what the one before left: the hand at both openings against everything
    that stands around, inverse kinematics, the straight ways of hand and part, the whole robot.

    ``looked`` counts the grasps that were tested, at all nodes.

    Args:
        scene: The scene.
        state: Where everything else stands; arms that carry nothing else count as at home.
        part: Name of the part.
        holders: Its grasps by arm.
        watch: Called before each test; what it raises ends the search.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState,
        part: str,
        holders: Mapping[str, Holder],
        watch: Callable[[], None] = lambda: None,
    ) -> None:
        self.scene, self.part, self.holders, self.watch = scene, part, holders, watch
        self.state = at_rest(scene, state, part)
        self.looked = 0
        self._tested: dict[tuple[object, str], _Tested] = {}
        self._blocked: dict[object, str] = {}
        self._closing = {arm: np.full(len(holder.grasps), -1, dtype=np.int8) for arm, holder in holders.items()}

    def reach(self, node: Node, arm: str, wanted: Mask) -> Reach:
        """The ways of ``arm`` to have the part at ``node`` with the ``wanted`` grasps (n,)."""
        self.watch()
        holder = self.holders[arm]
        entry = self._tested.get((node.key, arm))
        if entry is None:
            entry = _Tested(node.name, np.zeros(len(holder.grasps), dtype=bool), self._nothing(arm))
            self._tested[node.key, arm] = entry
        (new,) = np.nonzero(wanted & ~entry.tested)
        if len(new):
            entry.tested[new] = True
            self.looked += len(new)
            entry.reach = entry.reach.joined(self._evaluate(node, holder, new, entry.dropped))
        return entry.reach.take(wanted[entry.reach.grasp])

    def admit(self, node: Node, arm: str, ways: Reach) -> None:
        """Take ``ways`` of ``arm`` to hold the part at ``node``, and no others, as far as the robot is free there."""
        holder, state = self.holders[arm], self.state_at(node)
        entry = _Tested(node.name, np.ones(len(holder.grasps), dtype=bool), self._nothing(arm), admitted=True)
        failed: dict[int, str] = {}
        if blocked := self._part_blocked(node, state):
            entry.dropped[blocked] += len(np.unique(ways.grasp))
        else:
            entry.reach = self._robot_free(node, holder, ways.take(np.argsort(ways.grasp)), state, failed)
        entry.dropped.update(failed[int(g)] for g in np.setdiff1d(ways.grasp, entry.reach.grasp) if int(g) in failed)
        self._tested[node.key, arm] = entry

    def give_up(self, node: Node, arm: str, grasp: int, at: Array) -> None:
        """Forget a way to have the part at ``node``, to or from which no motion was found; other branches replace it.

        Not where ways were admitted: there no others come.
        """
        entry, holder = self._tested[node.key, arm], self.holders[arm]
        known = entry.reach
        entry.reach = known.take((known.grasp != grasp) | (np.abs(known.at - at).max(axis=1) > _SAME))
        tried = entry.given_up.setdefault(grasp, [])
        tried.append(at)
        if not (entry.admitted or (entry.reach.grasp == grasp).any()):
            found = holder.arm.solver(node.world_from_part @ holder.part_from_flange[grasp])
            new = [i for i, q in enumerate(found.q) if all(np.abs(q - old).max() > _SAME for old in tried)]
            rows = _rows(np.array([grasp]), found, np.array(new, dtype=np.intp))
            entry.reach = entry.reach.joined(self._followed_and_free(node, holder, rows, self.state_at(node), {}))

    def hand_ways(self, node: Node, arm: str, wanted: Mask, dropped: Counter[str]) -> Reach:
        """The ways of ``arm`` to hold the part at ``node`` with the ``wanted`` grasps (n,), for hand and arm alone.

        Hands are clear and inverse kinematics answers; all branches. Causes of what falls are counted in ``dropped``.
        """
        self.watch()
        holder, state = self.holders[arm], self.state_at(node)
        (grasp,) = np.nonzero(wanted)
        if blocked := self._part_blocked(node, state):
            dropped[blocked] += len(grasp)
            return self._nothing(arm)
        grasp = self._hands_clear(node, holder, grasp, state, dropped)
        found = holder.arm.solver(node.world_from_part @ holder.part_from_flange[grasp])
        dropped["no inverse kinematics at the grasp"] += int((~found.solved).sum())
        return _rows(grasp, found, np.arange(len(found.q)))

    def dropped(self) -> dict[tuple[str, str], Counter[str]]:
        """For each node and arm that was asked for, how many grasps fell to each cause."""
        return {(entry.name, arm): entry.dropped for (_, arm), entry in self._tested.items()}

    def tested(self) -> dict[tuple[str, str], tuple[int, int]]:
        """For each node and arm that was asked for, how many grasps were tested, and how many work."""
        return {
            (entry.name, arm): (int(entry.tested.sum()), len(np.unique(entry.reach.grasp)))
            for (_, arm), entry in self._tested.items()
        }

    def state_at(self, node: Node) -> SceneState:
        """The state with the part at ``node``, held by nobody."""
        state = self.state.with_pose(self.part, node.world_from_part)
        if node.support is not None:
            state = state.with_contacts([*state.contacts, *rest_contacts(self.scene, state, node.support, self.part)])
        return state.with_contacts([*state.contacts, *node.touching]) if node.touching else state

    def _nothing(self, arm: str) -> Reach:
        none = np.zeros((0, self.holders[arm].arm.chain.dof))
        return Reach(np.zeros(0, dtype=np.intp), none, none, none)

    def _evaluate(self, node: Node, holder: Holder, grasp: Rows, dropped: Counter[str]) -> Reach:
        arm, nothing = holder.arm, self._nothing(holder.arm.name)
        state = self.state_at(node)
        blocked = self._part_blocked(node, state)
        if blocked:
            dropped[blocked] += len(grasp)
            return nothing
        grasp = self._hands_clear(node, holder, grasp, state, dropped)
        found = arm.solver(node.world_from_part @ holder.part_from_flange[grasp])
        dropped["no inverse kinematics at the grasp"] += int((~found.solved).sum())
        first, others = _nearest_first(found, self.scene.robot.home[arm.indices])
        # Branches near home make short ways; the others are looked at only where the nearest does not do.
        failed: dict[int, str] = {}
        reach = self._followed_and_free(node, holder, _rows(grasp, found, first), state, failed)
        others = others[~np.isin(grasp[found.target[others]], reach.grasp)]
        reach = reach.joined(self._followed_and_free(node, holder, _rows(grasp, found, others), state, failed))
        for lost in np.setdiff1d(grasp[found.solved], reach.grasp):
            dropped[failed[int(lost)]] += 1
        return reach

    def _followed_and_free(
        self, node: Node, holder: Holder, reach: Reach, state: SceneState, failed: dict[int, str]
    ) -> Reach:
        """The ways whose lines can be followed and on which the robot is free; why the others fail, by grasp."""
        arm, flanges = holder.arm, node.world_from_part @ holder.part_from_flange
        if node.to_leave:
            back = -self._approach(node, holder, reach.grasp) * APPROACH
            end, followed = followed_line(arm, reach.at, flanges[reach.grasp], back)
            failed.update(dict.fromkeys(reach.grasp[~followed].tolist(), "no inverse kinematics along the approach"))
            reach = replace(reach, before=end).take(followed)
        if node.support is not None:
            up = np.tile(LIFT * _UP, (len(reach.grasp), 1))
            end, followed = followed_line(arm, reach.at, flanges[reach.grasp], up)
            failed.update(dict.fromkeys(reach.grasp[~followed].tolist(), "no inverse kinematics along the lift"))
            reach = replace(reach, above=end).take(followed)
        return self._robot_free(node, holder, reach, state, failed)

    def _part_blocked(self, node: Node, state: SceneState) -> str:
        """What the part touches at ``node``, in words; empty if nothing."""
        if node.key not in self._blocked:
            touching = self.scene.checker(state).static
            self._blocked[node.key] = "part against " + " / ".join(touching[0]) if touching else ""
        return self._blocked[node.key]

    def _hands_clear(self, node: Node, holder: Holder, grasp: Rows, state: SceneState, dropped: Counter[str]) -> Rows:
        """The grasps whose hand touches nothing that stands around: closed, open, and open where it comes from."""
        part_from_world = invert(node.world_from_part)
        passes = [holder.hands(closed=True)]
        if node.to_leave:
            passes += [holder.hands(closed=False), holder.hands(closed=False, back=APPROACH)]
        for name, body in self.scene.bodies.items():
            if name != self.part:
                pose = part_from_world @ self.scene.world_from_body(state, name)
                for hands in passes:
                    hits = hands.hit(grasp, body, pose, margin=ROOM)
                    dropped[f"hand against {name}"] += int(hits.sum())
                    grasp = grasp[~hits]
        closes = self._closes(holder, grasp)
        dropped[f"closed hand against {self.part}"] += int((~closes).sum())
        return grasp[closes]

    def _closes(self, holder: Holder, grasp: Rows) -> Mask:
        """Which of ``grasp`` (m,) touch the part with nothing but pads once the hand is closed.

        The planner sees to it; grasps of a user's own need not: a knuckle may close in on the part.
        """
        known = self._closing[holder.arm.name]
        new = grasp[known[grasp] < 0]
        hands, body = holder.hands(closed=True), self.scene.bodies[self.part]
        known[new] = ~hands.hit(new, body, np.eye(4), without=holder.gripping)
        return np.asarray(known[grasp] == 1)

    def _approach(self, node: Node, holder: Holder, grasp: Rows) -> Array:
        """Approach directions (n, 3) of grasps in the world."""
        directions: Array = holder.grasps.part_from_hand[grasp, :3, 2] @ node.world_from_part[:3, :3].T
        return directions

    def _robot_free(self, node: Node, holder: Holder, reach: Reach, state: SceneState, failed: dict[int, str]) -> Reach:
        """The ways in which the robot touches nothing: at the grasp, where the hand comes from, above the support."""
        free = np.ones(len(reach.grasp), dtype=bool)
        for looked, rows, joints in self._looks(node, holder, reach.grasp, state):
            checker, left = self.scene.checker(looked, {holder.arm.name}), rows[free[rows]]
            configurations = self.scene.robot.with_joints(looked.q, holder.arm.name, getattr(reach, joints)[left])
            for row, q in zip(left, configurations, strict=True):
                pair = checker.first_touching(q)
                if pair is not None:
                    free[row] = False
                    failed[int(reach.grasp[row])] = f"robot in collision: {' / '.join(pair)}"
        return reach.take(free)

    def _looks(
        self, node: Node, holder: Holder, grasp: Rows, state: SceneState
    ) -> Iterator[tuple[SceneState, Rows, str]]:
        """States in which ways with ``grasp`` (m,) are checked: which of them, and which of their joints.

        Where hands come and go the hand is open, and most hands open equally wide; where the part is held at the end
        the hand is closed, each on its own grasp. A cup's lip always lies where its own grasp has it.
        """
        name = holder.arm.name
        if not node.to_leave:
            for one in np.unique(grasp):
                pads = [*state.contacts, *holder.pads(self.part, int(one))]
                closed = state.with_opening(name, holder.grasps.opening[one]).with_contacts(pads)
                yield closed, np.flatnonzero(grasp == one), "at"
            return
        lifted = self.state.with_pose(self.part, compose(np.eye(3), LIFT * _UP) @ node.world_from_part)
        places = [(state, "at"), (state, "before"), *([(lifted, "above")] if node.support is not None else [])]
        openings = holder.grasps.approach_opening[grasp]
        for (where, joints), opening in itertools.product(places, np.unique(openings)):
            rows = np.flatnonzero(openings == opening)
            for alike in [rows] if holder.arm.hand is None or holder.arm.hand.pads else rows[:, None]:
                touching = [*where.contacts, *holder.open_contacts(self.part, int(grasp[alike[0]]))]
                yield where.with_opening(name, opening).with_contacts(touching), alike, joints


def _nearest_first(found: IKSolutions, home: Array) -> tuple[Rows, Rows]:
    """Rows of ``found``: for each target the one nearest to ``home`` (dof,), and all others."""
    distance = np.abs(found.q - home).max(axis=1, initial=0.0)
    order = np.lexsort((distance, found.target))
    leads = np.diff(found.target[order], prepend=-1) > 0
    return order[leads], np.sort(order[~leads])


def _rows(grasp: Rows, found: IKSolutions, rows: Rows) -> Reach:
    q = found.q[rows]
    return Reach(grasp[found.target[rows]], q, q, q)


def followed_line(arm: Arm, q: Array, flanges: Array, way: Array) -> tuple[Array, Mask]:
    """Joints (m, dof) at the end of straight ways (m, 3) [m] of the flange, and whether they lead there (m,)."""
    line = np.repeat(flanges[None], _LINE_POSES, axis=0)
    line[:, :, :3, 3] += np.linspace(0.0, 1.0, _LINE_POSES)[:, None, None] * way
    path, reached = track(arm.chain, q, line)
    return path[-1], reached == _LINE_POSES
