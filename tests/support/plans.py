"""A small real plan: a block goes from hand to hand and back to the table, a peg into a tube.

Made with the ground floor alone: grasps, inverse kinematics, motions, lines, grips and their timing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from functools import cache
from hashlib import sha256
from typing import Any

import numpy as np
import trimesh

from kumitate.errors import PlanningError
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.grip import plan_grip
from kumitate.robots.library import load_robot
from kumitate.robots.motion import plan_motion
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, Contact
from kumitate.robots.straight import INSERTION, LineTolerance, plan_linear
from kumitate.robots.timing import time_motion
from kumitate.tasks.document import (
    FORMAT,
    Action,
    Carried,
    Event,
    GraspUse,
    Kind,
    Mesh,
    Motion,
    Plan,
    State,
    matrix,
)
from kumitate.tasks.models import model_digests
from kumitate.transforms import Array, invert, pose

BACK = pose([0.0, 0.0, -0.06])  # where a hand approaches from, in its own frame
UP = pose([0.0, 0.0, 0.05])
INSERTED = 0.04  # m

TASK: dict[str, Any] = {
    "robot": "nextage",
    "hands": {"left": "robotiq_2f85", "right": "robotiq_2f85"},
    "speed": 0.5,
    "cell": [
        {
            "name": "table",
            "box": [0.3, 1.32, 0.02],
            "at": {"xyz": [0.4, 0.0, -0.06], "rpy": [0.0, 0.0, 0.0]},
            "support": True,
        }
    ],
    "parts": {
        "block": {"mesh": "block.stl", "unit": "m", "mass": 0.1, "at": {"xyz": [0.35, 0.2, 0.01]}},
        "peg": {"mesh": "peg.stl", "unit": "m", "mass": 0.05, "at": {"xyz": [0.35, 0.35, -0.005]}},
        "tube": {"mesh": "tube.stl", "unit": "m", "mass": 0.08, "at": {"xyz": [0.35, -0.2, -0.025]}},
    },
    "goals": [
        {"hand_over": {"part": "block", "to": "right", "at": {"xyz": [0.4, 0.0, 0.25], "rpy": [-np.pi / 2, 0.0, 0.0]}}},
        {"place": {"part": "block", "at": {"xyz": [0.35, -0.35, 0.01], "rpy": [np.pi, 0.0, 0.0]}}},
        {
            "attach": {
                "part": "peg",
                "to": "tube",
                "at": {"xyz": [0.0, 0.0, -0.045], "rpy": [np.pi, 0.0, 0.0]},
                "insert": {"direction": [0.0, 0.0, 1.0], "distance": INSERTED},
                "then": "hold",
            }
        },
    ],
    "start": {},
    "end": "home",
}
MESHES = {
    "block": lambda: trimesh.creation.box([0.03, 0.03, 0.12]),
    "peg": lambda: trimesh.creation.cylinder(0.009, 0.09, sections=32),
    "tube": lambda: trimesh.creation.annulus(0.011, 0.025, 0.05, sections=32),
}


@cache
def sample_plan() -> Plan:
    """A valid plan of some 25 actions on a Nextage with two grippers: pick, hand over, place, insert, hold."""
    job = Job(TASK, {name: make() for name, make in MESHES.items()})
    _block(job)
    _peg(job)
    return job.plan()


@cache
def short_plan(
    hand: str = "robotiq_2f85", size: tuple[float, float, float] = (0.03, 0.03, 0.12), height: float = 0.04
) -> Plan:
    """A valid plan of nine actions: the left hand puts a block elsewhere, turned by a quarter, and goes home.

    Args:
        hand: The left hand.
        size: Sides of the block [m].
        height: It takes the block as near as it can to this height above the middle [m].
    """
    z = -0.05 + size[2] / 2.0
    goal = {"part": "block", "at": {"xyz": [0.35, 0.35, z], "rpy": [0.0, 0.0, np.pi / 2]}}
    parts = {"block": {**TASK["parts"]["block"], "at": {"xyz": [0.35, 0.2, z]}}}
    task = {**TASK, "hands": {**TASK["hands"], "left": hand}, "parts": parts, "goals": [{"place": goal}]}
    job = Job(task, {"block": trimesh.creation.box(size)})
    job.goal = 0
    place = pose(**goal["at"])

    def work(grasp: GraspUse) -> None:
        job.take("left", "block", grasp)
        job.lift("left", "block", grasp)
        job.carry("left", "block", UP @ place, grasp)
        job.lower("left", "block", place, grasp)
        job.release("left", "block", grasp)

    job.tried(zip(job.grasps("block", np.array([0.0, 0.0, -1.0]), height)[:6]), work)
    job.goal = None
    job.go_home("left")
    return job.plan()


@cache
def standing_plan() -> Plan:
    """A valid plan of nine actions: the left hand puts the peg into the tube, which stands on the table."""
    insert = {"direction": [0.0, 0.0, -1.0], "distance": 0.06}
    goal = {"part": "peg", "to": "tube", "at": {"xyz": [0.0, 0.0, 0.025]}, "insert": insert}
    tube = {**TASK["parts"]["tube"], "at": {"xyz": [0.35, 0.2, -0.025]}}
    task = {**TASK, "parts": {"peg": TASK["parts"]["peg"], "tube": tube}, "goals": [{"attach": goal}]}
    job = Job(task, {name: MESHES[name]() for name in ("peg", "tube")})
    job.goal = 0
    world_from_peg = job.world_from("tube") @ pose(**goal["at"])

    def work(grasp: GraspUse) -> None:
        job.take("left", "peg", grasp)
        job.lift("left", "peg", grasp)
        job.carry("left", "peg", pose([0.0, 0.0, insert["distance"]]) @ world_from_peg, grasp)
        hand = world_from_peg @ grasp.part_from_hand
        job.line("left", "peg", hand, grasp, "insert", "the peg into the tube", INSERTION, [("peg", "tube")])
        job.release("left", "peg", grasp)

    job.tried(zip(job.grasps("peg", np.array([0.0, 0.0, -1.0]), 0.03)[:6]), work)
    job.goal = None
    job.go_home("left")
    return job.plan()


@cache
def use_plan() -> Plan:
    """A valid plan of seven actions: the left hand takes a block, brings its end to a plate on the table, and back."""
    top, distance = 0.02, 0.04
    plate = {"name": "plate", "box": [0.06, 0.06, 2.0 * top], "at": {"xyz": [0.35, 0.38, top - 0.05]}}
    goal = {
        "part": "block",
        "frame": "tip",
        "of": "plate",
        "at": {"xyz": [0.0, 0.0, top], "rpy": [np.pi, 0.0, 0.0]},
        "approach": {"direction": [0.0, 0.0, -1.0], "distance": distance},
    }
    block = {**TASK["parts"]["block"], "frames": {"tip": {"xyz": [0.0, 0.0, -0.06], "rpy": [np.pi, 0.0, 0.0]}}}
    task = {**TASK, "cell": [*TASK["cell"], plate], "parts": {"block": block}, "goals": [{"use": goal}]}
    job = Job(task, {"block": MESHES["block"]()})
    job.goal = 0
    used = pose(plate["at"]["xyz"]) @ pose(**goal["at"]) @ invert(pose(**block["frames"]["tip"]))
    before = pose([0.0, 0.0, distance]) @ used

    def work(grasp: GraspUse) -> None:
        job.take("left", "block", grasp)
        job.lift("left", "block", grasp)
        job.carry("left", "block", before, grasp)
        job.worked_on = [Contact("plate", "block", np.array([0.0, 0.0, 1.0]))]
        for kind, where in (("press", used), ("withdraw", before)):
            job.line("left", "block", where @ grasp.part_from_hand, grasp, kind, f"{kind} the block", INSERTION)

    job.tried(zip(job.grasps("block", np.array([0.0, 0.0, -1.0]), 0.04)[:6]), work)
    return job.plan()


@cache
def interlocked_plan() -> Plan:
    """A valid plan of eleven actions on an HRP-5P: a bar goes from hand to hand, the fingers interlocked."""
    over = {"xyz": [0.45, 0.05, 0.45]}
    goal = {"part": "bar", "to": "left", "at": over, "interlocked": True}
    table = {"name": "table", "box": [0.5, 1.2, 0.02], "at": {"xyz": [0.55, 0.0, 0.14]}, "support": True}
    bar = {"mesh": "bar.stl", "unit": "m", "mass": 0.2, "at": {"xyz": [0.5, -0.15, 0.25]}}
    task = {
        **TASK,
        "robot": "hrp5p",
        "hands": dict.fromkeys(("left", "right"), "hrp5p_three_finger"),
        "cell": [table],
        "parts": {"bar": bar},
        "goals": [{"hand_over": goal}],
    }
    job = Job(task, {"bar": trimesh.creation.box([0.03, 0.04, 0.2])})
    job.goal = 0
    # The giver's hand looks along y, its pair one above the other; the taker's is turned by a half about that line.
    giver = pose(rpy=[-np.pi / 2, 0.0, 0.0])
    first, second = (_across(hand, 0.03, 0.08) for hand in (giver, giver @ pose(rpy=[0.0, np.pi, 0.0])))
    job.take("right", "bar", first)
    job.lift("right", "bar", first)
    job.carry("right", "bar", pose(**over), first)
    job.take("left", "bar", second)
    job.release("right", "bar", first)
    job.goal = None
    job.go_home("right")
    return job.plan()


class Job:
    """A scene, where everything in it is, and the actions so far."""

    def __init__(self, task: dict[str, Any], meshes: Mapping[str, trimesh.Trimesh]) -> None:
        self.task, self.meshes = task, dict(meshes)
        self.robot = load_robot(task["robot"], task["hands"])
        self.parts = {
            name: Part.from_mesh(mesh, mass=task["parts"][name]["mass"], name=name) for name, mesh in meshes.items()
        }
        obstacles = [Body.box(entry["name"], entry["box"], fixed=True) for entry in task["cell"]]
        bodies = [Body.from_mesh(name, mesh) for name, mesh in meshes.items()]
        self.scene = Scene.of(self.robot, [*obstacles, *bodies])
        at = {entry["name"]: entry["at"] for entry in task["cell"]}
        at |= {name: entry["at"] for name, entry in task["parts"].items()}
        self.state = self.scene.state({name: pose(**where) for name, where in at.items()})
        self.actions: list[Action] = []
        self.goal: int | None = None
        self.grips: dict[str, tuple[str, GraspUse]] = {}  # by arm: the part that its pads may touch, and how
        self.standing = set(self.parts)  # parts that may touch the table
        self.worked_on: list[Contact] = []  # where a tool may touch what it is used on

    # What an action is made of ----------------------------------------------------------------------------------------

    def grasps(self, part: str, approach: Array, height: float) -> list[GraspUse]:
        """Grasps whose hand looks along ``approach`` in the part's frame, those nearest to ``height`` first."""
        found = _grasps(self, part)
        along = found[found.part_from_hand[:, :3, 2] @ approach > 1.0 - 1e-6]
        order = np.lexsort((-along.quality, np.round(np.abs(along.part_from_hand[:, 2, 3] - height), 3)))
        return [_use(along, int(i)) for i in order]

    def world_from(self, part: str) -> Array:
        return self.scene.world_from_body(self.state, part)

    def free(self, arm: str, part: str, world_from_hand: Array, grasp: GraspUse, kind: Kind, words: str) -> None:
        """A free motion to where the hand stands, at the grasp's opening, at ``world_from_hand``."""
        state = self._touching()
        target = self._at_opening(arm, world_from_hand, grasp)
        answers = self.robot.arms[arm].solve_ik(target, state.openings[arm]).q
        if not len(answers):
            raise PlanningError(f"{arm} does not reach {words}")
        self._freely(arm, part, self.robot.with_joints(state.q, arm, answers), kind, words, grasp)

    def _freely(
        self, arm: str, part: str | None, goals: Array, kind: Kind, words: str, grasp: GraspUse | None = None
    ) -> None:
        """A free motion to one of the configurations ``goals`` (g, nq)."""
        state = self._touching()
        path = plan_motion(self.scene, state, goals, [arm], seed=1, most_checks=8000)
        motion = time_motion(self.scene, state, path, [arm], speed=self.task["speed"])
        self._moved(arm, part, motion, kind, words, grasp)

    def line(
        self,
        arm: str,
        part: str,
        world_from_hand: Array,
        grasp: GraspUse,
        kind: Kind,
        words: str,
        tolerance: LineTolerance | None = None,
        events: Iterable[tuple[str, str]] = (),
    ) -> None:
        """A straight motion to where the hand stands, at the grasp's opening, at ``world_from_hand``."""
        state = self._touching()
        target = self._at_opening(arm, world_from_hand, grasp)
        line = tolerance or LineTolerance()
        path = plan_linear(self.scene, state, arm, target, tolerance=line, working=self.robot.hands)
        motion = time_motion(
            self.scene, state, path, [arm], speed=self.task["speed"], line=line, working=self.robot.hands
        )
        self._moved(arm, part, motion, kind, words, grasp, events)

    def grip(self, arm: str, opening: float, grasp: GraspUse, part: str, words: str, closes: bool) -> None:
        """Close on ``part`` and take it, or let it go and open; a cup does so in no time."""
        start, before, hand = self._state(), self.state.openings[arm], self.robot.hands[arm]
        plan_grip(self.scene, self._touching(), arm, opening)
        duration = 1.5 * abs(opening - before) / (2.0 * hand.speed * self.task["speed"]) if hand.speed else 0.0
        self.state = self.state.with_opening(arm, opening)
        if closes:
            self.state = self.scene.attach(self.state, part, arm)
        elif self.state.attached[part].carrier == arm:
            self.state = self.scene.detach(self.state, part)
            self.standing.add(part)
        event = Event(duration if closes else 0.0, "attach" if closes else "detach", part, arm)
        openings = {a: (start.openings[a],) * 2 for a in start.openings} | {arm: (before, opening)}
        none = (0.0,) * len(start.q)
        motion = Motion((0.0, duration), (start.q,) * 2, (none,) * 2, openings, dict.fromkeys(openings, (0.0, 0.0)))
        if not duration:
            motion = Motion(
                (0.0,), (start.q,), (none,), {a: o[:1] for a, o in openings.items()}, dict.fromkeys(openings, (0.0,))
            )
        self._add("close" if closes else "open", arm, words, part, start, motion, (event,), grasp)

    # Sequences --------------------------------------------------------------------------------------------------------

    def take(self, arm: str, part: str, grasp: GraspUse) -> None:
        """Go there with the open hand, approach, close."""
        hand = self.world_from(part) @ grasp.part_from_hand
        self.free(arm, part, hand @ BACK, grasp, "transit", f"{arm} hand to the {part}")
        self.grips[arm] = (part, grasp)
        self.line(arm, part, hand, grasp, "approach", f"{arm} hand approaches the {part}")
        self.grip(arm, grasp.opening, grasp, part, f"{arm} hand takes the {part}", closes=True)

    def lift(self, arm: str, part: str, grasp: GraspUse) -> None:
        """Straight up from the table."""
        self.line(arm, part, UP @ self.world_from(part) @ grasp.part_from_hand, grasp, "lift", f"lift the {part}")
        self.standing.discard(part)

    def carry(self, arm: str, part: str, world_from_part: Array, grasp: GraspUse) -> None:
        """A free motion of the held part."""
        self.free(arm, part, world_from_part @ grasp.part_from_hand, grasp, "transfer", f"carry the {part}")

    def lower(self, arm: str, part: str, world_from_part: Array, grasp: GraspUse) -> None:
        """Straight down onto the table."""
        self.standing.add(part)
        self.line(arm, part, world_from_part @ grasp.part_from_hand, grasp, "lower", f"put the {part} down")

    def release(self, arm: str, part: str, grasp: GraspUse) -> None:
        """Open and go back."""
        self.grip(arm, grasp.approach_opening, grasp, part, f"{arm} hand lets the {part} go", closes=False)
        hand = self.world_from(part) @ grasp.part_from_hand
        self.line(arm, part, hand @ BACK, grasp, "retreat", f"{arm} hand retreats from the {part}")
        del self.grips[arm]

    def go_home(self, arm: str) -> None:
        home = self.robot.with_joints(self.state.q, arm, self.robot.home[None, self.robot.arms[arm].indices])
        self._freely(arm, None, home, "transit", f"{arm} arm home")

    def tried(self, choices: Iterable[tuple[GraspUse, ...]], work: Any) -> tuple[GraspUse, ...]:
        """The first of the choices with which ``work`` succeeds; others leave no trace."""
        for choice in choices:
            kept = self.state, len(self.actions), dict(self.grips), set(self.standing)
            try:
                work(*choice)
            except PlanningError:
                self.state, count, self.grips, self.standing = kept
                del self.actions[count:]
            else:
                return choice
        raise PlanningError("no grasp leads to the goal")

    def plan(self) -> Plan:
        boxes = {entry["name"]: trimesh.creation.box(entry["box"]) for entry in self.task["cell"]}
        meshes = {name: Mesh.of(box) for name, box in boxes.items()}
        for name, mesh in self.meshes.items():
            meshes[name] = Mesh.of(mesh, sha256(mesh.export(file_type="stl")).hexdigest())
        return Plan(
            format=FORMAT,
            version="0",
            task=self.task,
            folder=".",
            digests=model_digests(self.task, "."),
            seed=1,
            joints=self.robot.joint_names,
            meshes=meshes,
            actions=tuple(self.actions),
            seconds={},
        )

    # Inside -----------------------------------------------------------------------------------------------------------

    def _at_opening(self, arm: str, world_from_hand: Array, grasp: GraspUse) -> Array:
        """The pose of the hand at its present opening that puts its base where the grasp's opening asks for it."""
        grasping, now = self.robot.arms[arm].flange_from_hand([grasp.opening, self.state.openings[arm]])
        return world_from_hand @ invert(grasping) @ now

    def _touching(self):
        """The state with what may touch in it: standing parts and the table, pads and what they hold."""
        contacts = [Contact("table", part, np.array([0.0, 0.0, 1.0])) for part in sorted(self.standing)]
        contacts += self.worked_on
        for arm, (part, grasp) in self.grips.items():
            closing, _, approach = np.array(grasp.part_from_hand)[:3, :3].T
            hand = self.robot.hands[arm]
            if not hand.pads:
                contacts.append(Contact(part, f"{arm}/{hand.pieces[0].name}", -approach))
            for i, pad in enumerate(hand.pads):
                piece = next(piece for piece in hand.pieces if piece.joint == pad.joint)
                contacts.append(Contact(part, f"{arm}/{piece.name}", -closing if i == 0 else closing))
        return self.state.with_contacts(contacts)

    def _state(self) -> State:
        return State(
            q=tuple(self.state.q.tolist()),
            openings=dict(self.state.openings),
            poses={part: matrix(self.world_from(part)) for part in self.parts},
            attached={
                part: Carried(entry.carrier, matrix(entry.carrier_from_body))
                for part, entry in self.state.attached.items()
            },
        )

    def _moved(self, arm, part, trajectory, kind, words, grasp, events=()) -> None:
        start = self._state()
        count = len(trajectory.times)
        motion = Motion(
            times=tuple(trajectory.times.tolist()),
            positions=tuple(map(tuple, trajectory.positions.tolist())),
            velocities=tuple(map(tuple, trajectory.velocities.tolist())),
            openings={a: (opening,) * count for a, opening in self.state.openings.items()},
            opening_velocities=dict.fromkeys(self.state.openings, (0.0,) * count),
        )
        self.state = self.state.with_q(trajectory.positions[-1])
        for joined, carrier in events:
            self.state = self.scene.attach(self.state, joined, carrier)
        taken = tuple(Event(motion.duration, "attach", joined, carrier) for joined, carrier in events)
        self._add(kind, arm, words, part, start, motion, taken, grasp)

    def _add(self, kind, arm, words, part, start, motion, events, grasp) -> None:
        end = self._state()
        self.actions.append(Action(kind, (arm,), words, part, start, motion, events, grasp, self.goal, end))


def _block(job: Job) -> None:
    """From the table through the air to the other hand, and down on its other end."""
    over, place = (pose(**goal["at"]) for goal in (job.task["goals"][0]["hand_over"], job.task["goals"][1]["place"]))
    down, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])

    def work(first: GraspUse, second: GraspUse) -> None:
        job.goal = 0
        job.take("left", "block", first)
        job.lift("left", "block", first)
        job.carry("left", "block", over, first)
        job.take("right", "block", second)
        job.release("left", "block", first)
        job.goal = 1
        job.carry("right", "block", UP @ place, second)
        job.lower("right", "block", place, second)
        job.release("right", "block", second)

    first, second = job.grasps("block", down, 0.04), job.grasps("block", up, -0.04)
    job.tried(itertools.product(first[:6], second[:6]), work)


def _peg(job: Job) -> None:
    """Peg and tube into the air, one hand opposite to the other, and the peg in."""
    goal = job.task["goals"][2]["attach"]
    tube_from_peg = pose(**goal["at"])
    job.goal = 2
    down = np.array([0.0, 0.0, -1.0])
    world_from_tube = pose([0.4, -0.03, 0.25], [np.pi / 2, 0.0, 0.0])
    before = world_from_tube @ pose([0.0, 0.0, -goal["insert"]["distance"]]) @ tube_from_peg

    def fetch_tube(grasp: GraspUse) -> None:
        job.take("right", "tube", grasp)
        job.lift("right", "tube", grasp)
        job.carry("right", "tube", world_from_tube, grasp)

    def fetch_and_insert(grasp: GraspUse) -> None:
        job.take("left", "peg", grasp)
        job.lift("left", "peg", grasp)
        job.carry("left", "peg", before, grasp)
        inserted = world_from_tube @ tube_from_peg @ grasp.part_from_hand
        job.line("left", "peg", inserted, grasp, "insert", "the peg into the tube", INSERTION, [("peg", "tube")])
        job.release("left", "peg", grasp)

    (tube,) = job.tried(zip(job.grasps("tube", down, 0.02)[:6]), fetch_tube)
    job.tried(zip(job.grasps("peg", down, 0.03)[:6]), fetch_and_insert)
    job.carry("right", "tube", UP @ world_from_tube, tube)
    job.goal = None
    job.go_home("left")


def _grasps(job: Job, part: str) -> GraspSet:
    return plan_grasps(job.parts[part], job.robot.hands["left"])


def _use(grasps: GraspSet, i: int) -> GraspUse:
    return GraspUse(
        part_from_hand=matrix(grasps.part_from_hand[i]),
        opening=float(grasps.opening[i]),
        approach_opening=float(grasps.approach_opening[i]),
        contacts=tuple(map(tuple, grasps.contacts[i].tolist())),
        normals=tuple(map(tuple, grasps.normals[i].tolist())),
        force=float(grasps.force[i]),
    )


def _across(part_from_hand: Array, width: float, approach_opening: float) -> GraspUse:
    """A grasp across the part's origin, of ``width`` [m] there."""
    closing = part_from_hand[:3, 0]
    return GraspUse(
        part_from_hand=matrix(part_from_hand),
        opening=width,
        approach_opening=approach_opening,
        contacts=tuple(tuple(side * width / 2.0 * closing) for side in (-1.0, 1.0)),
        normals=tuple(tuple(side * closing) for side in (-1.0, 1.0)),
        force=100.0,
    )
