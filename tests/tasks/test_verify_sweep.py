"""Nothing that touches on the way is missed, and nothing else is told, against a second opinion at dense samples."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from plans import TASK, short_plan
from reference import Reference

from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body
from kumitate.tasks.document import Action, Mesh, Motion, Plan
from kumitate.tasks.verify import verify
from kumitate.transforms import Array, pose

ROUNDING = 5e-5  # m that cylinders are wider here than there
SPECK = [0.006, 0.02, 0.004]


def with_obstacles(plan: Plan, obstacles: dict[str, tuple[list[float], Array]], actions: tuple[Action, ...]) -> Plan:
    cell, meshes = list(plan.task["cell"]), dict(plan.meshes)
    for name, (box, where) in obstacles.items():
        cell.append({"name": name, "box": box, "at": {"xyz": where[:3, 3].tolist()}})
        meshes[name] = Mesh.of(trimesh.creation.box(box))
    return replace(plan, task={**plan.task, "cell": cell}, meshes=meshes, actions=actions)


@pytest.fixture(scope="module")
def transit() -> Action:
    return short_plan().actions[0]


def collisions(plan: Plan):
    return [fault for fault in verify(plan).faults if fault.name == "collision"]


def test_specks_around_a_motion_are_hit_as_dense_samples_say(transit, rng):
    robot = load_robot("nextage", TASK["hands"])
    curve = _dense(transit.motion, 150)
    specks = {}
    for k in range(10):
        hand = robot.hand_pose("left", curve[rng.integers(30, 150)], 0.085)
        specks[f"speck{k}"] = pose((hand @ pose(rng.uniform([-0.09, -0.09, -0.15], [0.09, 0.09, 0.03])))[:3, 3])
    scene = Scene.of(robot, [Body.box(name, SPECK, fixed=True) for name in specks])
    other, state = Reference(scene), scene.state(specks)
    hit = set().union(*(pair for q in curve for pair in other.touching(state, q)))
    for name, where in specks.items():
        faults = collisions(with_obstacles(short_plan(), {name: (SPECK, where)}, (transit,)))
        assert faults or name not in hit
        for fault in faults:
            assert name in fault.bodies
            assert other.distance(state, _at(transit.motion, fault.time), *fault.bodies) <= ROUNDING
    assert 3 <= len(hit & set(specks)) <= 9


def test_a_foil_between_two_samples_is_hit(transit):
    """A foil of 10 um, thinner than any step, where only the knots of the motion are off it."""
    robot = load_robot("nextage", TASK["hands"])
    middle = _dense(transit.motion, 3)[1]
    hand = robot.hand_pose("left", middle, 0.085)
    foil = ([0.05, 0.05, 1e-5], pose(hand[:3, 3]))
    (fault,) = collisions(with_obstacles(short_plan(), {"foil": foil}, (transit,)))
    assert "foil" in fault.bodies


def test_a_joint_that_turns_back_between_samples_is_followed(transit):
    """A motion of one segment, out and back, with the same joints at both ends."""
    start, end = transit.motion.positions[0], transit.motion.positions[-1]
    out = np.array(end) - np.array(start)
    rates = tuple((4.0 * out / 10.0).tolist())
    motion = Motion(
        times=(0.0, 10.0),
        positions=(start, start),
        velocities=(rates, tuple(-x for x in rates)),
        openings=dict.fromkeys(TASK["hands"], (0.085, 0.085)),
        opening_velocities=dict.fromkeys(TASK["hands"], (0.0, 0.0)),
    )
    there = load_robot("nextage", TASK["hands"]).hand_pose("left", np.array(_at(motion, 5.0)), 0.085)
    action = replace(transit, motion=motion, end=transit.start)
    plan = with_obstacles(short_plan(), {"speck": ([0.002] * 3, pose(there[:3, 3]))}, (action,))
    assert not collisions(replace(plan, actions=(replace(transit, end=transit.start, motion=_still(motion)),)))
    between_the_pads = with_obstacles(short_plan(), {"bar": ([0.002, 0.2, 0.002], pose(there[:3, 3]))}, (action,))
    (fault,) = collisions(between_the_pads)
    assert 0.5 < fault.time < 9.5
    assert "bar" in fault.bodies


def test_bodies_that_rest_are_looked_at_once():
    """However often the same cell is at rest."""
    plan = short_plan()
    still = replace(plan.actions[0], motion=_still(plan.actions[0].motion), end=plan.actions[0].start)
    once, often = (verify(replace(plan, actions=(still,) * count)) for count in (1, 5))
    assert once.distances == often.distances == 0
    assert often.samples > once.samples


def _still(motion: Motion) -> Motion:
    return Motion(
        times=(0.0, 1.0),
        positions=motion.positions[:1] * 2,
        velocities=((0.0,) * len(motion.positions[0]),) * 2,
        openings={arm: row[:1] * 2 for arm, row in motion.openings.items()},
        opening_velocities=dict.fromkeys(motion.openings, (0.0, 0.0)),
    )


def _at(motion: Motion, time: float) -> Array:
    from scipy.interpolate import CubicHermiteSpline

    return CubicHermiteSpline(motion.times, motion.positions, motion.velocities)(time)


def _dense(motion: Motion, count: int) -> Array:
    return _at(motion, np.linspace(0.0, motion.duration, count))
