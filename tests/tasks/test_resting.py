"""Parts at the start: they rest on something, by themselves, or it is told by how much they do not."""

from __future__ import annotations

import re
from math import radians

import numpy as np
import pytest
import trimesh

from kumitate.errors import InputError
from kumitate.grasping.part import Part
from kumitate.robots.library import load_robot
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body
from kumitate.tasks.resting import resting_contacts
from kumitate.transforms import pose, rotation_from_rpy

BLOCK = [0.04, 0.03, 0.02]


@pytest.fixture(scope="module")
def robot():
    return load_robot("nextage")


@pytest.fixture
def contacts(robot):
    """Contacts of parts, by name a mesh and a pose, on a table of 0.4 by 0.4 m whose top is at z = 0."""

    def find(table=None, **placed):
        parts = {name: Part.from_mesh(mesh, mass=0.1, name=name) for name, (mesh, _) in placed.items()}
        bodies = [Body.from_mesh(name, part.mesh) for name, part in parts.items()]
        scene = Scene.of(robot, [Body.box("table", [0.4, 0.4, 0.02], fixed=True), *bodies])
        poses = {"table": pose([0, 0, -0.01]) if table is None else table}
        state = scene.state({**poses, **{name: at for name, (_, at) in placed.items()}})
        return [(c.first, c.second, c.normal.round(9).tolist()) for c in resting_contacts(scene, state, parts)]

    return find


def block(size=BLOCK):
    return trimesh.creation.box(size)


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
@pytest.mark.parametrize(("rpy", "height"), [((0, 0), 0.01), ((90, 0), 0.015), ((0, 90), 0.02), ((180, 0), 0.01)])
def test_a_block_rests_on_each_of_its_sides(contacts, rpy, height, turn):
    at = pose([0.1, 0.05, height], [*np.radians(rpy), turn])
    assert contacts(block=(block(), at)) == [("table", "block", [0, 0, 1])]


def test_the_normal_points_up_in_the_frame_of_what_carries(contacts):
    table = pose([0, 0, -0.01], [np.pi, 0, 0])
    assert contacts(table, block=(block(), pose([0, 0, 0.01]))) == [("table", "block", [0, 0, -1])]


@pytest.mark.parametrize("off", [-4e-4, -1e-4, 0.0, 1e-4, 4e-4])
def test_half_a_millimetre_too_high_or_too_low_is_resting(contacts, off):
    assert len(contacts(block=(block(), pose([0, 0, 0.01 + off])))) == 1


@pytest.mark.parametrize("off", [-0.019, -0.012, -2e-3, -7e-4, 7e-4, 1e-3, 3.2e-3, 0.1])
def test_the_height_that_is_told_is_the_right_one(contacts, off):
    with pytest.raises(InputError, match=r"^parts\.block\.at: ") as caught:
        contacts(block=(block(), pose([0, 0, 0.01 + off])))
    assert f"{abs(off) * 1e3:.2f} mm" in caught.value.problem
    assert ("floats" if off > 0 else "overlaps table") in caught.value.problem
    z = float(re.search(r"z = (-?[\d.]+) m", caught.value.cure)[1])
    assert z == pytest.approx(0.01, abs=2e-5)
    assert contacts(block=(block(), pose([0, 0, z])))


def test_nothing_below_and_something_around_are_told(contacts):
    with pytest.raises(InputError, match="nothing is below"):
        contacts(block=(block(), pose([1.0, 0, 0.01])))
    with pytest.raises(InputError, match="overlaps table; put it elsewhere"):
        contacts(block=(block([0.04, 0.03, 0.2]), pose([0, 0, 0])))


@pytest.mark.parametrize("tilt", [0.0, 0.5, 0.99])
def test_up_to_a_degree_of_tilt_is_resting(contacts, tilt):
    lowest = 0.01 * np.cos(radians(tilt)) + 0.02 * np.sin(radians(tilt))
    assert len(contacts(block=(block(), pose([0, 0, lowest], [0, radians(tilt), 0.4])))) == 1


@pytest.mark.parametrize("rpy", [(0, 20, 0), (12, 0, 0), (100, 3, 50), (2, 2, 2), (0, -70, 0), (180, 10, 0)])
def test_the_turn_that_is_told_is_the_nearest_stable_one(contacts, rpy):
    given = rotation_from_rpy(np.radians(rpy))
    with pytest.raises(InputError, match="would topple: it is tilted by") as caught:
        contacts(block=(block(), pose([0, 0, 0.03], np.radians(rpy))))
    told = np.radians([float(angle) for angle in re.findall(r"(-?[\d.]+) deg", caught.value.cure)])
    up = rotation_from_rpy(told)[2]
    tilt = float(re.search(r"by ([\d.]+) deg", caught.value.problem)[1])
    assert np.abs(up).max() == pytest.approx(1.0, abs=1e-6)  # a side of the block is down
    turned = np.degrees(np.arccos((np.trace(rotation_from_rpy(told) @ given.T) - 1.0) / 2.0))
    assert turned == pytest.approx(tilt, abs=0.06)
    assert tilt == pytest.approx(np.degrees(np.arccos(np.abs(given[2]).max())), abs=0.06)


def test_what_rolls_has_no_place_to_be(contacts):
    with pytest.raises(InputError, match="no stable placement"):
        contacts(ball=(trimesh.creation.icosphere(3, 0.02), pose([0, 0, 0.02])))
    lying = pose([0, 0, 0.02], [np.pi / 2, 0, 0])
    with pytest.raises(InputError, match=r"tilted by 90\.0 deg"):
        contacts(rod=(trimesh.creation.cylinder(0.02, 0.1, sections=64), lying))


def test_parts_rest_on_parts(contacts):
    found = contacts(
        low=(block(), pose([0, 0, 0.01])),
        middle=(block(), pose([0.005, 0, 0.03])),
        high=(block(), pose([0.01, 0, 0.05], [0, 0, 1.0])),
    )
    assert [pair[:2] for pair in found] == [("table", "low"), ("low", "middle"), ("middle", "high")]


def test_a_bridge_rests_on_both_of_its_piers(contacts):
    piers = {f"pier{i}": (block(), pose([x, 0, 0.01])) for i, x in enumerate((-0.05, 0.05))}
    found = contacts(**piers, bridge=(block([0.14, 0.03, 0.01]), pose([0, 0, 0.025])))
    assert [pair[:2] for pair in found[2:]] == [("pier0", "bridge"), ("pier1", "bridge")]


@pytest.mark.parametrize(("beyond", "stays"), [(-0.015, True), (-0.005, True), (0.002, False), (0.015, False)])
def test_a_part_over_the_edge_stays_while_its_centre_does_not_pass_it(contacts, beyond, stays):
    # A long block, 20 mm high: 5 deg from toppling, its centre of mass is 0.9 mm inside the edge.
    at = pose([0.2 + beyond, 0, 0.01], [0, 0, 0.0])
    long = block([0.08, 0.03, 0.02])
    if stays:
        assert len(contacts(long=(long, at))) == 1
    else:
        with pytest.raises(InputError, match="would topple off table") as caught:
            contacts(long=(long, at))
        outside = float(re.search(r"lies ([\d.]+) mm outside", caught.value.problem)[1])
        assert outside == pytest.approx(beyond * 1e3, abs=0.08e3 / 30 + 0.1)


def test_a_part_over_the_edge_that_is_propped_up_stays(contacts):
    long = block([0.08, 0.03, 0.02])
    prop = (block([0.02, 0.03, 0.02]), pose([0.03, 0, -0.01]))
    table = pose([-0.2, 0, -0.01])
    with pytest.raises(InputError, match="would topple off table"):
        contacts(table, long=(long, pose([0.01, 0, 0.01])))
    scene = {"long": (long, pose([0.01, 0, 0.01])), "prop": prop}
    with pytest.raises(InputError, match=r"^parts\.prop\.at: it floats"):
        contacts(table, **scene)


def test_legs_bear_only_where_they_stand(contacts):
    legs = [trimesh.creation.box(bounds=[[x, y, 0], [x + 0.01, y + 0.01, 0.03]]) for x in (0, 0.05) for y in (0, 0.05)]
    stool = trimesh.util.concatenate([*legs, trimesh.creation.box(bounds=[[0, 0, 0.03], [0.06, 0.06, 0.04]])])
    assert len(contacts(stool=(stool, pose([0, 0, 0])))) == 1
    # Two of its legs on the table, two beyond its edge.
    with pytest.raises(InputError, match="would topple off table"):
        contacts(stool=(stool, pose([0.165, 0, 0])))
