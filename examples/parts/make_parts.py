"""Make the parts of the examples, all in millimetres.

The wheel and its support take their proportions from the toy of the paper. Run this to write the STL files anew; it
needs manifold3d, which comes with the development tools.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from trimesh.transformations import rotation_matrix

WHEEL_PROFILE = [  # radius and y, round the section
    (8, 0),  # hub
    (10, 0),
    (10, 7),  # disc
    (28, 7),
    (28, 0),  # rim
    (30, 0),
    (30, 30),
    (20, 30),
    (20, 10),
    (8, 10),
]
SECTIONS = 72  # of everything round


def wheel() -> trimesh.Trimesh:
    """A wheel about the y axis from y = 0, where its hub is, to y = 30 mm; its bore is 16 mm wide."""
    profile = np.array([*WHEEL_PROFILE, WHEEL_PROFILE[0]], dtype=float)
    mesh = trimesh.creation.revolve(profile, sections=SECTIONS)  # about z
    return mesh.apply_transform(rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0]))


def support() -> trimesh.Trimesh:
    """A housing on four feet, symmetric in y: a tube on its roof, an axle of 14 mm to either side at z = 10 mm."""
    solid = [box([-15, -30, 0], [15, 30, 52]), cylinder(8.5, [-5, 0, 50], [-5, 0, 102])]
    room = [
        box([-13, -28, -1], [13, 28, 50]),
        cylinder(6.5, [-5, 0, 49], [-5, 0, 103]),
        box([-16, -18, -1], [16, 18, 25]),  # the arch
        cylinder(18.0, [-16, 0, 25], [16, 0, 25]),
    ]
    axles = [cylinder(7.0, [0, 29 * side, 10], [0, 44 * side, 10]) for side in (-1, 1)]
    axles += [cylinder(6.5, [0, 43 * side, 10], [0, 61 * side, 10]) for side in (-1, 1)]
    hollow = trimesh.boolean.difference([trimesh.boolean.union(solid), *room])
    return trimesh.boolean.union([hollow, *axles])


def fastener() -> trimesh.Trimesh:
    """A vacuum fastener tool along z, which draws a bolt's head to the ring at its tip, at z = 165 mm."""
    body = prism(chamfered(34, 34, 3), 0, 128)
    solid = [body, cone(17.0, 9.0, 127, 137), cylinder(5.0, [0, 0, 134], [0, 0, 165])]
    return trimesh.boolean.difference([trimesh.boolean.union(solid), cylinder(2.5, [0, 0, 155], [0, 0, 166])])


def bolt_plate() -> trimesh.Trimesh:
    """A block with a row of three hexagon bolts, half screwed in: their heads end at z = 40 mm, 10 mm across."""
    bolts = [bolt(x) for x in (-40, 0, 40)]
    return trimesh.boolean.union([prism(chamfered(140, 60, 4), 0, 28), *bolts])


def bolt(x: float) -> trimesh.Trimesh:
    """A bolt at ``x``, from inside the block up."""
    head = trimesh.creation.cylinder(10.0 / np.sqrt(3.0), height=4.0, sections=6).apply_translation([x, 0, 38])
    return trimesh.boolean.union([cylinder(3.0, [x, 0, 20], [x, 0, 37]), head])


def drill() -> trimesh.Trimesh:
    """A cordless driver that stands on its battery; its chuck points along x, its straight handle is 120 mm high."""
    battery = prism(chamfered(100, 76, 6), 0, 36)
    handle = prism(chamfered(44, 44, 4), 35, 157)
    body = prism(chamfered(64, 60, 14), -50, 40, along="x")
    chuck = [cone(21.0, 12.0, 40, 66, along="x"), cylinder(4.0, [60, 0, 0], [80, 0, 0])]
    head = trimesh.boolean.union([body, *chuck]).apply_translation([0, 0, 188])
    return trimesh.boolean.union([battery, handle, head])


def channel() -> trimesh.Trimesh:
    """A channel of sheet metal along x that stands on its flanges, its face at z = 25 mm, with a hole near one end."""
    sheet = 1.6
    outside = prism(arch(56, 0, 25, 3), -40, 40, along="x")
    inside = prism(arch(56 - 2 * sheet, -1, 25 - sheet, 3 - sheet), -41, 41, along="x")
    return trimesh.boolean.difference([outside, inside, cylinder(4.0, [30, 0, 20], [30, 0, 26])])


def block() -> trimesh.Trimesh:
    """A block that stands on z = 0, 50 mm high; a step on its top tells its ways up and its ends apart."""
    return trimesh.boolean.difference([box([-30, -20, 0], [30, 20, 50]), box([12, -21, 34], [31, 21, 51])])


def peg() -> trimesh.Trimesh:
    """A stepped peg of 24 and 16 mm that stands on z = 0, 60 mm high."""
    return trimesh.boolean.union([cylinder(12.0, [0, 0, 0], [0, 0, 42]), cylinder(8.0, [0, 0, 41], [0, 0, 60])])


def ring() -> trimesh.Trimesh:
    """A bush of 40 mm with a bore of 24 mm that stands on z = 0, 40 mm high."""
    return trimesh.boolean.difference([cylinder(20.0, [0, 0, 0], [0, 0, 40]), cylinder(12.0, [0, 0, -1], [0, 0, 41])])


def bar() -> trimesh.Trimesh:
    """A bar along y, 140 mm long, that lies on z = 0, with two holes."""
    solid = box([-12, -70, 0], [12, 70, 24])
    return trimesh.boolean.difference([solid, *(cylinder(5.0, [0, y, -1], [0, y, 25]) for y in (-50, 50))])


def tray() -> trimesh.Trimesh:
    """A tray with a pocket each for a block, two pegs and two rings, and two posts that carry a bar over the rings.

    Pockets are 6 mm deep and leave 3 mm around what lies in them; so does the notch of each post.
    """
    pockets = {(58, 0): (46, 66), (-50, 36): (30, 30), (-50, -36): (30, 30), (0, 26): (46, 46), (0, -26): (46, 46)}
    rooms = [box([x - a / 2, y - b / 2, 4], [x + a / 2, y + b / 2, 11]) for (x, y), (a, b) in pockets.items()]
    posts = [box([-19, min(y), 0], [19, max(y), 54]) for y in ((56, 73), (-73, -56))]
    notch = box([-15, -74, 50], [15, 74, 55])
    slab = box([-76, -80, 0], [92, 80, 10])
    return trimesh.boolean.difference([trimesh.boolean.union([slab, *posts]), *rooms, notch])


def base() -> trimesh.Trimesh:
    """A hollow body on z = 0 with an axle of 12 mm to either side at z = 26 mm, and a tenon on top for a cover."""
    hollow = trimesh.boolean.difference([box([-18, -30, 0], [18, 30, 52]), box([-15, -27, -1], [15, 27, 46])])
    axles = [cylinder(6.0, [0, 28 * side, 26], [0, 57 * side, 26]) for side in (-1, 1)]
    return trimesh.boolean.union([hollow, box([-12, -24, 51], [12, 24, 68]), *axles])


def small_wheel() -> trimesh.Trimesh:
    """A wheel about the y axis from y = 0 to y = 24 mm, where it is recessed; its bore is 14 mm wide."""
    profile = [(7, 0), (19, 0), (20, 1), (20, 23), (19, 24), (17, 24), (17, 18), (11, 18), (11, 24), (7, 24), (7, 0)]
    mesh = trimesh.creation.revolve(np.array(profile, dtype=float), sections=SECTIONS)
    return mesh.apply_transform(rotation_matrix(-np.pi / 2.0, [1.0, 0.0, 0.0]))


def cover() -> trimesh.Trimesh:
    """A cap over the tenon of the base, with a millimetre of play; its rim is at z = 0, its top at z = 22 mm."""
    return trimesh.boolean.difference([box([-16, -28, 0], [16, 28, 22]), box([-13, -25, -1], [13, 25, 17])])


def chamfered(x: float, y: float, chamfer: float) -> list[list[float]]:
    """Corners of a rectangle of sides x and y about the origin, its corners cut off."""
    a, b = x / 2.0, y / 2.0
    quarter = [[a, b - chamfer], [a - chamfer, b]]
    turned = [[-a + chamfer, b], [-a, b - chamfer]]
    return [*quarter, *turned, *([-u, -v] for u, v in (*quarter, *turned))]


def arch(width: float, low: float, high: float, radius: float) -> list[list[float]]:
    """Corners (height, across) of a rectangle whose two upper corners are rounded."""
    edge, turns = width / 2.0, np.linspace(0.0, np.pi / 2.0, 7)
    bend = [[high - radius * (1.0 - np.sin(t)), edge - radius * (1.0 - np.cos(t))] for t in turns]
    return [[low, edge], *bend, *([z, -y] for z, y in reversed(bend)), [low, -edge]]


def prism(outline: list[list[float]], low: float, high: float, along: str = "z") -> trimesh.Trimesh:
    """A prism over a convex outline, along z; or along x, the outline's x and y along z and y."""
    flat = np.array(outline, dtype=float)
    corners = np.vstack([np.column_stack([flat, np.full(len(flat), z)]) for z in (low, high)])
    if along == "x":
        corners = corners[:, ::-1]
    return trimesh.convex.convex_hull(corners)


def cone(radius: float, end: float, low: float, high: float, along: str = "z") -> trimesh.Trimesh:
    """A frustum along z or x, ``radius`` wide at ``low`` and ``end`` wide at ``high``."""
    angles = 2.0 * np.pi * np.arange(SECTIONS) / SECTIONS
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    corners = np.vstack([np.column_stack([r * circle, np.full(SECTIONS, z)]) for r, z in ((radius, low), (end, high))])
    return trimesh.convex.convex_hull(corners[:, ::-1] if along == "x" else corners)


def box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    """A box between two corners [mm]."""
    return trimesh.creation.box(bounds=[low, high])


def cylinder(radius: float, start: list[float], end: list[float]) -> trimesh.Trimesh:
    """A cylinder between the middles of its ends [mm]."""
    return trimesh.creation.cylinder(radius, segment=np.array([start, end], dtype=float), sections=SECTIONS)


def write(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write a binary STL; triangles in an order that depends on the shape alone."""
    triangles = np.round(mesh.triangles, 4) + 0.0
    first = [np.lexsort(corners.T[::-1])[0] for corners in triangles]
    turned = np.array([np.roll(corners, -k, axis=0) for corners, k in zip(triangles, first, strict=True)])
    ordered = turned[np.lexsort(turned.reshape(-1, 9).T[::-1])]
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(ordered), process=False).export(path)


PARTS = (wheel, support, fastener, bolt_plate, drill, channel, block, peg, ring, bar, tray, base, small_wheel, cover)

if __name__ == "__main__":
    folder = Path(__file__).parent
    for make in PARTS:
        write(make(), folder / f"{make.__name__}.stl")
