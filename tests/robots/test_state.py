"""Laws of bodies, contacts, margins and states."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots.state import Attachment, Body, Contact, Margins, SceneState
from kumitate.transforms import pose


def test_bodies_are_the_shapes_they_are_made_of(make_mesh):
    mesh = make_mesh("bracket", 0.1, 0.01, 0.05)
    assert np.isclose(Body.from_mesh("bracket", mesh).mesh.volume, mesh.volume)
    assert np.isclose(Body.box("box", (0.1, 0.2, 0.3)).mesh.volume, 0.006)
    assert Body.box("table", (1.0, 1.0, 0.1), fixed=True).fixed
    assert not Body.from_mesh("ball", trimesh.creation.icosphere()).fixed


@pytest.mark.parametrize("size", [(0.1, 0.1, 0.0), (0.1, -0.1, 0.1), (0.1, 0.1), (0.1, 0.1, np.nan)])
def test_boxes_have_three_sides(size):
    # The broadphase would pass a flat box over in silence.
    with pytest.raises(InputError, match="box plate"):
        Body.box("plate", size)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (0.0, 0.0, 2.0), (np.nan, 0.0, 1.0), (1.0, 0.0), np.eye(3)])
def test_normals_are_unit_vectors(normal):
    with pytest.raises(InputError, match="contact part / table"):
        Contact("part", "table", np.array(normal))


@pytest.mark.parametrize("margin", [-0.001, 1.0, np.nan])
def test_margins_are_distances(margin):
    with pytest.raises(InputError, match=r"margins\.arms"):
        Margins(arms=margin)
    with pytest.raises(InputError, match=r"margins\.environment"):
        Margins(environment=margin)


def test_carriers_are_followed_to_the_arm():
    tilt, shift = pose(rpy=(0.3, 0.0, 0.0)), pose((0.1, 0.2, 0.3))
    standing = SceneState(np.zeros(6), {}, {"a": shift}, {"b": Attachment("a", tilt), "c": Attachment("b", shift)})
    arm, at = standing.carrier("c")
    assert arm == ""
    assert np.allclose(at, shift @ tilt @ shift)
    carried = SceneState(np.zeros(6), {}, {}, {"a": Attachment("left", shift), "b": Attachment("a", tilt)})
    arm, at = carried.carrier("b")
    assert arm == "left"
    assert np.allclose(at, shift @ tilt)
    with pytest.raises(UnknownNameError, match="nut"):
        carried.carrier("nut")


def test_changes_leave_the_state_alone():
    state = SceneState(np.zeros(6), {"left": 0.05}, {"a": np.eye(4)}, {"b": Attachment("a", np.eye(4))})
    q = np.ones(6)
    moved = state.with_q(q)
    q[0] = 5.0
    assert moved.q[0] == 1.0
    assert state.with_opening("left", 0.01).openings == {"left": 0.01}
    placed = state.with_pose("b", pose((1.0, 0.0, 0.0)))
    assert placed.carrier("b")[0] == ""
    assert placed.carrier("b")[1][0, 3] == 1.0
    contact = Contact("a", "b", np.array([0.0, 0.0, 1.0]))
    assert state.with_contacts([contact]).contacts == (contact,)
    assert (state.openings, state.contacts, set(state.attached), state.q.any()) == ({"left": 0.05}, (), {"b"}, False)


def test_configurations_of_states_cannot_be_changed_in_place():
    home = np.zeros(6)
    state = SceneState(home, {}, {})
    home[0] = 1.0
    assert state.q[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        state.q[0] = 1.0


def test_changes_to_what_is_not_there_are_refused():
    state = SceneState(np.zeros(6), {"left": 0.05}, {"a": np.eye(4)}, {"b": Attachment("a", np.eye(4))})
    for change, message in (
        (lambda: state.with_opening("lef", 0.01), "lef"),
        (lambda: state.with_pose("c", np.eye(4)), "no body named 'c'"),
        (lambda: state.with_pose("a", 2.0 * np.eye(4)), "pose of a"),
        (lambda: state.with_pose("a", np.tile(np.eye(4), (2, 1, 1))), "pose of a"),
        (lambda: state.with_q(["home"]), "state: q"),
        (lambda: Contact("a", "a", np.array([0.0, 0.0, 1.0])), "does not touch itself"),
        (lambda: Contact("a", "b", "up"), "no array of numbers"),
        (lambda: Body.box("plate", ["a", 1, 1]), "no array of numbers"),
        (lambda: Body.box("plate", [np.inf, 1, 1]), "box plate"),
        (lambda: Body.from_mesh("empty", trimesh.Trimesh()), "body empty"),
    ):
        with pytest.raises(InputError, match=message):
            change()
    broken = trimesh.creation.box([1.0, 1.0, 1.0])
    vertices = broken.vertices.copy()
    vertices[0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        Body.from_mesh("broken", trimesh.Trimesh(vertices, broken.faces, process=False))
