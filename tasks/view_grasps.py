"""A page that shows how grasps came about: facets, contacts, pairs and hands, as the paper's figures do."""

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

_MOST_HANDS = 24  # a spread of the best; more hide each other
_APART = 0.3  # how far facets are drawn apart, as a share of the part's diagonal
_HAND = 0.35  # m; how far the camera stands back to see hands too
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
    commands = [group(name, items) for name, _, _, items in layers] + _stage(part)
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
    skin = material(color, opacity=0.5)
    poses = grasps.part_from_hand[:, None] @ hand.hand_from_piece(grasps.opening)
    return [("Mesh", piece, skin, pose) for row in poses for piece, pose in zip(pieces, row, strict=True)]


def _stage(part: Part) -> list[Command]:
    """The part in the middle of a plain white scene, seen from the front, above and right."""
    centered = np.eye(4)
    centered[:3, 3] = -part.mesh.bounds.mean(axis=0)
    far = 1.2 * _diagonal(part) + _HAND
    settings = [
        ("/Cameras/default/rotated/<object>", "position", [0.55 * far, 0.55 * far, 0.65 * far]),
        ("/Grid", "visible", False),
        ("/Axes", "visible", False),
        ("/Background", "top_color", [1.0, 1.0, 1.0]),
        ("/Background", "bottom_color", [0.85, 0.87, 0.9]),
    ]
    moved: list[Command] = [{"type": "set_transform", "path": "/meshcat", "matrix": centered.T.ravel().tolist()}]
    return moved + [{"type": "set_property", "path": p, "property": k, "value": v} for p, k, v in settings]


def _diagonal(part: Part) -> float:
    return float(np.linalg.norm(part.mesh.extents))


def _table(record: tuple[Stage, ...]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(stage.name)}</td><td>{stage.taken}</td><td>{stage.kept}</td>"
        f"<td>{stage.seconds * 1e3:.0f}</td>"
        f"<td>{html.escape(', '.join(f'{n} {reason}' for reason, n in stage.dropped.items() if n))}</td></tr>"
        for stage in record
    )
    return f"<table><tr><th>stage</th><th>taken</th><th>kept</th><th>ms</th><th>dropped</th></tr>{rows}</table>"
