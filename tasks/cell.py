"""From a task to what it speaks of: the robot with its hands, the parts, and the scene with its state at the start."""

from __future__ import annotations

import logging
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from io import BytesIO
from pathlib import Path

import numpy as np
import trimesh

from ..errors import InputError, UnknownNameError
from ..grasping.grasps import GraspSet
from ..grasping.parameters import GraspParameters
from ..grasping.part import UNITS, Part
from ..grasping.store import grasp_key
from ..regrasp.supports import Support
from ..robots.hand import Hand
from ..robots.library import HANDS, ROBOTS, load_hand, load_robot
from ..robots.robot import Robot
from ..robots.scene import Scene
from ..robots.state import Body, SceneState
from ..transforms import Array, pose
from .document import Mesh
from .resting import resting_contacts
from .task import Mounted, Obstacle, OwnRobot, PartEntry, Task
from .task_checks import grasp_parameters, is_hand_file
from .task_file import checked_task

_log = logging.getLogger(__name__)

_ANY_DENSITY = 1000.0  # kg/m3; nobody weighs an obstacle


@dataclass(frozen=True, eq=False)
class Cell:
    """What a task speaks of.

    Attributes:
        task: The task.
        folder: Where its relative paths start.
        robot: The robot with its hands.
        parts: The parts, repaired and weighed, by name.
        parameters: The grasp parameters of each part.
        simulated: Grasps of which the task has what was measured in simulation, by part and arm.
        meshes: Triangles of parts and obstacles as their files give them, by name.
        scene: Robot, parts and obstacles.
        state: Where all of it is at the start: hands open, and contacts of each part with what it rests on.
        supports: Level tops of the obstacles that parts may be put on.
    """

    task: Task
    folder: Path
    robot: Robot
    parts: Mapping[str, Part]
    parameters: Mapping[str, GraspParameters]
    simulated: Mapping[tuple[str, str], GraspSet]
    meshes: Mapping[str, Mesh]
    scene: Scene
    state: SceneState
    supports: tuple[Support, ...]


def build_cell(task: Task, folder: str | Path) -> Cell:
    """Load everything that ``task`` names, put it where it is at the start, and check that it can stand there.

    Args:
        task: The task.
        folder: Where its relative paths start.

    Raises:
        InputError: The task is not sound, a file is missing or wrong, a name does not exist, or at the start a part
            floats, would topple, or something touches what it should not.
    """
    folder = Path(folder)
    checked_task(task, folder)
    robot = robot_of(task, folder)
    parts = _parts(task, folder)
    parameters = {name: grasp_parameters(entry) for name, entry in task.parts.items()}
    simulated = _simulated(task, folder, robot, parts, parameters)
    obstacles = {obstacle.name: _obstacle(obstacle, folder) for obstacle in task.cell}
    bodies = [*obstacles.values(), *(Body.from_mesh(name, part.mesh) for name, part in parts.items())]
    scene = Scene.of(robot, bodies)
    entries: dict[str, Obstacle | PartEntry] = {**{entry.name: entry for entry in task.cell}, **task.parts}
    poses = {name: pose(entry.at.xyz, entry.at.rpy) for name, entry in entries.items()}
    state = scene.state(poses, _start(robot, task))
    state = state.with_contacts(resting_contacts(scene, state, parts))
    for carrier, part in ((contact.first, contact.second) for contact in state.contacts):
        if any(entry.name == carrier and not entry.support for entry in task.cell):
            raise InputError(
                f"parts.{part}.at", f"it rests on {carrier}, which is no support", "give that support: true"
            )
    if touching := scene.touching(state):
        place = next((f"parts.{name}.at" for pair in touching for name in pair if name in parts), "start")
        listed = ", ".join(f"{a} / {b}" for a, b in touching)
        raise InputError(place, f"at the start these touch: {listed}", "move them apart, or change the start joints")
    return Cell(
        task=task,
        folder=folder,
        robot=robot,
        parts=parts,
        parameters=parameters,
        simulated=simulated,
        meshes={name: _mesh(entry, scene.bodies[name], folder) for name, entry in entries.items()},
        scene=scene,
        state=state,
        supports=_supports(task, obstacles, state),
    )


def robot_of(task: Task, folder: str | Path) -> Robot:
    """The robot of ``task`` with its hands; joints of no arm, such as a chest, stand where the task starts them.

    Args:
        task: The task.
        folder: Where its relative paths start.

    Raises:
        InputError: There is no such robot, hand, arm or joint, a file is wrong, or a joint is outside its limits.
    """
    folder = Path(folder)
    robot = _bare_robot(task.robot, folder)
    hands: dict[str, Hand] = {}
    for arm, entry in task.hands.items():
        mounted = entry if isinstance(entry, Mounted) else Mounted(entry)
        if arm not in robot.arms:
            raise UnknownNameError(f"hands.{arm}", "arm", arm, tuple(robot.arms))
        if mounted.hand not in hands:
            hands[mounted.hand] = _hand(mounted.hand, folder, f"hands.{arm}")
        robot = robot.with_hand(arm, hands[mounted.hand], pose(mounted.mount.xyz, mounted.mount.rpy))
    home = robot.home.copy()
    still = np.setdiff1d(np.arange(len(home)), robot.indices(robot.arms))
    home[still] = _start(robot, task)[still]
    return robot if (home == robot.home).all() else robot.with_home(home)


def _bare_robot(entry: str | OwnRobot, folder: Path) -> Robot:
    if isinstance(entry, str):
        if entry not in ROBOTS:
            raise UnknownNameError("robot", "shipped robot", entry, ROBOTS)
        return load_robot(entry)
    return Robot.load(
        folder / entry.urdf,
        folder / entry.srdf,
        None if entry.limits is None else folder / entry.limits,
        pose(entry.base.xyz, entry.base.rpy),
        [folder / package for package in entry.packages],
        entry.home,
    )


def _hand(name: str, folder: Path, place: str) -> Hand:
    if is_hand_file(name):
        return Hand.load(folder / name)
    if name not in HANDS:
        raise UnknownNameError(place, "shipped hand", name, HANDS)
    return load_hand(name)


def _start(robot: Robot, task: Task) -> Array:
    """The configuration (nq,) at the start: home, but for the joints that the task gives."""
    q = robot.home.copy()
    for joint, value in task.start.items():
        if joint not in robot.joint_names:
            raise UnknownNameError("start", "joint", joint, robot.joint_names)
        i = robot.joint_names.index(joint)
        if not robot.lower[i] <= value <= robot.upper[i]:
            cure = f"stay between {robot.lower[i]:.4f} and {robot.upper[i]:.4f}"
            raise InputError(f"start.{joint}", f"{value:g} is outside the joint's limits", cure)
        q[i] = value
    return q


def _parts(task: Task, folder: Path) -> dict[str, Part]:
    """The parts by name; a mesh that several are made of is read once."""
    read: dict[tuple[object, ...], Part] = {}
    parts = {}
    for name, entry in task.parts.items():
        key = (entry.mesh, entry.unit, entry.mass, entry.density)
        if key not in read:
            path = folder / entry.mesh
            read[key] = Part.load(path, unit=entry.unit, mass=entry.mass, density=entry.density, name=name)
        parts[name] = replace(read[key], name=name)
    return parts


def _simulated(
    task: Task, folder: Path, robot: Robot, parts: Mapping[str, Part], parameters: Mapping[str, GraspParameters]
) -> dict[tuple[str, str], GraspSet]:
    """The grasps in the files of what was measured, by part and arm: those that would be planned here."""
    found: dict[tuple[str, str], GraspSet] = {}
    for part, entry in task.parts.items():
        keys = {arm: grasp_key(parts[part], hand, parameters[part]) for arm, hand in robot.hands.items()}
        for i, file in enumerate(entry.grasps.measured):
            place = f"parts.{part}.grasps.measured[{i}]"
            grasps = GraspSet.load(folder / file)
            arms = [arm for arm, key in keys.items() if key == grasps.key]
            if not arms or grasps.measured is None:
                raise InputError(place, *_not_simulated(task, robot, part, file, grasps))
            if (part, arms[0]) in found:
                raise InputError(place, f"{file} is a second file of {part} by {grasps.hand}", "keep one of them")
            found |= {(part, arm): replace(grasps, part=part, hand=robot.hands[arm].name) for arm in arms}
    return found


def _not_simulated(task: Task, robot: Robot, part: str, file: str, grasps: GraspSet) -> tuple[str, str]:
    """Why ``grasps`` of a file are not those of a part that would be planned and were simulated; and the cure."""
    hands = {robot.hands[arm].name: entry for arm, entry in task.hands.items()}
    if grasps.hand not in hands:
        return f"{file} has grasps by {grasps.hand}, which no arm has", "give an arm that hand, or leave the file out"
    if grasps.measured is None:
        problem = f"nothing was measured of the grasps in {file}"
    else:
        problem = (
            f"{file} has other grasps (of {grasps.part} by {grasps.hand}) than those planned here: the mesh, its unit, "
            "its mass, the hand's files or the grasp parameters differ, or another version planned them"
        )
    entry, hand = task.parts[part], hands[grasps.hand]
    options: dict[str, object] = {"unit": entry.unit, "mass": entry.mass, "density": entry.density}
    options |= {"hand": hand.hand if isinstance(hand, Mounted) else hand, **entry.grasps.parameters, "output": file}
    given = [f"--{name.replace('_', '-')}={value}" for name, value in options.items() if value is not None]
    return problem, f"run in the task's folder: `{shlex.join(['kumitate', 'simulate', entry.mesh, *given])}`"


def _supports(task: Task, obstacles: Mapping[str, Body], state: SceneState) -> tuple[Support, ...]:
    """The supports with free spots of their own; a tray, whose top is none, carries what goals put there."""
    supports = []
    for i, entry in enumerate(task.cell):
        if entry.support:
            try:
                supports.append(Support.top_of(obstacles[entry.name], state.poses[entry.name]))
            except InputError as error:
                if entry.box is not None:
                    raise InputError(f"cell[{i}].support", error.problem, error.cure) from error
                _log.info("no free spots on %s: %s", entry.name, error.problem)
    return tuple(supports)


def _obstacle(entry: Obstacle, folder: Path) -> Body:
    if entry.box is not None:
        return Body.box(entry.name, entry.box, fixed=True)
    path = folder / str(entry.mesh)
    part = Part.load(path, unit=str(entry.unit), density=_ANY_DENSITY, name=entry.name)
    return Body.from_mesh(entry.name, part.mesh, fixed=True)


def _mesh(entry: Obstacle | PartEntry, body: Body, folder: Path) -> Mesh:
    """The triangles of a file in metres, neither merged nor repaired; of a box, those of its body."""
    if entry.mesh is None or entry.unit is None:
        return Mesh.of(body.mesh)
    path = folder / entry.mesh
    content = path.read_bytes()
    mesh = trimesh.load_mesh(BytesIO(content), file_type=path.suffix.lower().lstrip("."), process=False)
    scaled = trimesh.Trimesh(mesh.vertices * UNITS[entry.unit], mesh.faces, process=False)
    return Mesh.of(scaled, sha256(content).hexdigest())
