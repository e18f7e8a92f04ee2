"""What stands against grasps: the same answers as the search's, each body confirmed by taking it away and by fcl."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest
from reference import Reference
from tabletops import Tabletop, tabletop

from kumitate.regrasp.diagnosis import Cause, Diagnosis, decisive, diagnose, roots
from kumitate.regrasp.reach import APPROACH, LIFT, ROOM, Holder, Node, Reacher, followed_line
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, SceneState
from kumitate.transforms import pose

ARMS = ("left", "right")
N = 60  # grasps
HALF = {"block": 0.05, "bracket": 0.025}  # m, how high the middle of a part stands
IK, SELF = Cause("no inverse kinematics at the grasp"), Cause("robot against itself")


@dataclass(frozen=True, eq=False)
class Case:
    """A part among a table and some boxes, and what was found of one arm there."""

    table: Tabletop
    boxes: dict[str, tuple[Body, np.ndarray]]
    node: Node
    arm: str

    def scene(self, without: str = "") -> Scene:
        boxes = [box for name, (box, _) in self.boxes.items() if name != without]
        return Scene.of(self.table.robot, [*self.table.scene.bodies.values(), *boxes])

    def state(self, without: str = "") -> SceneState:
        places = {name: at for name, (_, at) in self.boxes.items() if name != without}
        start = self.table.at([0.3, 0.0, 0.6])  # above it all; nodes tell where it is
        return self.scene(without).state({"table": self.table.world_from_table, self.part: start, **places})

    @property
    def part(self) -> str:
        return self.table.part.name

    def reacher(self, without: str = "", rows: slice = slice(None)) -> Reacher:
        holder = Holder.of(self.table.robot, self.arm, self.table.grasps.thin(N)[rows])
        return Reacher(self.scene(without), self.state(without), self.part, {self.arm: holder})

    def works(self, without: str = "", rows: slice = slice(None)) -> int:
        """How many grasps the search finds to work."""
        reacher = self.reacher(without, rows)
        every = np.ones(len(reacher.holders[self.arm].grasps), dtype=bool)
        return len(np.unique(reacher.reach(self.node, self.arm, every).grasp))


def cases(robot: str, part: str, rng: np.random.Generator) -> list[Case]:
    """A part on its table and one held in the air, each with two boxes that stand or hang near it."""
    table, found = tabletop(robot, part), []
    x = 0.3 if robot == "ur3_dual" else 0.4
    standing = table.at([x, rng.uniform(0.1, 0.25), HALF[part]], [0.0, 0.0, rng.uniform(0.0, np.pi)])
    nodes = [
        Node("standing", standing, "table"),
        Node("held", table.at([x, 0.15, 0.3], rng.uniform(-0.5, 0.5, 3)), None, to_leave=False),
    ]
    for node in nodes:
        around = {}
        for name in ("box", "crate"):
            sides, way = rng.uniform(0.02, 0.12, 3), rng.normal(size=3)
            at = node.world_from_part[:3, 3] + rng.uniform(0.08, 0.16) * way / np.linalg.norm(way)
            at[2] = max(at[2], table.top + sides[2] / 2.0 + 1e-3)
            around[name] = Body.box(name, sides, fixed=True), pose(at)
        found += [Case(table, around, node, arm) for arm in ARMS]
    return found


@pytest.fixture(scope="module")
def asked() -> list[tuple[Case, Diagnosis]]:
    """Cases, and what was found."""
    made = cases("ur3_dual", "bracket", np.random.default_rng(0)) + cases("nextage", "block", np.random.default_rng(2))
    return [(case, diagnose(case.reacher(), case.node, case.arm)) for case in made]


def alone(found: Diagnosis, body: str) -> int:
    """How many grasps nothing stands against but ``body``."""
    return sum(n for causes, n in found.stopped.items() if {cause.root for cause in causes} == {(body,)})


def test_grasps_work_where_the_search_finds_that_they_do(asked):
    for case, found in asked:
        assert found.works == case.works()
    assert sum(found.works > 0 for _, found in asked) > 2
    assert sum(found.works == 0 for _, found in asked) > 2


def test_every_grasp_is_looked_at_for_itself(asked):
    """Counted in parts, the causes are those of the whole, and what works is what works by itself."""
    for case, found in asked[::3]:
        parts = Counter[frozenset[Cause]]()
        for first in range(0, N, 15):
            rows = slice(first, first + 15)
            some = diagnose(case.reacher(rows=rows), case.node, case.arm)
            assert some.works == case.works(rows=rows)
            parts += some.stopped
        assert parts == found.stopped


def test_counts_add_up(asked):
    for case, found in asked:
        assert (found.part, found.arm, found.node) == (case.part, case.arm, case.node)
        assert found.planned == found.looked == found.stopped.total() == N
        assert found.works + sum(n for causes, n in found.stopped.items() if causes) == N
        for cause, count in found.each.items():
            assert count == sum(n for causes, n in found.stopped.items() if cause in causes)
            assert len(set(cause.bodies)) == len(cause.bodies)


def test_without_a_body_at_least_those_grasps_work_that_nothing_else_stood_against(asked):
    freed = 0
    for case, found in asked:
        for body in case.boxes:
            works = case.works(without=body)
            freed += alone(found, body)
            assert works >= found.works + alone(found, body)
            # No more come than it stood against at all.
            assert works <= found.works + sum(n for cause, n in found.each.items() if body in cause.bodies)
    assert freed > 20


def test_a_body_that_decides_frees_as_many_grasps_as_are_told(asked):
    looked = 0
    for case, found in asked:
        for cause, count in decisive([found.stopped]):
            assert found.works == 0
            if len(cause.bodies) == 1 and cause.bodies[0] in case.boxes and alone(found, cause.bodies[0]):
                assert case.works(without=cause.bodies[0]) >= count == alone(found, cause.bodies[0])
                looked += 1
    assert looked > 1


def test_the_closest_has_the_fewest_things_to_go(asked):
    for _, found in asked:
        assert roots(found.closest.causes) == min(map(roots, found.stopped))
        assert found.closest.causes in found.stopped


def nearest(case: Case, found: Diagnosis) -> dict[str, float]:
    """How near [m] by fcl robot and part come to each body, in the closest candidate and on its straight ways."""
    reacher, reference = case.reacher(), Reference(case.scene())
    holder, robot = reacher.holders[case.arm], case.table.robot
    grasp, arm, state = found.closest.grasp, holder.arm, reacher.state_at(case.node)
    at = found.closest.q[arm.indices]
    flange = (case.node.world_from_part @ holder.part_from_flange[grasp])[None]
    back = -APPROACH * (case.node.world_from_part @ holder.grasps.part_from_hand[grasp])[:3, 2]
    lifted = state.with_pose(case.part, pose([0.0, 0.0, LIFT]) @ case.node.world_from_part)
    ways = [(state, np.zeros(3), False)]
    ways += [(state, np.zeros(3), True), (state, back, True)] if case.node.to_leave else []
    ways += [(lifted, np.array([0.0, 0.0, LIFT]), True)] if case.node.support else []
    distances: dict[str, float] = {}
    for where, way, is_open in ways:
        (q,), (followed,) = followed_line(arm, at[None], flange, way[None])
        if followed:
            opening = (holder.grasps.approach_opening if is_open else holder.grasps.opening)[grasp]
            looked = where.with_opening(case.arm, float(opening))
            configuration = robot.with_joints(looked.q, case.arm, q[None])[0]
            for pair, distance in reference.distances(looked, configuration, 2.0 * ROOM).items():
                for body in set(pair) & {"table", *case.boxes}:
                    if set(pair) != {body, case.part} or body != case.node.support:  # on which it rests
                        distances[body] = min(distances.get(body, np.inf), distance)
    return distances


def test_fcl_finds_what_is_told_of_the_closest_candidate_and_nothing_else(asked):
    confirmed = clear = 0
    for case, found in asked:
        roots_of = {cause.root for cause in found.closest.causes}
        if found.closest.q is None or IK.root in roots_of or (clear > 1 and not roots_of):
            continue
        near = nearest(case, found)
        named = {body for root in roots_of for body in root} & {"table", *case.boxes}
        for body in named:
            assert near[body] < 1.1 * ROOM
        for body, distance in near.items():
            assert body in named or distance > 0.0
        confirmed += len(named)
        clear += not named
    assert confirmed > 2
    assert clear > 1


# What decides ---------------------------------------------------------------------------------------------------------

WALL, LID = Cause("hand against", ("wall",)), Cause("hand against", ("lid",))
LIFTED = Cause("lifted part against", ("lid",))


@pytest.mark.parametrize(
    ("stopped", "expected"),
    [
        ({}, []),
        ({(): 1, (WALL,): 40}, []),  # some work
        ({(WALL,): 3, (LID,): 5, (WALL, LID): 90}, [(LID, 5), (WALL, 3)]),
        ({(WALL, LID): 4, (WALL, IK, SELF): 9}, [(LID, 4), (WALL, 4)]),  # one will not do
        ({(IK,): 80, (SELF,): 7, (WALL,): 2}, [(WALL, 2), (IK, 80), (SELF, 7)]),  # bodies first
        ({(LID, LIFTED): 6, (LIFTED,): 1, (LID, WALL): 50}, [(LIFTED, 7)]),  # one body, in its most frequent form
        ({(IK,): 2, (Cause("no inverse kinematics along the lift"), IK): 1}, [(IK, 3)]),
    ],
)
def test_what_decides_is_what_fewest_grasps_need_to_go(stopped, expected):
    assert decisive([Counter({frozenset(causes): n for causes, n in stopped.items()})]) == expected


def test_groups_decide_each_for_itself():
    near, far = Counter({frozenset({WALL, LID}): 4}), Counter({frozenset({IK}): 30, frozenset({WALL}): 2})
    assert decisive([near, far]) == [(WALL, 6), (LID, 4), (IK, 30)]
    assert decisive([near]) == [(LID, 4), (WALL, 4)]


def test_causes_read_as_sentences():
    assert str(LID) == "hand against lid"
    assert str(IK) == "no inverse kinematics at the grasp"
    assert str(Cause("blocked by", ("left_link3", "wall"))) == "blocked by left_link3 and wall"


# Single questions -----------------------------------------------------------------------------------------------------


def test_a_part_that_stands_in_something_has_that_against_all_its_grasps():
    table = tabletop("ur3_dual", "bracket")
    sunk = Node("sunk", table.at([0.3, 0.1, 0.01]), "table")
    crate = {"crate": (Body.box("crate", [0.05] * 3, fixed=True), sunk.world_from_part)}
    found = diagnose((case := Case(table, crate, sunk, "left")).reacher(), sunk, case.arm)
    assert found.each[Cause("part against", ("crate",))] == N
    assert found.works == 0


def test_a_lid_is_met_by_the_part_once_that_is_lifted():
    table = tabletop("nextage", "block")
    node = Node("standing", table.at([0.4, 0.2, 0.05]), "table")
    lid = {"lid": (Body.box("lid", [0.05, 0.05, 0.01], fixed=True), table.at([0.4, 0.2, 0.13]))}
    found = diagnose(Case(table, lid, node, "left").reacher(), node, "left")
    assert found.each[LIFTED] > 0
    assert Cause("part against", ("lid",)) not in found.each


def test_an_arm_without_grasps_has_nothing_to_tell():
    table = tabletop("ur3_dual", "slab")
    node = Node("standing", table.at([0.3, 0.2, 0.05]), "table")
    found = diagnose(table.reacher(node.world_from_part, table.grasps, ["left"]), node, "left")
    assert (found.planned, found.looked, found.works, found.closest) == (0, 0, 0, None)
    assert found.stopped == found.each == Counter()
    assert decisive([found.stopped]) == []


def test_out_of_reach_nothing_but_the_hand_is_asked():
    table = tabletop("ur3_dual", "bracket")
    far = Node("far", table.at([0.3, 3.0, 0.5]), None)
    found = diagnose(Case(table, {}, far, "left").reacher(), far, "left")
    assert found.each[IK] == N
    assert set(found.each) <= {IK, Cause("closed hand against the part itself")}
    assert found.closest.q is None
    assert found.closest.causes == {IK}
