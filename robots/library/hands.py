"""The shipped hands. Base frame: z out of the flange, x the closing direction; finger links keep its axes when open."""

from __future__ import annotations

import math
from typing import Any

from .urdf import ALONG_Y, Joint, Link, Robot, Shape, bar, box, cylinder, span

Description = dict[str, Any]
# A finger on side s stands at s * x of the grasp centre and closes towards s * -x.
LEFT, RIGHT = -1.0, 1.0


def _block(x: tuple[float, float], width: float, z: tuple[float, float], colour: str) -> Shape:
    """A box between two values of x and of z, ``width`` wide about y = 0."""
    return span((x[0], -width / 2, z[0]), (x[1], width / 2, z[1]), colour)


def _facing(side: float) -> tuple[float, float, float]:
    """Rpy of a pad frame: its x axis is the outward normal of the pad's face, its z axis points to the fingertip."""
    return (0.0, 0.0, math.pi if side > 0 else 0.0)


def robotiq_2f85() -> tuple[Robot, Description]:
    """The Robotiq 2F-85 as what it is: two parallelograms, whose inner fingers translate without turning.

    Outer knuckle pivot A, inner knuckle pivot B; links A-C and B-D stay parallel and carry the inner finger at C and D.
    """
    source = (
        "Robotiq 2F-85: linkage, stroke and outlines as in Robotiq's drawings and the published models of the gripper"
    )
    hand = Robot("robotiq_2f85", source)
    hand.links.append(
        Link(
            "base",
            [
                cylinder((0, 0, 0.006), 0.0375, 0.012, "dark"),
                cylinder((0, 0, 0.028), 0.0355, 0.032, "black"),
                box((0, 0, 0.053), (0.085, 0.050, 0.026), "black"),
                box((0, 0, 0.075), (0.036, 0.0245, 0.030), "dark"),
            ],
        )
    )
    pivot_a, pivot_b = (0.030601, 0.054905), (0.0127, 0.06142)
    crank = (0.0376, 0.04304)
    pad_inside, pad_low, pad_high, pad_thick, pad_width = 0.0078, 0.0070, 0.0445, 0.00635, 0.022
    closed = math.acos((pad_inside - pivot_b[0]) / math.hypot(*crank)) - math.atan2(crank[1], crank[0])
    speed = 0.05
    rate = speed / math.hypot(*crank)
    driver = "finger_joint"

    for s, name in ((LEFT, "left"), (RIGHT, "right")):
        axis = (0.0, -s, 0.0)
        knuckle_end = (s * 0.0315, -0.0041)
        link = (s * crank[0], crank[1])  # from A to C and from B to D
        hand.add(
            Joint(
                driver if s == LEFT else "right_outer_knuckle_joint",
                "base",
                f"{name}_outer_finger",
                (s * pivot_a[0], 0, pivot_a[1]),
                axis=axis,
                mimic=None if s == LEFT else (driver, 1.0),
                limits=(0.0, closed),
                velocity=rate,
            ),
            bar((0.0, 0.0), knuckle_end, 0.015, (-0.012, 0.012), "dark"),
            cylinder((0, 0, 0), 0.0075, 0.024, "dark", ALONG_Y),
            cylinder((knuckle_end[0], 0, knuckle_end[1]), 0.006, 0.027, "black", ALONG_Y),
            bar(knuckle_end, link, 0.012, (-0.0135, 0.0135), "black"),
            cylinder((link[0], 0, link[1]), 0.006, 0.027, "grey", ALONG_Y),
        )
        fork, web = 0.016, 0.55
        half = (web * link[0], web * link[1])
        hand.add(
            Joint(
                f"{name}_inner_knuckle_joint",
                "base",
                f"{name}_inner_knuckle",
                (s * pivot_b[0], 0, pivot_b[1]),
                axis=axis,
                mimic=(driver, 1.0),
                limits=(0.0, closed),
                velocity=rate,
            ),
            *(bar((0.0, 0.0), half, 0.012, (y - 0.0035, y + 0.0035), "dark") for y in (-fork, fork)),
            *(cylinder((0, y, 0), 0.006, 0.007, "grey", ALONG_Y) for y in (-fork, fork)),
            bar(half, link, 0.012, (-0.0195, 0.0195), "dark"),
            cylinder((link[0], 0, link[1]), 0.006, 0.039, "grey", ALONG_Y),
        )
        pad_back = pad_thick - pad_inside
        hand.add(
            Joint(
                f"{name}_inner_finger_joint",
                f"{name}_inner_knuckle",
                f"{name}_inner_finger",
                (link[0], 0, link[1]),
                axis=axis,
                mimic=(driver, -1.0),
                limits=(-closed, 0.0),
                velocity=rate,
            ),
            _block((s * -0.006, s * 0.0239), 0.015, (-0.0125, 0.006), "black"),
            _block((s * pad_back, s * 0.009), 0.015, (0.006, 0.038), "black"),
            _block((s * -pad_inside, s * pad_back), pad_width, (pad_low, pad_high), "rubber"),
        )
        centre = (s * -pad_inside, 0, (pad_low + pad_high) / 2)
        hand.add(Joint(f"{name}_pad_joint", f"{name}_inner_finger", f"{name}_pad", centre, _facing(s)))

    pads = [{"link": f"{name}_pad", "size": [pad_width, pad_high - pad_low]} for name in ("left", "right")]
    description = {
        "name": hand.name,
        "kind": "two_finger",
        "urdf": f"{hand.name}.urdf",
        "driver": {"joint": driver, "open": 0.0, "closed": round(closed, 12)},
        "stroke": [0.0, 0.085],
        "contact_depth": 0.014,
        "pads": pads,
        "grip_force": 100.0,
        "friction": 0.5,
        "speed": speed,
        "source": source,
        "assumed": ["grip_force", "friction", "speed"],
    }
    return hand, description


def hrp5p_three_finger() -> tuple[Robot, Description]:
    """One finger against two; the fingers stay straight and turn about pivots in the palm.

    A face along the finger would be parallel to its partner only when fully open, and at every other opening the tips
    would meet the part before the face does. So the pads are wedges, parallel at 30 mm: on what is flat and 14 to 47 mm
    wide the whole face stands to within 1.5 mm.
    """
    source = (
        "HRP-5P concept hand: palm, pivots, fingers and stroke law as in the published planner model (102.7 mm to the "
        "palm's face, 172.7 mm to the grasp centre when open); the pair is set at 30 mm and 22 mm wide so that another "
        "hand's finger fits between; the planner takes the fingertips for parallel jaws though the fingers turn, so "
        "the pads are wedges, parallel at 30 mm, and the fingers end with them, 10 mm short of the published outline"
    )
    hand = Robot("hrp5p_three_finger", source)
    palm_face, pivot, face, width = 0.1027, (0.047, 0.0962), 0.006, 0.022
    contact = 0.1727 - pivot[1]
    pad_length, parallel_at = 0.024, 0.030
    stroke = round(2 * (pivot[0] - face), 9)

    def angle(opening: float) -> float:
        """How far a finger has turned: pivot - face cos q - contact sin q is half the opening."""
        return math.asin((pivot[0] - opening / 2) / math.hypot(face, contact)) - math.atan2(face, contact)

    closed, tilt = angle(0.0), angle(parallel_at)

    def behind_face(side: float, depth: float, thickness: float, colour: str) -> Shape:
        """A layer of the pad whose middle lies ``depth`` behind its face."""
        along, back = (side * math.sin(tilt), math.cos(tilt)), (side * math.cos(tilt), -math.sin(tilt))
        middle = (side * -face + depth * back[0], contact + depth * back[1])
        low, high = ((middle[0] + h * along[0], middle[1] + h * along[1]) for h in (-pad_length / 2, pad_length / 2))
        return bar(low, high, thickness, (-width / 2, width / 2), colour)

    hand.links.append(
        Link(
            "base",
            [
                cylinder((0, 0, 0.010), 0.040, 0.020, "dark"),
                box((0, 0, 0.055), (0.090, 0.096, 0.070), "silver"),
                span((-0.053, -0.050, 0.080), (0.053, 0.050, 0.098), "grey"),
                span((-0.036, -0.042, 0.098), (0.036, 0.042, palm_face), "dark"),
            ],
        )
    )
    speed = 0.05
    driver = "thumb_joint"
    for s, name, y in ((LEFT, "thumb", 0.0), (RIGHT, "finger_a", 0.030), (RIGHT, "finger_b", -0.030)):
        hand.add(
            Joint(
                f"{name}_joint",
                "base",
                name,
                (s * pivot[0], y, pivot[1]),
                axis=(0.0, -s, 0.0),
                limits=(0.0, closed),
                velocity=speed / math.hypot(face, contact),
                mimic=None if name == "thumb" else (driver, 1.0),
            ),
            cylinder((0, 0, 0), 0.008, width, "grey", ALONG_Y),
            _block((s * -0.005, s * 0.014), width, (0.0, 0.042), "silver"),
            cylinder((s * 0.003, 0, 0.046), 0.0075, width, "grey", ALONG_Y),
            _block((s * -0.005, s * 0.010), width, (0.050, 0.064), "silver"),
            behind_face(s, 0.008, 0.008, "silver"),
            behind_face(s, 0.002, 0.004, "rubber"),
        )
        frame = (0.0, -tilt, _facing(s)[2])
        hand.add(Joint(f"{name}_pad_joint", name, f"{name}_pad", (s * -face, 0, contact), frame))

    pads = [{"link": f"{name}_pad", "size": [width, pad_length]} for name in ("thumb", "finger_a", "finger_b")]
    description = {
        "name": hand.name,
        "kind": "three_finger",
        "urdf": f"{hand.name}.urdf",
        "driver": {"joint": driver, "open": 0.0, "closed": round(closed, 12)},
        "stroke": [0.0, stroke],
        "contact_depth": pad_length / 2,
        "pads": pads,
        "grip_force": 100.0,
        "friction": 0.5,
        "speed": speed,
        "source": source,
        "assumed": ["grip_force", "friction", "speed", "finger spacing and width", "pads"],
    }
    return hand, description


def suction_cup() -> tuple[Robot, Description]:
    """A slim cup with a bellows; it is drawn unpressed, so its geometry ends at the plane of the lip."""
    source = (
        "a common cup of 16 mm diameter at 60 kPa below the ambient pressure; shape and figures chosen, not measured"
    )
    hand = Robot("suction_cup", source)
    radius, length = 0.008, 0.100
    folds = [
        cylinder((0, 0, length - 0.002 - 0.004 * i), radius if i % 2 == 0 else 0.006, 0.004, "orange") for i in range(4)
    ]
    hand.links.append(
        Link(
            "base",
            [
                cylinder((0, 0, 0.004), 0.025, 0.008, "silver"),
                cylinder((0, 0, 0.028), 0.011, 0.040, "dark"),
                box((0.013, 0, 0.040), (0.016, 0.010, 0.010), "grey"),
                cylinder((0, 0, 0.059), 0.005, 0.022, "silver"),
                cylinder((0, 0, 0.077), 0.0075, 0.014, "grey"),
                *folds,
            ],
        )
    )
    hand.add(Joint("lip_joint", "base", "lip", (0.0, 0.0, length)))
    description = {
        "name": hand.name,
        "kind": "suction",
        "urdf": f"{hand.name}.urdf",
        "lip": {"link": "lip", "radius": radius, "compliance": 0.001},
        "vacuum_force": 12.0,
        "friction": 0.5,
        "source": source,
        "assumed": ["lip", "vacuum_force", "friction"],
    }
    return hand, description
