"""Mesh files: sound, broken and mischievous ones, from the file to the grasps of the part."""

from __future__ import annotations

import gzip
import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from spoil import Rng, nudged, one, spoiled_bytes

from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import FORMATS, UNITS, Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand

SIZES = {"mm": 40.0, "cm": 4.0, "m": 0.04, "in": 1.6}  # in each unit, of a part of 40 mm
COUNT = 5000
_FEW, _SMALL = 2000, 0.2  # faces and m, of parts whose grasps are planned
_COARSE = GraspParameters(t_rnn=8e-3, n_da=2)
_HANDS = {name: load_hand(name) for name in ("robotiq_2f85", "suction_cup", "hrp5p_three_finger")}
_ODD = (np.nan, np.inf, -np.inf, 1e308, -1e300, 1e30, 1e-310, -0.0, 1e6)

Soup = tuple[np.ndarray, np.ndarray]  # vertices (v, 3) and faces (n, 3)


def make(rng: Rng, folder: Path) -> None:
    """Write a mesh file, and how it is to be read."""
    unit = one(rng, tuple(UNITS))
    vertices, faces = _shape(rng, SIZES[unit])
    for _ in range(int(rng.integers(0, 4))):
        vertices, faces = one(rng, _BREAKS)(rng, vertices, faces)
    kind = one(rng, (*FORMATS, "stl", "ascii", "obj"))
    content = _BOMBS[one(rng, tuple(_BOMBS))](rng) if rng.random() < 0.05 else _WRITERS[kind](vertices, faces)
    if rng.random() < 0.4:
        content = spoiled_bytes(rng, content)
    suffix = one(rng, (*FORMATS, "3mf", "zip", "dae", "")) if rng.random() < 0.1 else kind.replace("ascii", "stl")
    given = one(rng, tuple(UNITS)) if rng.random() < 0.05 else unit
    path = folder / f"part.{suffix}"
    path.write_bytes(content)
    needs = {"file": path.name, "unit": given, "mass": 0.05, "hand": one(rng, tuple(_HANDS))}
    (folder / "case.json").write_text(json.dumps(needs))


def feed(folder: Path) -> str:
    """Load the part and plan its grasps."""
    case = json.loads((folder / "case.json").read_text())
    part = Part.load(folder / case["file"], unit=case["unit"], mass=case["mass"])
    low, high = part.mesh.bounds
    if not (np.isfinite(part.mesh.vertices).all() and (low <= part.center_of_mass).all()):
        raise AssertionError("the part is not finite, or its centre of mass lies outside of its bounds")
    if not (part.center_of_mass <= high).all() or len(part.mesh.faces) == 0:
        raise AssertionError("the part is empty, or its centre of mass lies outside of its bounds")
    if len(part.mesh.faces) <= _FEW and np.ptp(part.mesh.vertices, axis=0).max() <= _SMALL:
        plan_grasps(part, _HANDS[case["hand"]], _COARSE)
    return "works"


def _shape(rng: Rng, size: float) -> Soup:
    make: tuple[Callable[[], trimesh.Trimesh], ...] = (
        lambda: trimesh.creation.box(size * rng.uniform(0.1, 1.0, 3)),
        lambda: trimesh.creation.cylinder(size * rng.uniform(0.1, 0.5), size, sections=int(rng.integers(3, 40))),
        lambda: trimesh.creation.icosphere(int(rng.integers(0, 4)), size / 2.0),
        lambda: trimesh.creation.annulus(0.2 * size, 0.5 * size, size, sections=int(rng.integers(3, 40))),
        lambda: trimesh.creation.capsule(size / 2.0, size / 4.0, count=[8, 8]),
        lambda: trimesh.creation.torus(0.4 * size, 0.1 * size, 12, 8),
        lambda: trimesh.util.concatenate(
            [trimesh.creation.box(size * np.array([1.0, 0.2, 0.2])), trimesh.creation.box(size * np.array([0.2, 1, 1]))]
        ),
        lambda: trimesh.Trimesh(size * rng.random((50, 3)), rng.integers(0, 50, (100, 3)), process=False),
    )
    mesh = one(rng, make)()
    return np.array(mesh.vertices), np.array(mesh.faces)


# What is done to vertices and faces -----------------------------------------------------------------------------------


def _odd_numbers(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    vertices = vertices.copy()
    some = rng.integers(0, len(vertices), int(rng.integers(1, 4)))
    vertices[some, rng.integers(0, 3)] = one(rng, _ODD)
    return vertices, faces


def _nudged(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    vertices = vertices.copy()
    i, j = rng.integers(len(vertices)), rng.integers(3)
    vertices[i, j] = nudged(rng, vertices[i, j])
    return vertices, faces


def _scaled(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices * one(
        rng, (1e-9, 1e-3, -1.0, 10.0, 1e3, 1e9, np.array([1.0, 1.0, 0.0]), np.array([1, 1e-6, 1]))
    ), faces


def _far_away(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices + one(rng, (1e3, 1e6, 1e9, 1e15)), faces


def _some_left_out(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices, faces[rng.random(len(faces)) > rng.uniform(0.0, 1.0)]


def _some_turned(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices, np.where(rng.random(len(faces))[:, None] < rng.uniform(0.0, 1.0), faces[:, ::-1], faces)


def _some_doubled(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices, np.concatenate([faces, faces[rng.random(len(faces)) < 0.3]])


def _torn_apart(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    """Every triangle with corners of its own, not quite where they were."""
    corners = vertices[faces].reshape(-1, 3)
    size = np.nanmax(np.abs(vertices), initial=0.0)
    noise = one(rng, (0.0, 1e-8, 1e-6, 1e-4)) * (size if np.isfinite(size) else 1.0)
    return corners + noise * rng.normal(size=corners.shape), np.arange(len(corners)).reshape(-1, 3)


def _through_itself(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    moved = vertices @ np.linalg.qr(rng.normal(size=(3, 3)))[0] * one(rng, (0.3, 1.0, 1.1))
    return np.concatenate([vertices, moved]), np.concatenate([faces, faces + len(vertices)])


def _flat_faces(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    """Slivers along edges, triangles that are points, and fans on one edge."""
    some = faces[rng.integers(0, len(faces), 20)]
    middles = vertices[some[:, :2]].mean(axis=1)
    new = np.arange(len(vertices), len(vertices) + len(some))
    slivers = np.stack([some[:, 0], new, some[:, 1]], axis=1)
    return np.concatenate([vertices, middles]), np.concatenate([faces, slivers, some[:5, [0, 0, 1]], some[:5]])


def _wrong_indices(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    faces = faces.copy()
    faces[rng.integers(len(faces)), rng.integers(3)] = one(rng, (-1, -5, len(vertices), 10**6, 2**31 - 1))
    return vertices, faces


def _only_some(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    return vertices, faces[: int(rng.integers(0, 5))]


def _many_bodies(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
    """The same body over and over, each elsewhere and half of them inside out."""
    copies = min(int(2 ** rng.uniform(1, 10)), 20_000 // max(len(faces), 1) + 1)
    shifts = rng.uniform(-1, 1, (copies, 1, 3)) * np.nan_to_num(np.abs(vertices).max(initial=0.0))
    turned = np.where(rng.random((copies, 1, 1)) < 0.5, faces[:, ::-1], faces)
    return (
        (0.05 * vertices + shifts).reshape(-1, 3),
        (turned + len(vertices) * np.arange(copies)[:, None, None]).reshape(-1, 3),
    )


def _safely(change: Callable[[Rng, np.ndarray, np.ndarray], Soup]) -> Callable[[Rng, np.ndarray, np.ndarray], Soup]:
    """``change`` where there are faces, all of vertices that exist."""

    def changed(rng: Rng, vertices: np.ndarray, faces: np.ndarray) -> Soup:
        usable = len(faces) > 0 and 0 <= faces.min() <= faces.max() < len(vertices)
        with np.errstate(all="ignore"):
            return change(rng, vertices, faces) if usable else (vertices, faces)

    return changed


_BREAKS = tuple(
    _safely(change)
    for change in (
        _odd_numbers,
        _nudged,
        _scaled,
        _far_away,
        _some_left_out,
        _some_turned,
        _some_doubled,
        _torn_apart,
        _through_itself,
        _flat_faces,
        _wrong_indices,
        _only_some,
        _many_bodies,
    )
)

# Writers that write whatever they are given ---------------------------------------------------------------------------


def _corners(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return vertices[np.clip(faces, 0, len(vertices) - 1)]


def _stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    rows = np.zeros(len(faces), dtype=[("numbers", "<f4", (4, 3)), ("attribute", "<u2")])
    with np.errstate(over="ignore"):
        rows["numbers"][:, 1:] = _corners(vertices, faces)
    return b"made to be broken".ljust(80) + struct.pack("<I", len(faces)) + rows.tobytes()


def _ascii_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["solid part"]
    for corners in _corners(vertices, faces).tolist():
        lines += ["facet normal 0 0 0", "outer loop", *(f"vertex {x} {y} {z}" for x, y, z in corners), "endloop"]
        lines += ["endfacet"]
    return "\n".join([*lines, "endsolid part\n"]).encode()


def _obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["mtllib /etc/passwd", *(f"v {x} {y} {z}" for x, y, z in vertices.tolist())]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]
    return "\n".join(lines).encode() + b"\n"


def _ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz")
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [f"{x} {y} {z}" for x, y, z in vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return (head + "\n".join(rows) + "\n").encode()


def _off(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    rows = [f"{x} {y} {z}" for x, y, z in vertices.tolist()] + [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return (f"OFF\n{len(vertices)} {len(faces)} 0\n" + "\n".join(rows) + "\n").encode()


def _glb(vertices: np.ndarray, faces: np.ndarray, nodes: list[dict] | None = None) -> bytes:
    with np.errstate(over="ignore"):
        points = vertices.astype("<f4").tobytes()
    corners = faces.astype("<u4").tobytes()
    low, high = (np.nan_to_num(f(vertices, axis=0, initial=0.0)).tolist() for f in (np.min, np.max))
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes or [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5125, "count": 3 * len(faces), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(corners)},
        ],
        "buffers": [{"byteLength": len(points) + len(corners)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(points + corners), 0x004E4942) + points + corners
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


_WRITERS = {"stl": _stl, "ascii": _ascii_stl, "obj": _obj, "ply": _ply, "off": _off, "glb": _glb}

# Files that claim or hold more than they look like --------------------------------------------------------------------


def _claim(rng: Rng) -> int:
    return int(one(rng, (10**6, 10**8, 2**31, 2**32 - 1)))


def _stl_of_many(rng: Rng) -> bytes:
    return b"".ljust(80) + struct.pack("<I", _claim(rng)) + rng.bytes(500)


def _ply_of_many(rng: Rng) -> bytes:
    kind = one(rng, ("ascii", "binary_little_endian", "binary_big_endian"))
    head = f"ply\nformat {kind} 1.0\nelement vertex {_claim(rng)}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += f"element face {_claim(rng)}\nproperty list {one(rng, ('uchar', 'int'))} int vertex_indices\nend_header\n"
    return head.encode() + rng.bytes(500)


def _off_of_many(rng: Rng) -> bytes:
    return f"OFF\n{_claim(rng)} {_claim(rng)} 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n".encode()


def _obj_of_many(rng: Rng) -> bytes:
    corners = " ".join(str(i % 4 + 1) for i in range(50_000))
    return b"v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 40\n" + f"f {corners}\n".encode() * 3


def _glb_of_many(rng: Rng) -> bytes:
    box = trimesh.creation.box([40.0] * 3)
    depth = int(rng.integers(5, 30))
    nodes = [{"children": [2 * i + 1, 2 * i + 2]} for i in range(depth)]
    # Each pair of nodes has the next pair as children: twice as many boxes a level, in a file of some lines.
    nodes = [{"children": [i + 1, i + 1]} for i in range(depth)] + [{"mesh": 0}]
    return _glb(box.vertices, box.faces, nodes)


def _glb_of_many_below(rng: Rng) -> bytes:
    box = trimesh.creation.box([40.0] * 3)
    depth = int(rng.integers(5, 30))
    nodes = [{"children": [min(2 * (i // 2) + k, 2 * depth) for k in (2, 3)]} for i in range(2 * depth)]
    return _glb(box.vertices, box.faces, [*nodes, {"mesh": 0}])


def _zipped(rng: Rng) -> bytes:
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("3D/3dmodel.model", "../../out.stl", "part.stl"):
            archive.writestr(name, bytes(10**7))
    return whole.getvalue()


def _gzipped(rng: Rng) -> bytes:
    return gzip.compress(bytes(10**7))


def _many_small_bodies(rng: Rng) -> bytes:
    tetrahedron = trimesh.creation.icosphere(0, 0.5)
    count = int(one(rng, (500, 2000, 9000)))
    turned = np.where(rng.random((count, 1, 1)) < 0.5, tetrahedron.faces[:, ::-1], tetrahedron.faces)
    faces = (turned + len(tetrahedron.vertices) * np.arange(count)[:, None, None]).reshape(-1, 3)
    return _stl((tetrahedron.vertices + rng.uniform(-20, 20, (count, 1, 3))).reshape(-1, 3), faces)


def _many_slivers(rng: Rng) -> bytes:
    """A box, one edge of which has thousands of points on it, with slivers in a fan from its end."""
    count = int(one(rng, (300, 3000, 30000)))
    points = np.linspace([0.0, 0.0, 0.0], [40.0, 0.0, 0.0], count)
    fan = np.stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)], axis=1)
    whole = np.concatenate([points, [[20.0, 30.0, 0.0], [20.0, 10.0, 30.0]]])
    above = np.stack([np.arange(1, count), np.arange(count - 1), np.full(count - 1, count)], axis=1)
    sides = np.array([[0, count - 1, count + 1], [count - 1, count, count + 1], [count, 0, count + 1]])
    return _stl(whole, np.concatenate([fan, above, sides]))


def _too_many_faces(rng: Rng) -> bytes:
    return _stl(rng.uniform(0, 40, (1000, 3)), rng.integers(0, 1000, (int(one(rng, (50_000, 199_000, 201_000))), 3)))


_BOMBS: dict[str, Callable[[Rng], bytes]] = {
    "stl": _stl_of_many,
    "ply": _ply_of_many,
    "off": _off_of_many,
    "obj": _obj_of_many,
    "glb": _glb_of_many,
    "glb below": _glb_of_many_below,
    "zip": _zipped,
    "gzip": _gzipped,
    "bodies": _many_small_bodies,
    "slivers": _many_slivers,
    "faces": _too_many_faces,
}
