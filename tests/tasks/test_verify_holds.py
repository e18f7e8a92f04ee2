"""Who carries what, and whether hands really hold what they take."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from edits import kinds, taking, with_part
from msgspec.structs import replace
from plans import sample_plan, short_plan

from kumitate.tasks.document import Mesh, Plan
from kumitate.tasks.verify_cell import read_cell
from kumitate.tasks.verify_faults import Fault, Findings
from kumitate.tasks.verify_holds import Hold, Stretch, follow
from kumitate.tasks.verify_motion import Curve
from kumitate.transforms import pose

CUP = "suction_cup", (0.04, 0.04, 0.03), 0.015
THREE = "hrp5p_three_finger", (0.03, 0.1, 0.1), 0.03


def with_block(plan: Plan, size: tuple[float, float, float]) -> Plan:
    return replace(plan, meshes={**plan.meshes, "block": Mesh.of(trimesh.creation.box(size))})


def faults(plan: Plan) -> tuple[Fault, ...]:
    """What is found following events and carriers alone."""
    findings = Findings()
    cell = read_cell(plan, findings)
    follow(plan, cell, [Curve.of(action, cell) for action in plan.actions], findings)
    return findings.faults


def names(plan: Plan) -> set[str]:
    return {fault.name for fault in faults(plan)}


@pytest.mark.parametrize(
    ("plan", "size", "found"),
    [
        (CUP, (0.04, 0.04, 0.03), False),
        (CUP, (0.04, 0.02, 0.03), False),  # the lip, of 16 mm, has 2 mm to spare on both sides
        (CUP, (0.04, 0.008, 0.03), True),
        (CUP, (0.04, 0.04, 0.027), True),
        (THREE, (0.03, 0.1, 0.1), False),
        (THREE, (0.03, 0.03, 0.1), True),
        (THREE, (0.026, 0.1, 0.1), True),
    ],
)
def test_pads_and_lips_lie_on_the_part(plan, size, found):
    assert ("pads" in names(with_block(short_plan(*plan), size))) is found


def test_one_finger_of_a_pair_may_hang_as_far_as_the_task_says():
    """A block that is 2 mm lower under one finger of the pair."""
    plan = short_plan(*THREE)
    block = plan.meshes["block"].trimesh()
    hand = np.array(plan.actions[taking(plan)[0]].grasp.part_from_hand)
    pair_side, lateral = hand[:3, 0], hand[:3, 1]
    fine = block.subdivide_to_size(0.006)
    lower = (fine.vertices @ lateral > 0.005) & (fine.vertices @ pair_side > 0.0149)
    fine.vertices[lower] -= 2e-3 * pair_side
    spoiled = replace(plan, meshes={**plan.meshes, "block": Mesh.of(fine)})
    assert "pads" not in names(spoiled)
    assert "pads" in names(with_part(spoiled, "block", grasps={"t_dct": 0.001}))


@pytest.mark.parametrize("plan", [(), CUP, THREE])
def test_hands_keep_out_of_regions_that_none_may_touch(plan):
    """A pad or a lip beside a region, and in it; it may reach in as far as it may be off its grasp."""
    made = short_plan(*plan)
    action = made.actions[taking(made)[0]]
    contact, normal = (np.array(rows[0]) for rows in (action.grasp.contacts, action.grasp.normals))
    for reach, found in ((-0.2e-3, False), (0.05e-3, False), (0.3e-3, True)):
        middle = contact + (reach - 0.002) * normal
        region = {"box": (0.004 * np.abs(normal) + 0.01 * (1.0 - np.abs(normal))).tolist()}
        beside = with_part(made, "block", no_touch=[{**region, "at": {"xyz": middle.tolist()}}])
        assert ("no-touch" in names(beside)) is found


def test_no_piece_of_a_hand_is_in_a_region_that_none_may_touch():
    """All around the block, and in the palm, where no surface of the hand is."""
    plan = short_plan()
    palm = np.array(plan.actions[taking(plan)[0]].grasp.part_from_hand) @ pose([0.0, 0.0, -0.1])
    for region in (
        {"box": [0.5, 0.5, 0.5]},
        {"box": [1e-3, 1e-3, 1e-3], "at": {"xyz": palm[:3, 3].tolist()}},
    ):
        (fault,) = faults(with_part(plan, "block", no_touch=[region]))
        assert fault.name == "no-touch"
        assert fault.bodies == ("block", "left")


def test_regions_that_none_may_touch_go_with_the_part():
    """The right hand takes the block in the air, where it lies."""
    plan = sample_plan()
    second = kinds(plan, "close")[1]
    contact = plan.actions[second].grasp.contacts[0]
    region = {"box": [0.004, 0.004, 0.004], "at": {"xyz": list(contact)}}
    (fault,) = faults(with_part(plan, "block", no_touch=[region]))
    assert (fault.name, fault.action, fault.bodies) == ("no-touch", second, ("block", "right"))


def test_carriers_are_followed_to_the_arm_that_moves():
    holds = {
        "tray": (Hold("left", pose([0.0, 0.0, 0.1])),),
        "cup": (Hold("tray", pose([0.0, 0.2, 0.0])),),
        "lid": (Hold("right", pose()), Hold("cup", pose([0.3, 0.0, 0.0]))),
        "stone": (),
    }
    stretch = Stretch(0, 0.0, 1.0, holds, {"stone": pose([1.0, 1.0, 1.0])})
    flanges = {"left": np.stack([pose(), pose([1.0, 0.0, 0.0])]), "right": np.stack([pose()] * 2)}
    poses = stretch.poses(flanges)
    np.testing.assert_allclose(poses["lid"][:, :3, 3], [[0.3, 0.2, 0.1], [1.3, 0.2, 0.1]])
    np.testing.assert_allclose(poses["stone"][:, :3, 3], [[1.0, 1.0, 1.0]])
    assert stretch.carriers == dict.fromkeys(("tray", "cup", "lid"), "left")
    assert stretch.root("stone") == "stone"
    assert stretch.assembly("cup") == {"tray", "cup", "lid"}
    assert stretch.hands(stretch.assembly("tray")) == ("left", "right")
    assert stretch.hands(stretch.assembly("stone")) == ()


def test_an_assembly_that_a_hand_and_a_support_hold_stays():
    """The tube stands while the hand still holds the peg in it: the tube was never taken."""
    plan = sample_plan()
    actions = list(plan.actions)
    for i in kinds(plan, "close"):
        if actions[i].part == "tube":
            actions[i] = replace(actions[i], events=())
    insert = kinds(plan, "insert")[0]
    opened = actions[insert + 1]
    late = replace(opened.events[0], time=actions[insert + 2].motion.duration)
    actions[insert + 1] = replace(opened, events=())
    actions[insert + 2] = replace(actions[insert + 2], events=(late,), kind="open")
    found = faults(replace(plan, actions=tuple(actions)))
    assert ("two-hands", insert + 2) in {(fault.name, fault.action) for fault in found}
