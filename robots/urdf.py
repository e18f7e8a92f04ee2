"""Reading URDF files: pinocchio models and their collision shapes, with errors that name file and cure."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio as pin

from ..errors import InputError
from ..transforms import Array
from .files import parse_xml, read_text
from .rigid import Rigid
from .shapes import Shape, from_coal

_MOST_LINKS, _MOST_SHAPES = 500, 2000  # chains of thousands are too deep for the parser
_LARGEST = 1e3  # m


@dataclass(frozen=True, eq=False)
class Link(Rigid):
    """A rigid body of a robot or hand, in the frame of the joint that moves it.

    Attributes:
        joint: Index of that pinocchio joint; 0 is the base.
    """

    joint: int


@dataclass(frozen=True, eq=False)
class Urdf:
    """A parsed URDF: kinematics, collision shapes, and the mimic joints that pinocchio leaves out.

    Attributes:
        path: The file.
        model: Kinematics; mimic joints are joints of their own.
        geometry: Collision shapes as pinocchio read them.
        shapes: The same shapes.
        placements: Pose (n, 4, 4) of each shape in the frame of the joint that carries it.
        links: Name of the link of each shape.
        joints: Index of the pinocchio joint that carries each shape.
        colors: RGBA of each shape.
        mimics: Mimic joint name -> (driving joint, multiplier, offset).
    """

    path: Path
    model: pin.Model
    geometry: pin.GeometryModel
    shapes: tuple[Shape, ...]
    placements: Array
    links: tuple[str, ...]
    joints: tuple[int, ...]
    colors: Array
    mimics: dict[str, tuple[str, float, float]]


def read_urdf(path: str | Path, package_dirs: Sequence[str | Path] = ()) -> Urdf:
    """Load a URDF with its collision shapes.

    Args:
        path: The URDF file.
        package_dirs: Folders in which ``package://`` addresses are looked up, besides the shipped robot data and the
            folders above the file.

    Raises:
        InputError: The file is missing, is no URDF, has too many links, or has a collision shape that is missing, of
            no size, or cannot be read.
    """
    path = Path(path)
    text = read_text(path, "URDF")
    root = parse_xml(path, text)
    if root.tag != "robot" or not root.get("name"):
        raise InputError(path, "no <robot name=...> at the top", "give a URDF (expand xacro files first)")
    for what, most in (("link", _MOST_LINKS), ("link/collision", _MOST_SHAPES)):
        if (count := len(root.findall(what))) > most:
            raise InputError(path, f"{count} {what} elements, and {most} are the most", "leave out what is not needed")
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            _bound(joint)
    _check_shapes(path, root)
    mimics = _mimics(path, root)
    try:
        text = ElementTree.tostring(root, encoding="unicode")
        model = pin.buildModelFromXML(text)
    except (ValueError, RuntimeError, IndexError, RecursionError) as error:
        raise InputError(path, f"not a valid URDF ({_first_line(error)})", "check it with check_urdf") from error
    _check(path, model)
    geometry = _geometry(path, model, text, package_dirs)
    objects = list(geometry.geometryObjects)
    given = sum(len(link.findall("collision")) for link in root.findall("link"))
    if len(objects) != given:
        # The parser leaves out what it cannot read, and the robot would pass through things in silence.
        problem = f"only {len(objects)} of {given} collision shapes can be read"
        raise InputError(path, problem, "give each a geometry (box, cylinder, sphere or mesh) and finite numbers")
    placements = np.array([entry.placement.homogeneous for entry in objects]).reshape(-1, 4, 4)
    if not (np.abs(placements) < _LARGEST).all():
        raise InputError(path, "the origin of a collision shape is beyond all measure", f"stay within {_LARGEST:g} m")
    return Urdf(
        path=path,
        model=model,
        geometry=geometry,
        shapes=_shapes(objects),
        placements=placements,
        links=tuple(model.frames[entry.parentFrame].name for entry in objects),
        joints=tuple(int(entry.parentJoint) for entry in objects),
        colors=np.array([entry.meshColor for entry in objects], dtype=float).reshape(-1, 4),
        mimics=mimics,
    )


def _geometry(path: Path, model: pin.Model, text: str, package_dirs: Sequence[str | Path]) -> pin.GeometryModel:
    """The collision shapes of a URDF's ``text``, their meshes found and looked through."""
    folders = [str(folder) for folder in (*package_dirs, *_shared_folders(), *path.resolve().parents[:4])]
    try:
        geometry = pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION, None, folders)
    except (ValueError, RuntimeError) as error:
        cure = "put the mesh where the URDF says, or name its package folder in package_dirs"
        raise InputError(path, f"a collision mesh cannot be read ({_first_line(error)})", cure) from error
    for entry in geometry.geometryObjects:
        if isinstance(entry.geometry, coal.BVHModelBase):
            corners = entry.geometry.vertices()
            if not (np.abs(corners) < _LARGEST).all() or not np.ptp(corners, axis=0).any():
                place = f"{path}: link {model.frames[entry.parentFrame].name}"
                problem = f"its collision mesh has no size, or a corner that is not within {_LARGEST:g} m"
                raise InputError(place, problem, "mend the mesh and its scale")
    return geometry


def _check_shapes(path: Path, root: ElementTree.Element) -> None:
    """Refuse sides, radii and lengths of collision shapes that are not above zero, or beyond all measure."""
    for link in root.findall("link"):
        for shape in link.findall("collision/geometry/*"):
            for field in ("size", "radius", "length"):
                try:
                    wrong = not all(0.0 < float(number) < _LARGEST for number in shape.get(field, "1").split())
                except ValueError:
                    wrong = True
                if wrong:
                    place = f"{path}: link {link.get('name')}: {shape.tag}"
                    raise InputError(
                        place, f"{field}={shape.get(field)!r}", f"give numbers above 0 m and below {_LARGEST:g} m"
                    )


def _shapes(objects: Sequence[pin.GeometryObject]) -> tuple[Shape, ...]:
    """The shape of each geometry object; a mesh that several links use is read once."""
    keys = [
        (entry.meshPath, np.asarray(entry.meshScale).tobytes()) if Path(entry.meshPath).is_file() else i
        for i, entry in enumerate(objects)
    ]
    known = {key: from_coal(entry.geometry) for key, entry in dict(zip(keys, objects, strict=True)).items()}
    return tuple(known[key] for key in keys)


def _shared_folders() -> list[Path]:
    """Folders ``cmeel.prefix/share`` of the installed robot data."""
    candidates = (Path(entry) / "cmeel.prefix" / "share" for entry in sys.path if entry)
    return [folder for folder in candidates if folder.is_dir()]


def _bound(joint: ElementTree.Element) -> None:
    """Give a continuous joint the range of one turn: planners sample a bounded space."""
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="0")
    limit.set("lower", str(-np.pi))
    limit.set("upper", str(np.pi))


def _mimics(path: Path, root: ElementTree.Element) -> dict[str, tuple[str, float, float]]:
    mimics = {}
    for joint in root.iter("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            try:
                factors = float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            except ValueError:
                factors = np.nan, np.nan
            if not np.isfinite(factors).all():
                place = f"{path}: joint {joint.get('name')}: mimic"
                raise InputError(place, "multiplier or offset is no finite number", "give numbers")
            mimics[joint.get("name", "")] = (mimic.get("joint", ""), *factors)
    return mimics


def _check(path: Path, model: pin.Model) -> None:
    placements = np.array([placement.homogeneous for placement in model.jointPlacements])
    limits = np.concatenate([model.lowerPositionLimit, model.upperPositionLimit, model.velocityLimit])
    if not (np.abs(placements) < _LARGEST).all() or np.isnan(limits).any():
        cure = f"give origins within {_LARGEST:g} m, and limits that are numbers"
        raise InputError(path, "a joint has a number that is not finite, or beyond all measure", cure)
    if model.nq != model.njoints - 1:
        raise InputError(path, "a joint is floating or planar", "use fixed, revolute, continuous or prismatic joints")


def _first_line(error: Exception) -> str:
    return str(error).strip().split("\n", maxsplit=1)[0][:200]
