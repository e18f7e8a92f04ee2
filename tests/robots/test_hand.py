"""Hands: openings, pads and grasp centres, and what wrong files get."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from kumitate.errors import InputError, UnknownNameError
from kumitate.robots import library
from kumitate.robots.hand import Hand
from kumitate.robots.library import load_hand

FINGERS = ["robotiq_2f85", "hrp5p_three_finger"]
FOLDER = Path(library.__file__).parent


@pytest.mark.parametrize("name", FINGERS)
def test_opening_is_the_distance_of_the_contact_points_along_the_closing_direction(name, rng):
    hand = load_hand(name)
    openings = np.concatenate([rng.uniform(*hand.stroke, 20), hand.stroke])
    pads = hand.hand_from_pad(openings)
    heights = np.array([[0.0, 0.0, pad.size[1] / 2 - hand.contact_depth, 1.0] for pad in hand.pads])
    contacts = np.einsum("npij,pj->npi", pads, heights)[..., :3]
    others = contacts[:, 1:].mean(axis=1)
    np.testing.assert_allclose(others[:, 0] - contacts[:, 0, 0], openings, atol=2e-7)
    np.testing.assert_allclose((others + contacts[:, 0]) / 2, 0.0, atol=2e-7)


@pytest.mark.parametrize("name", FINGERS)
def test_pads_face_each_other_across_the_grasp_centre(name):
    pads = load_hand(name).hand_from_pad([0.030])[0]
    assert pads[0, 0, 3] < 0 < pads[1, 0, 3]
    np.testing.assert_allclose(pads[0, :3, 0], [1, 0, 0], atol=1e-5)
    np.testing.assert_allclose(pads[1:, :3, 0], [[-1, 0, 0]] * (len(pads) - 1), atol=1e-5)


def test_pads_of_turning_fingers_lean_least_in_the_middle_of_the_stroke():
    """The published fingers turn by asin((82 mm - opening) / 149 mm); the wedges take away what they turn to 30 mm."""
    openings = np.array([0.082, 0.047, 0.030, 0.014, 0.0])
    pads = load_hand("hrp5p_three_finger").hand_from_pad(openings)
    lean = np.arcsin(pads[:, 0, 2, 0])
    published = np.arcsin((0.082 - openings) / 0.149)
    np.testing.assert_allclose(lean, published[2] - published, atol=np.radians(0.8))
    np.testing.assert_allclose(pads[:, 1:, 2, 0], np.sin(lean)[:, None] * [1, 1], atol=1e-9)
    assert np.all(np.sin(np.abs(lean[1:4])) * 0.012 <= 1.5e-3)


def test_pads_of_the_parallelogram_stay_parallel_and_advance():
    hand = load_hand("robotiq_2f85")
    openings = np.array([0.085, 0.06, 0.04, 0.02, 0.0])
    pads = hand.hand_from_pad(openings)
    np.testing.assert_allclose(pads[:, 0, :3, :3], np.broadcast_to(pads[0, 0, :3, :3], (5, 3, 3)), atol=1e-9)
    heights = 1e3 * hand.base_from_hand(openings)[:, 2, 3]
    np.testing.assert_allclose(heights, [135.0, 143.3, 147.0, 148.8, 148.9], atol=0.06)


@pytest.mark.parametrize("name", FINGERS)
def test_pieces_stand_where_pinocchio_puts_them(name, rng):
    hand = load_hand(name)
    model = pin.buildModelFromUrdf(str(FOLDER / f"{name}.urdf"))
    data = model.createData()
    openings = rng.uniform(*hand.stroke, 5)
    poses = hand.base_from_piece(openings)
    for joints, placed in zip(hand.joint_positions(openings), poses, strict=True):
        pin.forwardKinematics(model, data, joints)
        for piece, pose in zip(hand.pieces, placed, strict=True):
            np.testing.assert_allclose(pose, data.oMi[piece.joint].homogeneous, atol=1e-12)


def test_a_cup_has_its_hand_frame_at_the_lip():
    cup = load_hand("suction_cup")
    assert cup.kind == "suction"
    assert cup.lip is not None
    frame = cup.base_from_hand([0.0])[0]
    np.testing.assert_allclose(frame[:3, :3], np.eye(3), atol=1e-9)
    assert frame[2, 3] == pytest.approx(cup.pieces[0].mesh.bounds[1, 2], abs=1e-6)


def test_an_opening_outside_the_stroke_is_refused():
    with pytest.raises(InputError, match="outside the stroke"):
        load_hand("robotiq_2f85").base_from_hand([0.09])


def test_an_unknown_hand_is_answered_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="robotiq_2f85"):
        load_hand("robotiq_2f86")


def changed(tmp_path: Path, old: str, new: str) -> Path:
    text = (FOLDER / "robotiq_2f85.yaml").read_text()
    assert old in text
    (tmp_path / "robotiq_2f85.urdf").write_text((FOLDER / "robotiq_2f85.urdf").read_text())
    path = tmp_path / "hand.yaml"
    path.write_text(text.replace(old, new))
    return path


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: two_finger", "kind: four_finger", "four_finger"),
        ("kind: two_finger", "kind: suction", "lip"),
        ("kind: two_finger", "kind: three_finger", "give 3"),
        ("friction: 0.5", "friction: much", "friction"),
        ("friction: 0.5", "friction: -0.5", "friction"),
        ("friction: 0.5", "grippiness: 0.5", "grippiness"),
        ("left_pad", "left_pat", "left_pat"),
        ("finger_joint", "finger_joind", "finger_joind|not driven"),
        ("robotiq_2f85.urdf", "other.urdf", "does not exist"),
        ("contact_depth: 0.014", "contact_depth: [", "no valid YAML"),
        ("[0.0, 0.085]", "[0.0, 0.2]", "stroke"),
    ],
)
def test_what_is_wrong_in_a_hand_file_is_named(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        Hand.load(changed(tmp_path, old, new))


def test_errors_of_fields_name_the_line(tmp_path):
    path = changed(tmp_path, "friction: 0.5", "friction: much")
    line = 1 + path.read_text().splitlines().index("friction: much")
    with pytest.raises(InputError, match=f"hand.yaml:{line}: friction"):
        Hand.load(path)


def test_aliases_in_a_hand_file_are_refused(tmp_path):
    path = tmp_path / "hand.yaml"
    path.write_text("a: &x [1, 2]\nb: *x\n")
    with pytest.raises(InputError, match="aliases"):
        Hand.load(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[0.0, 0.085]", "[-0.0005, 0.085]", "stroke"),
        ("[0.0, 0.085]", "[0.085, 0.01]", "stroke"),
        ("[0.0, 0.085]", "[.nan, 0.085]", "stroke"),
        ("friction: 0.5", "friction: .inf", "friction"),
        ("friction: 0.5", "friction: 0.5\nvacuum_force: 10.0", "vacuum_force: given, but kind is two_finger"),
        ("contact_depth: 0.014", "contact_depth: 14", "contact_depth.*beyond the pads"),
        ("right_pad", "left_pad", "does not grow"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_figures_that_fit_no_hand_are_refused(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        Hand.load(changed(tmp_path, old, new))


def slides(tmp_path: Path, low: float, high: float) -> Hand:
    """A gripper of two sliding fingers that meet at the driver's 0, the second driven with an offset of its own."""

    def finger(name: str, sign: int, mimic: str) -> str:
        turn = "0 0 0" if sign < 0 else "0 0 3.141592653589793"
        return (
            f'<link name="{name}"><collision><geometry><box size="0.01 0.02 0.04"/></geometry></collision></link>'
            f'<link name="{name}_pad"/><joint name="{name}_face" type="fixed"><parent link="{name}"/>'
            f'<child link="{name}_pad"/><origin xyz="{-0.005 * sign} 0 0" rpy="{turn}"/></joint>'
            f'<joint name="{name}_slide" type="prismatic"><parent link="base"/><child link="{name}"/>'
            f'<origin xyz="{0.005 * sign} 0 0.1"/><axis xyz="{sign} 0 0"/>'
            f'<limit lower="0" upper="0.1" velocity="1" effort="1"/>{mimic}</joint>'
        )

    mimic = '<mimic joint="one_slide" multiplier="0.5" offset="0.01"/>'
    box = '<collision><geometry><box size="0.1 0.02 0.02"/></geometry></collision>'
    text = f'<robot name="g"><link name="base">{box}</link>{finger("one", -1, "")}{finger("two", 1, mimic)}</robot>'
    (tmp_path / "g.urdf").write_text(text)
    (tmp_path / "g.yaml").write_text(
        "name: g\nkind: two_finger\nurdf: g.urdf\nfriction: 0.5\nsource: made up\ngrip_force: 10.0\nspeed: 0.1\n"
        f"driver: {{joint: one_slide, open: 0.04, closed: 0.0}}\nstroke: [{low}, {high}]\ncontact_depth: 0.01\n"
        "pads: [{link: one_pad, size: [0.02, 0.04]}, {link: two_pad, size: [0.02, 0.04]}]\n"
    )
    return Hand.load(tmp_path / "g.yaml")


def test_sliding_fingers_and_offsets_of_mimics(tmp_path):
    # Open by d for the first finger, d / 2 + 10 mm for the second.
    hand = slides(tmp_path, 0.01, 0.07)
    np.testing.assert_allclose(
        hand.joint_positions([0.01, 0.04, 0.07]), [[0, 0.01], [0.02, 0.02], [0.04, 0.03]], atol=1e-9
    )
    np.testing.assert_allclose(
        hand.base_from_hand([0.01, 0.07])[:, :3, 3], [[0.005, 0, 0.11], [-0.005, 0, 0.11]], atol=1e-9
    )
    with pytest.raises(InputError, match=r"the fingers reach 0\.0100 to 0\.0700"):
        slides(tmp_path, 0.0, 0.07)
