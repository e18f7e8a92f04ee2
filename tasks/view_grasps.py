"""A page that shows how grasps came about: facets, contacts, pairs and hands (paper, the figures of sections III to V)."""

from __future__ import annotations

import html
from pathlib import Path

import numpy as np

from ..grasping.contacts import sample_contacts
from ..grasping.facets import Facets, segment
from ..grasping.grasps import GraspSet
from ..grasping.pairs import find_pairs
from ..grasping.parameters import GraspParameters
from ..grasping.part import Part
from ..grasping.planner import plan_grasps
from ..grasping.record import Stage
from ..robots.hand import Hand
from ..transforms import Array
from .page import Command, group, material, mesh_geometry, point_geometry, write_page

_MOST_HANDS = 150  # a spread of the best; more hide each other
_APART = 0.04  # how far facets are drawn apart, as a share of the part's diagonal
_WHITE, _RED, _GREY, _BLUE, _GREEN = 0xF4F4F4, 0xD62728, 0x9AA4AD, 0x1F6FEB, 0x2CA02C


def write_grasp_page(path: str | Path, part: Part, hand: Hand, parameters: GraspParameters, grasps: GraspSet) -> None:
    """Write an HTML page with the part, its facets (each its own colour, drawn apart), contacts, pairs and hands.

    Hands that touch the part are planned for the page alone; they are red and hidden until asked for.
    """
    facets = segment(part, parameters.theta_pln, parameters.theta_fct)
    contacts, _ = sample_contacts(part, facets, parameters)
    here = np.eye(4)
    dots = material(_BLUE, kind="PointsMaterial", size=0.008 * _diagonal(part))
    solid = mesh_geometry(part.mesh.vertices, part.mesh.faces)
    layers = [
        ("part", "Part", True, [("Mesh", solid, material(_GREY), here)]),
        ("facets", f"Facets, drawn apart ({len(facets)})", False, _facet_items(part, facets)),
        ("contacts", f"Contacts ({len(contacts)})", False, [("Points", point_geometry(contacts.points), dots, here)]),
    ]
    if hand.pads:
        pairs, _ = find_pairs(part, facets, contacts, parameters)
        lines = material(_GREEN, kind="LineBasicMaterial")
        ends = point_geometry(pairs.points.reshape(-1, 3))
        layers.append(("pairs", f"Contact pairs ({len(pairs)})", False, [("LineSegments", ends, lines, here)]))
    shown = grasps.thin(_MOST_HANDS)
    colliding = plan_grasps(part, hand, parameters, colliding=True).thin(_MOST_HANDS)
    for name, label, checked, which, color in (
        ("kept", f"Hands: {len(shown)} of {len(grasps)} grasps", True, shown, _WHITE),
        ("colliding", f"Hands that touch the part: {len(colliding)}", False, colliding, _RED),
    ):
        layers.append((name, label, checked, _hand_items(hand, which, color)))
    boxes = "".join(
        f'<label><input type="checkbox" data-path="{name}"{" checked" if checked else ""}> {html.escape(label)}</label>'
        for name, label, checked, _ in layers
    )
    title = html.escape(f"{part.name} grasped by {hand.name}")
    commands = [group(name, items) for name, _, _, items in layers] + _camera(part)
    write_page(path, title, f"<h1>{title}</h1>{boxes}{_table(grasps.record)}", commands)


def _facet_items(part: Part, facets: Facets) -> list[tuple[str, Command, Command, Array]]:
    """Each facet in its own colour, moved outward by its own amount so that those that overlap show."""
    rng = np.random.default_rng(0)
    items = []
    for i, share in enumerate(rng.uniform(0.3, 1.0, len(facets))):
        apart = np.eye(4)
        apart[:3, 3] = share * _APART * _diagonal(part) * facets.normal[i]
        red, green, blue = (int(c) for c in rng.integers(40, 230, 3))
        color = material((red << 16) + (green << 8) + blue)
        items.append(("Mesh", mesh_geometry(part.mesh.vertices, part.mesh.faces[facets[i]]), color, apart))
    return items


def _hand_items(hand: Hand, grasps: GraspSet, color: int) -> list[tuple[str, Command, Command, Array]]:
    pieces = [mesh_geometry(piece.mesh.vertices, piece.mesh.faces) for piece in hand.pieces]
    skin = material(color, opacity=0.35)
    poses = grasps.part_from_hand[:, None] @ hand.hand_from_piece(grasps.opening)
    return [("Mesh", piece, skin, pose) for row in poses for piece, pose in zip(pieces, row, strict=True)]


def _camera(part: Part) -> list[Command]:
    """Look at the part from the front, above and right; three.js has y up."""
    x, y, z = part.mesh.bounds.mean(axis=0)
    target = [float(x), float(z), float(-y)]
    far = 2.2 * _diagonal(part)
    eye = [target[0] + 0.7 * far, target[1] + 0.5 * far, target[2] + 0.7 * far]
    hidden = [
        {"type": "set_property", "path": path, "property": "visible", "value": False} for path in ("/Grid", "/Axes")
    ]
    return [
        {"type": "set_target", "value": target},
        {"type": "set_property", "path": "/Cameras/default/rotated/<object>", "property": "position", "value": eye},
        *hidden,
    ]


def _diagonal(part: Part) -> float:
    return float(np.linalg.norm(part.mesh.extents))


def _table(record: tuple[Stage, ...]) -> str:
    rows = "".join(
        f"<tr><td>{stage.name}</td><td>{stage.taken}</td><td>{stage.kept}</td><td>{stage.seconds * 1e3:.0f}</td>"
        f"<td>{html.escape(', '.join(f'{n} {reason}' for reason, n in stage.dropped.items() if n))}</td></tr>"
        for stage in record
    )
    return f"<table><tr><th>stage</th><th>taken</th><th>kept</th><th>ms</th><th>dropped</th></tr>{rows}</table>"
