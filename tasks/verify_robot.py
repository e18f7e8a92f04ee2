"""The verifier's own robot: kinematics and shapes read off the URDF's XML, over arrays of samples."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from math import inf, pi
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import trimesh

from ..errors import InputError
from ..transforms import Array, pose, transform_points
from .models import read_bytes

_SECTIONS = 96
_LARGEST = 8_000_000  # bytes
_MESHES = ("stl", "obj", "dae", "ply", "off", "glb")  # no archives, which may be far larger unpacked
_MOST_LINKS, _MOST_SHAPES = 500, 2000


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a URDF.

    Attributes:
        name: Its name.
        parent: Number of the link that carries it.
        child: Number of the link that it carries.
        origin: Pose (4, 4) of its frame in the parent's.
        axis: Its unit axis (3,).
        moves: Whether it is revolute or prismatic.
        slides: Whether it is prismatic.
        lower: Lowest position [rad or m].
        upper: Highest position [rad or m].
        velocity: Largest speed [rad/s or m/s].
        mimic: The joint that it follows, factor and offset.
    """

    name: str
    parent: int
    child: int
    origin: Array
    axis: Array
    moves: bool
    slides: bool
    lower: float
    upper: float
    velocity: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True, eq=False)
class Tree:
    """Links and joints of a URDF, parents first.

    Attributes:
        links: Names of the links, the root first.
        joints: All joints, fixed ones too.
        meshes: Triangles of each link that has collision shapes, in its frame [m]. Curved primitives are tessellated
            from outside: the flats touch them, so that the triangles hold the shape.
    """

    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    meshes: dict[str, trimesh.Trimesh]

    @cached_property
    def moving(self) -> tuple[Joint, ...]:
        """The joints that move, in the order of a configuration."""
        return tuple(joint for joint in self.joints if joint.moves)

    @cached_property
    def movers(self) -> tuple[int, ...]:
        """For each link the number, among the moving joints, of the last that moves it; -1 for none."""
        movers = [-1] * len(self.links)
        count = -1
        for joint in self.joints:
            count += joint.moves
            movers[joint.child] = count if joint.moves else movers[joint.parent]
        return tuple(movers)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """For each link the one that carries it; -1 for the root."""
        parents = [-1] * len(self.links)
        for joint in self.joints:
            parents[joint.child] = joint.parent
        return tuple(parents)

    def forward(self, q: Array, root: Array) -> Array:
        """Poses (n, links, 4, 4) of the links at configurations (n, joints), the root at pose ``root`` (4, 4)."""
        first, second = np.where(self._slides, q, np.sin(q)), np.where(self._slides, 0.0, 1.0 - np.cos(q))
        origins, firsts, seconds = self._terms
        moves = origins[self._moves] + first[..., None, None] * firsts + second[..., None, None] * seconds
        poses = np.zeros((len(q), len(self.links), 4, 4))
        poses[:, 0] = root
        at = 0
        for joint, origin in zip(self.joints, origins, strict=True):
            poses[:, joint.child] = poses[:, joint.parent] @ (moves[:, at] if joint.moves else origin)
            at += joint.moves
        return poses

    @cached_property
    def _moves(self) -> npt.NDArray[np.bool_]:
        return np.array([joint.moves for joint in self.joints], dtype=bool)

    @cached_property
    def _slides(self) -> npt.NDArray[np.bool_]:
        return np.array([joint.slides for joint in self.moving], dtype=bool)

    @cached_property
    def _terms(self) -> tuple[Array, Array, Array]:
        """Matrices (k, 4, 4) by which the pose of a joint's child in its parent follows from its position.

        For a turn by q about the axis with cross matrix K it is ``origin (1 + sin q K + (1 - cos q) K^2)`` (Rodrigues),
        for a slide ``origin (1 + q T)``. Origins are given for all joints, the others for those that move.
        """
        origins = np.array([joint.origin for joint in self.joints]).reshape(-1, 4, 4)
        steps = np.zeros((len(self.moving), 4, 4))
        for step, joint in zip(steps, self.moving, strict=True):
            if joint.slides:
                step[:3, 3] = joint.axis
            else:
                step[:3, :3] = np.cross(np.eye(3), joint.axis)
        firsts = origins[self._moves] @ steps
        return origins, firsts, firsts @ steps

    def ancestors(self, link: int) -> Iterator[int]:
        """The links that carry ``link``, the nearest first."""
        while (link := self.parents[link]) >= 0:
            yield link


def read_tree(path: Path, packages: Sequence[Path] = ()) -> Tree:
    """The links and joints of a URDF.

    Args:
        path: The URDF.
        packages: Folders in which ``package://`` addresses are looked up, before those of the installed robot data and
            the folders above the file.

    Raises:
        InputError: It is missing, no URDF, or has a joint or a shape that the verifier cannot read.
    """
    root = read_xml(path)
    try:
        return _tree(path, root, packages)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(path, f"no URDF that can be read ({error})", "check it with check_urdf") from error


def read_xml(path: Path) -> ElementTree.Element:
    """The root element of an XML file.

    Raises:
        InputError: It is missing, too large, no XML, or declares entities.
    """
    content = read_bytes(path)
    if len(content) > _LARGEST or b"<!ENTITY" in content:
        raise InputError(path, f"larger than {_LARGEST} bytes, or with XML entities", "give a plain file")
    try:
        return ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise InputError(path, f"no XML ({error})", "mend the file there") from error


def _tree(path: Path, root: ElementTree.Element, packages: Sequence[Path]) -> Tree:
    elements = {link.attrib["name"]: link for link in root.findall("link")}
    joints = {joint.attrib["name"]: joint for joint in root.findall("joint")}
    if len(elements) > _MOST_LINKS or len(root.findall("link/collision")) > _MOST_SHAPES:
        raise InputError(path, f"more than {_MOST_LINKS} links or {_MOST_SHAPES} shapes", "leave some out")
    ends = {name: (_named(joint, "parent"), _named(joint, "child")) for name, joint in joints.items()}
    roots = elements.keys() - {child for _, child in ends.values()}
    if len(roots) != 1 or len(ends) != len(elements) - 1:
        raise InputError(path, f"{len(roots)} links have no parent", "give one tree of links")
    links, order = [roots.pop()], list[str]()
    for link in links:  # grows while it is read
        below = [name for name, (parent, _) in ends.items() if parent == link]
        order += below
        links += [ends[name][1] for name in below]
    number = {link: i for i, link in enumerate(links)}
    known: dict[str, trimesh.Trimesh] = {}
    return Tree(
        links=tuple(links),
        joints=tuple(_joint(path, joints[name], *(number[end] for end in ends[name])) for name in order),
        meshes={
            link: mesh for link in links if (mesh := _link_mesh(path, elements[link], packages, known)) is not None
        },
    )


def _named(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    if element is None:
        raise KeyError(f"joint {joint.get('name')} has no {end}")
    return element.attrib["link"]


def _joint(path: Path, element: ElementTree.Element, parent: int, child: int) -> Joint:
    name, kind = element.attrib["name"], element.attrib["type"]
    if kind not in ("fixed", "revolute", "continuous", "prismatic"):
        raise InputError(path, f"joint {name} is {kind}", "use fixed, revolute, continuous or prismatic joints")
    limit, axis, mimic = element.find("limit"), element.find("axis"), element.find("mimic")
    given = {} if limit is None else limit.attrib
    direction = _numbers("1 0 0" if axis is None else axis.attrib["xyz"])
    turns = kind == "continuous"  # planners give such joints the range of one turn
    return Joint(
        name=name,
        parent=parent,
        child=child,
        origin=_origin(element),
        axis=direction / np.linalg.norm(direction),
        moves=kind != "fixed",
        slides=kind == "prismatic",
        lower=-pi if turns else float(given.get("lower", 0.0)),
        upper=pi if turns else float(given.get("upper", 0.0)),
        velocity=float(given.get("velocity", inf)),
        mimic=None
        if mimic is None
        else (mimic.attrib["joint"], float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))),
    )


def _link_mesh(
    path: Path, link: ElementTree.Element, packages: Sequence[Path], known: dict[str, trimesh.Trimesh]
) -> trimesh.Trimesh | None:
    """The triangles of all collision shapes of a link, in its frame."""
    meshes = []
    for element in link.findall("collision"):
        geometry = element.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            raise InputError(path, f"a collision shape of {link.get('name')} is empty", "give it a geometry")
        mesh = _shape(path, shape, packages, known)
        meshes.append(trimesh.Trimesh(transform_points(_origin(element), mesh.vertices), mesh.faces, process=False))
    return trimesh.util.concatenate(meshes) if meshes else None


def _shape(
    path: Path, shape: ElementTree.Element, packages: Sequence[Path], known: dict[str, trimesh.Trimesh]
) -> trimesh.Trimesh:
    if shape.tag == "box":
        return trimesh.creation.box(_numbers(shape.attrib["size"]))
    if shape.tag == "cylinder":
        radius = float(shape.attrib["radius"]) / np.cos(pi / _SECTIONS)
        return trimesh.creation.cylinder(radius, float(shape.attrib["length"]), sections=_SECTIONS)
    if shape.tag == "sphere":
        ball = trimesh.creation.icosphere(4)
        inner = np.einsum("ti,ti->t", ball.triangles_center, ball.face_normals).min()
        return ball.apply_scale(float(shape.attrib["radius"]) / inner)
    if shape.tag != "mesh":
        raise InputError(path, f"a collision shape is a {shape.tag}", "use box, cylinder, sphere or mesh")
    file = _found(path, shape.attrib["filename"], packages)
    if str(file) not in known:
        try:
            kind = file.suffix.lower().lstrip(".")
            if kind not in _MESHES:
                raise InputError(file, "no mesh format that is read", f"give one of {', '.join(_MESHES)}")
            known[str(file)] = trimesh.load_mesh(BytesIO(read_bytes(file)), file_type=kind, process=False)
        except InputError:
            raise
        except Exception as error:  # the readers raise whatever their parsing meets
            raise InputError(file, f"no mesh that can be read ({error})", "export it as STL or OBJ") from error
    return known[str(file)].copy().apply_scale(_numbers(shape.get("scale", "1 1 1")))


def _found(urdf: Path, address: str, packages: Sequence[Path]) -> Path:
    """The file at an address of a URDF."""
    name = address.removeprefix("file://").removeprefix("package://")
    shared = [Path(entry) / "cmeel.prefix" / "share" for entry in sys.path if entry]
    folders = (*packages, *shared, *urdf.resolve().parents[:4])
    inside = name.partition("/")[2]  # a package folder may itself be given
    for candidate in (Path(name), *(folder / name for folder in folders), *(folder / inside for folder in packages)):
        if candidate.is_file():
            return candidate
    raise InputError(urdf, f"there is no mesh {address}", "name the folder of its package in packages")


def _origin(element: ElementTree.Element) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return pose(_numbers(origin.get("xyz", "0 0 0")), _numbers(origin.get("rpy", "0 0 0")))


def _numbers(text: str) -> Array:
    numbers = np.array([float(word) for word in text.split()])
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise ValueError(f"{text!r} is no vector")
    return numbers
