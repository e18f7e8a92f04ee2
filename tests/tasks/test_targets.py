"""Where goals allow a part to be: turns about an axis, and areas, in which it rests with its whole outline inside."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial import ConvexHull

from kumitate.errors import InputError, NoRegraspError
from kumitate.regrasp.reach import Node, Reacher
from kumitate.robots.state import Attachment, Contact, SceneState
from kumitate.tasks.cell import build_cell
from kumitate.tasks.deadline import Deadline
from kumitate.tasks.job import Job
from kumitate.tasks.targets import hold_nodes, lies_in, place_nodes, turned
from kumitate.tasks.task import Area, At, HandOver, Place
from kumitate.tasks.task_file import task_of
from kumitate.transforms import invert, pose, pose_distance, transform_points

TABLE = -0.05  # m, the height of its top
ON_STEM = pose([0.0, 0.0, 0.035], [np.pi, 0.0, 0.3])  # of the cap, which lies there upside down
UP = (0.0, 0.0, -2.0)  # of the cap, when the stem below it stands
CORNERS = ((0.52, -0.3), (0.28, -0.05))
COARSE = {"t_rnn": 0.02, "n_da": 4}
angles = st.floats(-np.pi, np.pi)
places = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
axes = places.filter(lambda axis: np.linalg.norm(axis) > 0.1)


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A table with a pallet across it; on the table a stem, and beside it the cap that goes on it."""
    folder = tmp_path_factory.mktemp("mushroom")
    trimesh.creation.box([0.04, 0.04, 0.06]).export(folder / "stem.stl")
    trimesh.creation.box([0.08, 0.10, 0.01]).export(folder / "cap.stl")
    part = {"unit": "m", "mass": 0.1, "grasps": COARSE}
    task = {
        "robot": "nextage",
        "hands": {"left": "robotiq_2f85"},
        "cell": [
            {"name": "table", "box": [0.3, 1.32, 0.02], "at": {"xyz": [0.4, 0.0, -0.06]}, "support": True},
            {
                "name": "pallet",
                "box": [0.2, 0.16, 0.04],
                "at": {"xyz": [0.4, 0.45, -0.03], "rpy": [0.0, 0.0, 0.5]},
                "support": True,
            },
        ],
        "parts": {
            "stem": {**part, "mesh": "stem.stl", "at": {"xyz": [0.4, 0.25, TABLE + 0.03]}},
            "cap": {**part, "mesh": "cap.stl", "at": {"xyz": [0.4, 0.1, TABLE + 0.005]}},
        },
        "goals": [{"place": {"part": "stem", "area": {"on": "table"}}}],
    }
    return build_cell(task_of(task), folder)


@pytest.fixture
def job(cell):
    """A job once the cap is on the stem."""
    job = Job(cell, 0, Deadline(600.0))
    state = job.motions.state
    standing = {name: at for name, at in state.poses.items() if name != "cap"}
    contacts = tuple(contact for contact in state.contacts if "cap" not in (contact.first, contact.second))
    mated = Contact("stem", "cap", [0.0, 0.0, 1.0])
    attached = {"cap": Attachment("stem", ON_STEM)}
    job.motions.state = SceneState(state.q, dict(state.openings), standing, attached, (*contacts, mated))
    return job


def at(job: Job, node: Node) -> SceneState:
    """The job's state with the stem, and all that is on it, at ``node``."""
    return Reacher(job.cell.scene, job.motions.state, "stem", {}).state_at(node)


def corners(job: Job, state: SceneState) -> np.ndarray:
    """All corners (n, 3) of stem and cap in the world."""
    return np.concatenate(
        [
            transform_points(job.cell.scene.world_from_body(state, name), job.cell.parts[name].mesh.vertices)
            for name in ("stem", "cap")
        ]
    )


# Turns ----------------------------------------------------------------------------------------------------------------


@settings(max_examples=50, deadline=None)
@given(places, st.tuples(angles, angles, angles), axes)
def test_turns_are_even_ones_about_the_axis_through_the_origin(xyz, rpy, axis):
    found = turned(At(xyz, rpy), axis)
    np.testing.assert_allclose(found[0], pose(xyz, rpy), atol=1e-12)
    assert len(found) > 4
    np.testing.assert_allclose(found[:, :3, 3], np.tile(xyz, (len(found), 1)), atol=1e-12)
    along = found[:, :3, :3] @ axis  # keeps its direction, while each step turns by as much
    np.testing.assert_allclose(along, np.tile(along[0], (len(found), 1)), atol=1e-9)
    steps = [pose_distance(a, b)[1] for a, b in pairwise([*found, found[0]])]
    np.testing.assert_allclose(steps, 2.0 * np.pi / len(found), atol=1e-6)
    all_round = sum(invert(found[0])[:3, :3] @ found[:, :3, :3])
    direction = np.array(axis) / np.linalg.norm(axis)
    np.testing.assert_allclose(all_round / len(found), np.outer(direction, direction), atol=1e-9)


def test_without_an_axis_there_is_one_pose():
    found = turned(At((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)), None)
    np.testing.assert_allclose(found, [pose([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])])


def test_what_is_assembled_stands_at_every_turn_of_the_part_that_the_goal_names(job):
    wanted = At((0.4, -0.1, TABLE + 0.065), (np.pi, 0.0, 0.0))
    nodes = place_nodes(job, Place("cap", wanted, any_turn=(0.0, 0.0, 1.0)))
    assert len(nodes) == len({node.name for node in nodes}) == len(turned(wanted, (0.0, 0.0, 1.0)))
    for node, cap in zip(nodes, turned(wanted, (0.0, 0.0, 1.0)), strict=True):
        state = at(job, node)
        assert (node.support, node.to_leave) == ("table", True)
        np.testing.assert_allclose(job.cell.scene.world_from_body(state, "cap"), cap, atol=1e-12)
        assert job.cell.scene.touching(state) == ()
    (alone,) = place_nodes(job, Place("cap", wanted))
    np.testing.assert_allclose(alone.world_from_part, nodes[0].world_from_part, atol=1e-12)


def test_a_part_is_held_at_every_turn(job):
    wanted = At((0.4, 0.1, 0.3), (0.3, 0.2, 0.1))
    nodes = hold_nodes(job, HandOver("cap", "left", wanted, any_turn=(1.0, 0.0, 0.0)))
    caps = [job.cell.scene.world_from_body(at(job, node), "cap") for node in nodes]
    np.testing.assert_allclose(caps, turned(wanted, (1.0, 0.0, 0.0)), atol=1e-12)
    assert {(node.support, node.to_leave) for node in nodes} == {(None, False)}


def test_what_is_assembled_may_stand_on_any_of_its_parts(job):
    """On its cap, the stem in the air; and the cap in the air, the stem on the pallet."""
    on_cap = place_nodes(job, Place("stem", At((0.4, -0.1, TABLE + 0.04), (np.pi, 0.0, 0.0))))
    on_stem = place_nodes(job, Place("cap", At((0.4, 0.45, TABLE + 0.105), (np.pi, 0.0, 0.5))))
    assert [node.support for node in (*on_cap, *on_stem)] == ["table", "pallet"]
    for node in (*on_cap, *on_stem):
        assert job.cell.scene.touching(at(job, node)) == ()


def test_nothing_below_a_pose_is_refused(job):
    with pytest.raises(InputError, match="nothing is below it there"):
        place_nodes(job, Place("cap", At((0.4, -0.1, TABLE + 0.07), (np.pi, 0.0, 0.0))))


def test_what_is_no_support_carries_nothing(job):
    """As the verifier has it, too."""
    cell = job.cell
    others = tuple(replace(entry, support=False) for entry in cell.task.cell)
    job.cell = dataclasses.replace(cell, task=replace(cell.task, cell=others))
    with pytest.raises(InputError, match="table below it is no support; add support: true"):
        place_nodes(job, Place("cap", At((0.4, -0.1, TABLE + 0.065), (np.pi, 0.0, 0.0))))


# Areas ----------------------------------------------------------------------------------------------------------------


@pytest.fixture(params=["corners", "whole top", "pallet"])
def area(request) -> Area:
    return {
        "corners": Area("table", CORNERS, UP),
        "whole top": Area("table", None, UP),
        "pallet": Area("pallet"),
    }[request.param]


def rectangle(cell, area: Area) -> tuple[np.ndarray, np.ndarray]:
    """The middle's pose (4, 4) and the sides (2,) of an area."""
    if area.corners is not None:
        low, high = np.min(area.corners, axis=0), np.max(area.corners, axis=0)
        return pose([*(low + high) / 2.0, TABLE]), high - low
    entry = next(entry for entry in cell.task.cell if entry.name == area.on)
    return pose(entry.at.xyz, entry.at.rpy) @ pose([0.0, 0.0, entry.box[2] / 2.0]), np.array(entry.box[:2])


def test_in_an_area_it_rests_stably_with_its_whole_outline_inside(job, area):
    middle, size = rectangle(job.cell, area)
    nodes = place_nodes(job, Place("cap", area=area))
    assert len({node.name for node in nodes}) == len(nodes) > 4
    for node in nodes:
        state = at(job, node)
        assert node.support == area.on
        assert job.cell.scene.touching(state) == ()
        points = transform_points(invert(middle), corners(job, state))
        assert points[:, 2].min() == pytest.approx(0.0, abs=1e-9)
        assert (np.abs(points[:, :2]) <= size / 2.0 + 1e-9).all()
        weight = transform_points(invert(middle) @ node.world_from_part, job.whole("stem").part.center_of_mass[None])
        sides = ConvexHull(points[points[:, 2] < 1e-6, :2]).equations
        assert (weight[0, :2] @ sides[:, :2].T + sides[:, 2] < -1e-3).all()
        if area.up is not None:
            up = job.cell.scene.world_from_body(state, "cap")[:3, :3] @ area.up
            assert up / np.linalg.norm(area.up) == pytest.approx([0.0, 0.0, 1.0], abs=np.radians(1.0))


def test_where_it_stands_tells_whether_it_lies_in_the_area(job, area):
    """As the nodes say; but not once it is moved across a side by a tenth of a millimetre."""
    middle, size = rectangle(job.cell, area)
    for node in place_nodes(job, Place("cap", area=area)):
        job.motions.state = state = at(job, node)
        assert lies_in(job, "cap", area)
        assert lies_in(job, "stem", Area(area.on, area.corners))
        points = transform_points(invert(middle), corners(job, state))[:, :2]
        for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
            room = size[axis] / 2.0 - (sign * points[:, axis]).max()
            for beyond in (-1e-4, 1e-4):
                way = np.zeros(3)
                way[axis] = sign * (room + beyond)
                moved = pose(middle[:3, :3] @ way) @ node.world_from_part
                job.motions.state = state.with_pose("stem", moved)
                assert lies_in(job, "cap", area) == (beyond < 0.0)
        job.motions.state = state


def test_it_does_not_lie_in_an_area_of_another_support_nor_in_another_way_nor_in_a_hand(job):
    on_pallet = place_nodes(job, Place("cap", area=Area("pallet", up=UP)))[0]
    job.motions.state = at(job, on_pallet)
    assert lies_in(job, "cap", Area("pallet", up=UP))
    assert not lies_in(job, "cap", Area("pallet", up=(0.0, 0.0, 1.0)))
    x, y = on_pallet.world_from_part[:2, 3]
    around = ((x - 0.1, y - 0.1), (x + 0.1, y + 0.1))
    assert not lies_in(job, "cap", Area("table", around, UP))
    job.motions.state = job.cell.scene.attach(job.motions.state, "stem", "left")
    assert not lies_in(job, "cap", Area("pallet", up=UP))


def test_a_rectangle_beyond_the_top_is_refused(job):
    with pytest.raises(InputError, match="40 mm beyond the top of table"):
        place_nodes(job, Place("cap", area=Area("table", ((0.4, -0.2), (0.59, 0.0)))))
    middle = np.array([0.4, 0.45])
    half = 0.08  # inside the pallet's sides, were it not turned
    with pytest.raises(InputError, match="beyond the top of pallet"):
        place_nodes(job, Place("cap", area=Area("pallet", (tuple(middle - half), tuple(middle + half)))))


@pytest.mark.parametrize(
    ("area", "words"),
    [
        (Area("table", ((0.4, -0.2), (0.48, -0.12))), "no room"),  # for the cap, which is longer
        (Area("table", CORNERS, (0.0, 1.0, 1.0)), "does not rest stably with that direction up"),
    ],
)
def test_an_area_in_which_it_cannot_rest_is_told(job, area, words):
    with pytest.raises(NoRegraspError, match=words):
        place_nodes(job, Place("cap", area=area))


def test_what_stands_in_an_area_already_takes_its_room(cell):
    """Around the cap, which still lies beside the stem, there is no room for it; as far away there is."""
    job = Job(cell, 0, Deadline(600.0))
    upright = (0.0, 0.0, 1.0)
    assert place_nodes(job, Place("stem", area=Area("table", ((0.35, -0.17), (0.45, -0.03)), upright)))
    with pytest.raises(NoRegraspError, match="no room"):
        place_nodes(job, Place("stem", area=Area("table", ((0.35, 0.03), (0.45, 0.17)), upright)))
