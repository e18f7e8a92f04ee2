"""Why grasps do not work at a node: for each grasp all that stands against it, not only what is tested first.

The search asks cheap questions first and never the others; what it counts says little of what would have to change.
Here every grasp that is looked at answers all questions, and a cause is as grave as the number of grasps that would
work without it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..robots.state import SceneState
from ..transforms import Array, compose, invert
from .reach import APPROACH, LIFT, ROOM, Holder, Node, Reacher, Rows, followed_line

_LOOKED = 240  # well-spread grasps that answer
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, order=True)
class Cause:
    """What stands against a grasp, and the bodies that it meets."""

    words: str
    bodies: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " ".join([self.words, *([" and ".join(self.bodies)] if self.bodies else [])])

    @property
    def root(self) -> tuple[str, ...]:
        """What would have to go: the bodies, whatever meets them; a limit of the arm where there are none."""
        return self.bodies or (self.words.partition(_NO_ANSWER)[1] or self.words,)


_NO_ANSWER = "no inverse kinematics"


@dataclass(frozen=True, eq=False)
class Candidate:
    """The grasp that comes nearest to working.

    Attributes:
        grasp: Its number.
        q: The robot's configuration (nq,) with which it does; none where no inverse kinematics answers.
        causes: What stands against it.
    """

    grasp: int
    q: Array | None
    causes: frozenset[Cause]


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What stands against the grasps of one arm at one node.

    Attributes:
        node: The node.
        part: The part.
        arm: The arm.
        planned: How many grasps its hand has.
        looked: How many of them were looked at.
        stopped: How many of those fell to each set of causes; the empty set counts those that work.
        closest: The grasp with the fewest things to go, if it can be one that the arm reaches, and of the most frequent
            causes; none where there is no grasp.
    """

    node: Node
    part: str
    arm: str
    planned: int
    looked: int
    stopped: Counter[frozenset[Cause]]
    closest: Candidate | None

    @property
    def works(self) -> int:
        """How many grasps work."""
        return self.stopped[frozenset()]

    @property
    def each(self) -> Counter[Cause]:
        """How many grasps each cause stands against, alone or with others."""
        counts: Counter[Cause] = Counter()
        for causes, n in self.stopped.items():
            counts.update(dict.fromkeys(sorted(causes), n))
        return counts


def decisive(groups: Iterable[Counter[frozenset[Cause]]]) -> list[tuple[Cause, int]]:
    """How many grasps would work without each cause; in a group where none would, without as few others as possible.

    Each group counts sets of causes, as a diagnosis does. A body that is met in several ways is told once, in the most
    frequent one. Bodies come first, which can be taken away: without inverse kinematics no grasp was asked further, and
    what looks like many may be none.
    """
    counts, forms = Counter[tuple[str, ...]](), Counter[Cause]()
    for stopped in groups:
        fewest = min(map(roots, stopped), default=0)
        for causes, n in stopped.items():
            if roots(causes) == fewest:
                counts.update(dict.fromkeys({cause.root for cause in causes}, n))
                forms.update(dict.fromkeys(causes, n))
    shown = {cause.root: cause for cause, _ in sorted(forms.items(), key=lambda entry: entry[::-1])}
    found = [(shown[root], n) for root, n in counts.items()]
    return sorted(found, key=lambda entry: (not entry[0].bodies, -entry[1], entry[0]))


def roots(causes: Iterable[Cause]) -> int:
    """How many different things would have to go for a grasp with these causes to work."""
    return len({cause.root for cause in causes})


def diagnose(reacher: Reacher, node: Node, arm: str) -> Diagnosis:
    """Ask the grasps of ``arm`` at ``node`` everything."""
    holder, part = reacher.holders[arm], reacher.part
    rows = holder.grasps.spread(_LOOKED)
    state = reacher.state_at(node)
    common = {Cause("part against", _others(pair, part)) for pair in reacher.scene.checker(state).static}
    against = {row: common | met for row, met in _hands(reacher, node, holder, rows, state).items()}
    nowhere = Cause(f"{_NO_ANSWER} at the grasp")
    best = {row: Candidate(row, None, frozenset(met | {nowhere})) for row, met in against.items()}
    for way in _ways(reacher, node, holder, against, state):
        if best[way.grasp].q is None or roots(way.causes) < roots(best[way.grasp].causes):
            best[way.grasp] = way
    stopped = Counter(entry.causes for entry in best.values())
    closest = min(
        best.values(),
        key=lambda entry: (roots(entry.causes), entry.q is None, -stopped[entry.causes]),
        default=None,
    )
    return Diagnosis(node, part, arm, len(holder.grasps), len(rows), stopped, closest)


def _hands(reacher: Reacher, node: Node, holder: Holder, rows: Rows, state: SceneState) -> dict[int, set[Cause]]:
    """What the hand of each grasp meets: closed, open, and open where it comes from."""
    part_from_world = invert(node.world_from_part)
    passes = [holder.hands(closed=True)]
    if node.to_leave:
        passes += [holder.hands(closed=False), holder.hands(closed=False, back=APPROACH)]
    against: dict[int, set[Cause]] = {int(row): set() for row in rows}
    for name, body in reacher.scene.bodies.items():
        if name != reacher.part:
            at = part_from_world @ reacher.scene.world_from_body(state, name)
            hits = np.any([hands.hit(rows, body, at, margin=ROOM) for hands in passes], axis=0)
            for row in rows[hits]:
                against[int(row)].add(Cause("hand against", (name,)))
    own = holder.hands(closed=True).hit(rows, reacher.scene.bodies[reacher.part], np.eye(4), without=holder.gripping)
    for row in rows[own]:
        against[int(row)].add(Cause("closed hand against the part itself"))
    return against


def _ways(
    reacher: Reacher, node: Node, holder: Holder, against: Mapping[int, set[Cause]], state: SceneState
) -> Iterator[Candidate]:
    """Each grasp with its branches of inverse kinematics, those near home first, up to one that adds no root."""
    rows, settled = np.fromiter(against, dtype=np.intp), set[int]()
    arm, home = holder.arm, reacher.scene.robot.home[holder.arm.indices]
    flanges = node.world_from_part @ holder.part_from_flange[rows]
    found = arm.solver(flanges)
    nearest = np.lexsort((np.abs(found.q - home).max(axis=1, initial=0.0), found.target))
    targets, joints = found.target[nearest], found.q[nearest]
    looks = [(state, joints, np.ones(len(joints), dtype=bool), "at the grasp", "part")]
    if node.to_leave:
        back = -APPROACH * (node.world_from_part @ holder.grasps.part_from_hand[rows])[targets, :3, 2]
        looks.append((state, *followed_line(arm, joints, flanges[targets], back), "along the approach", "part"))
    if node.support is not None:
        lifted = reacher.state.with_pose(reacher.part, compose(np.eye(3), LIFT * _UP) @ node.world_from_part)
        up = np.tile(LIFT * _UP, (len(joints), 1))
        looks.append((lifted, *followed_line(arm, joints, flanges[targets], up), "along the lift", "lifted part"))
    openings = holder.grasps.approach_opening if node.to_leave else holder.grasps.opening
    pads = holder.open_contacts if node.to_leave else holder.pads
    for i, (target, q) in enumerate(zip(targets, joints, strict=True)):
        row, causes = int(rows[target]), set(against[int(rows[target])])
        if row in settled:
            continue
        for where, places, followed, line, moved in looks:
            if not followed[i]:
                causes.add(Cause(f"{_NO_ANSWER} {line}"))
                continue
            held = where.with_opening(arm.name, float(openings[row]))
            held = held.with_contacts([*held.contacts, *pads(reacher.part, row)])
            configuration = reacher.scene.robot.with_joints(held.q, arm.name, places[i][None])[0]
            for pair in reacher.scene.checker(held, {arm.name}).touching(configuration):
                causes.add(_meeting(pair, reacher, arm.name, moved))
        if roots(causes) == roots(against[row]):
            settled.add(row)
        yield Candidate(row, reacher.scene.robot.with_joints(state.q, arm.name, q[None])[0], frozenset(causes))


def _meeting(pair: tuple[str, str], reacher: Reacher, arm: str, part: str) -> Cause:
    """What it is that two bodies touch; ``part`` is what the part is called there."""
    others = _others(tuple(name for name in pair if name in reacher.scene.bodies), reacher.part)
    if reacher.part in pair:
        return Cause(f"{part} against", others or tuple(name for name in pair if name != reacher.part))
    if not others:
        return Cause("robot against itself")
    hand = any(name.startswith(f"{arm}/") for name in pair)
    return Cause("hand against" if hand else "robot against", others)


def _others(pair: tuple[str, ...], part: str) -> tuple[str, ...]:
    return tuple(name for name in pair if name != part)
