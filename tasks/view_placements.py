"""A page that shows the stable placements of a part, each on a plate of its own."""

from __future__ import annotations

import html
from math import ceil, degrees, sqrt
from pathlib import Path

import numpy as np
import trimesh

from ..grasping.part import Part
from ..regrasp.placements import Placements
from ..transforms import Array, compose
from .page import Command, group, material, mesh_geometry, point_geometry, write_page

_GREY, _DARK = 0x9AA4AD, 0x222222
_PLATES = (0x1F77B4, 0xFF7F0E, 0x2CA02C, 0xD62728, 0x9467BD, 0x8C564B, 0xE377C2, 0xBCBD22, 0x17BECF, 0x7F7F7F)
_SMALLEST_PART = 1e-3  # m
_THICK = 0.02  # of a plate, over its side


def write_placement_page(path: str | Path, part: Part, placements: Placements) -> None:
    """Write an HTML page with each placement on a plate, its support polygon and the line of its weight."""
    side = 2.2 * float(np.abs(placements.outline.points).max(initial=_SMALLEST_PART))
    columns = max(1, ceil(sqrt(len(placements))))
    plate = trimesh.creation.box([0.92 * side, 0.92 * side, _THICK * side])
    under = compose(np.eye(3), [0.0, 0.0, -0.5 * _THICK * side])
    body, slab = (mesh_geometry(mesh.vertices, mesh.faces) for mesh in (part.mesh, plate))
    skin, ink = material(_GREY, opacity=0.6), material(_DARK, kind="LineBasicMaterial")
    commands = []
    for i, surface_from_part in enumerate(placements.surface_from_part):
        row, column = divmod(i, columns)
        place = compose(np.eye(3), [(column - (columns - 1) / 2.0) * side, -row * side, 0.0])
        lines = point_geometry(_lines(placements, i, 1e-3 * side))
        items = [
            ("Mesh", slab, material(_PLATES[i % len(_PLATES)]), place @ under),
            ("LineSegments", lines, ink, place),
            ("Mesh", body, skin, place @ surface_from_part),
        ]
        commands.append(group(f"placement{i}", items))
    title = html.escape(f"Placements of {part.name}")
    write_page(path, title, f"<h1>{title}</h1>{_table(placements)}", commands + _stage(side, len(placements), columns))


def _lines(placements: Placements, which: int, lift: float) -> Array:
    """Ends (2 k, 3), two by two, of the support polygon's edges, a little above the plate, and of the weight's line."""
    flat = placements.support[which]
    corners = np.column_stack([flat, np.full(len(flat), lift)])
    edges = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1).reshape(-1, 3)
    return np.vstack([edges, [0.0, 0.0, 0.0], [0.0, 0.0, placements.height[which]]])


def _stage(side: float, count: int, columns: int) -> list[Command]:
    """The plates in the middle of a plain white scene, seen from the front and above."""
    rows = max(1, ceil(count / columns))
    middle = compose(np.eye(3), [0.0, 0.5 * (rows - 1) * side, 0.0])
    far = 0.6 * side * (max(rows, columns) + 1)
    settings = [
        ("/Cameras/default/rotated/<object>", "position", [0.3 * far, 0.7 * far, far]),
        ("/Grid", "visible", False),
        ("/Axes", "visible", False),
        ("/Background", "top_color", [1.0, 1.0, 1.0]),
        ("/Background", "bottom_color", [0.85, 0.87, 0.9]),
    ]
    moved: list[Command] = [{"type": "set_transform", "path": "/meshcat", "matrix": middle.T.ravel().tolist()}]
    return moved + [{"type": "set_property", "path": p, "property": k, "value": v} for p, k, v in settings]


def _table(placements: Placements) -> str:
    numbers = zip(placements.margin, placements.height, placements.support.area, placements.share, strict=True)
    rows = "".join(
        f'<tr><td><label><input type="checkbox" data-path="placement{i}" checked>'
        f' <b style="color:#{_PLATES[i % len(_PLATES)]:06x}">&#9632;</b> {i + 1}</label></td>'
        f"<td>{degrees(margin):.1f}</td><td>{height * 1e3:.1f}</td>"
        f"<td>{area * 1e6:.0f}</td><td>{share * 100:.1f}</td></tr>"
        for i, (margin, height, area, share) in enumerate(numbers)
    )
    heads = "<tr><th>placement</th><th>margin deg</th><th>height mm</th><th>base mm2</th><th>share %</th></tr>"
    return f"<table>{heads}{rows}</table>"
