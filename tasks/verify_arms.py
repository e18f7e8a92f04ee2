"""The verifier's own arms and hands: SRDF, joint limits and the YAML of hands, on the trees of their URDFs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from ..errors import InputError
from ..transforms import Array, compose, invert, pose, transform_points
from .models import HandFiles, ModelFiles, model_files, read_yaml
from .task import Mounted, OwnRobot, Task
from .verify_robot import Tree, read_tree, read_xml

_TABLE_SIZE = 4001
_FEWEST_JOINTS = 5  # in a group that lists joints, for it to be an arm
_ACCELERATION = 5.0  # rad/s2 or m/s2 where no limit is given


@dataclass(frozen=True, eq=False)
class Gripper:
    """A hand on an arm.

    Attributes:
        tree: Its links.
        mount: Pose (4, 4) of its base on the flange.
        stroke: Narrowest and widest opening [m].
        depth: Height of the grasp centre above the fingertips [m].
        speed: Of one finger [m/s].
        pads: Number of the link of each pad, the single finger's first.
        sizes: (pads, 2) sides of the pads along y and z [m].
        lip: For a cup the number of its lip's link, radius and compliance [m].
        values: Positions (v,) of the driving joint, and the factors and offsets (2, joints) of all joints by it.
    """

    tree: Tree
    mount: Array
    stroke: tuple[float, float]
    depth: float
    speed: float
    pads: tuple[int, ...]
    sizes: Array
    lip: tuple[int, float, float] | None
    values: Array
    mimics: Array

    @cached_property
    def pieces(self) -> dict[str, tuple[int, trimesh.Trimesh]]:
        """The rigid pieces by the first link of each: that link's number, and triangles in its frame."""
        home = self.tree.forward(np.zeros((1, len(self.tree.moving))), np.eye(4))[0]
        groups: dict[int, list[int]] = {}
        for i, link in enumerate(self.tree.links):
            if link in self.tree.meshes:
                groups.setdefault(self.tree.movers[i], []).append(i)
        pieces = {}
        for members in groups.values():
            first_from_base = invert(home[members[0]])
            meshes = [
                self.tree.meshes[self.tree.links[i]].copy().apply_transform(first_from_base @ home[i]) for i in members
            ]
            pieces[self.tree.links[members[0]]] = members[0], trimesh.util.concatenate(meshes)
        return pieces

    @cached_property
    def fingers(self) -> tuple[str, ...]:
        """The piece that carries each pad, or the lip."""
        ends = self.pads or (self.lip[0],) if self.lip else self.pads
        movers = {self.tree.movers[link]: name for name, (link, _) in self.pieces.items()}
        return tuple(movers[self.tree.movers[link]] for link in ends)

    def links(self, openings: Array) -> Array:
        """Poses (n, links, 4, 4) of the links in the flange's frame at openings (n,) [m]."""
        driver = np.interp(openings, self._table, self.values) if self.pads else np.zeros(len(openings))
        return self.tree.forward(driver[:, None] * self.mimics[0] + self.mimics[1], self.mount)

    def hand(self, openings: Array) -> Array:
        """Pose (n, 4, 4) of the hand frame in the flange's frame at openings (n,) [m]."""
        links = self.links(openings)
        return links[:, self.lip[0]] if self.lip else self._grasp(links)[1]

    def faces(self, openings: Array) -> Array:
        """Corners (n, pads, 4, 3) of the pads' faces in the flange's frame at openings (n,) [m]."""
        corners = np.array([[0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]]) / 2.0
        return transform_points(
            self.links(openings)[:, list(self.pads)], corners * np.insert(self.sizes, 0, 0.0, axis=1)[:, None]
        )

    @cached_property
    def _table(self) -> Array:
        """The openings (v,) that the values of the driving joint give."""
        links = self.tree.forward(self.values[:, None] * self.mimics[0] + self.mimics[1], self.mount)
        return self._grasp(links)[0]

    def _grasp(self, links: Array) -> tuple[Array, Array]:
        """Opening (n,) and hand frame (n, 4, 4): between the pads, ``depth`` above the tips, x closing, z approach."""
        pads = links[:, list(self.pads)]
        points = pads[..., :3, 3] + pads[..., :3, 2] * (self.sizes[:, 1:] / 2.0 - self.depth)
        single, others = points[:, 0], points[:, 1:].mean(axis=1)
        z = _unit(pads[:, 0, :3, 2] + pads[:, 1:, :3, 2].mean(axis=1))
        x = pads[:, 0, :3, 0] - pads[:, 1:, :3, 0].mean(axis=1)
        x = _unit(x - np.einsum("ni,ni->n", x, z)[:, None] * z)
        opening = np.einsum("ni,ni->n", others - single, x)
        return opening, compose(np.stack([x, np.cross(z, x), z], axis=-1), (single + others) / 2.0)


@dataclass(frozen=True, eq=False)
class Machine:
    """A robot with its hands.

    Attributes:
        tree: Links of the robot.
        base: Pose (4, 4) of the root in the world.
        arms: For each arm the places of its joints in a configuration, and the number of its flange's link.
        grippers: Hands by arm.
        disabled: Pairs of links that are not checked.
        home: Home configuration (nq,).
        limits: Lower and upper positions, velocities, accelerations (4, nq).
    """

    tree: Tree
    base: Array
    arms: Mapping[str, tuple[npt.NDArray[np.intp], int]]
    grippers: Mapping[str, Gripper]
    disabled: frozenset[frozenset[str]]
    home: Array
    limits: Array

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names (nq,) of the joints in the order of a configuration."""
        return tuple(joint.name for joint in self.tree.moving)

    def links(self, q: Array) -> Array:
        """Poses (n, links, 4, 4) of the robot's links in the world at configurations (n, nq)."""
        return self.tree.forward(q, self.base)

    def flanges(self, q: Array) -> dict[str, Array]:
        """Pose (n, 4, 4) of each arm's flange in the world at configurations (n, nq)."""
        links = self.links(q)
        return {arm: links[:, flange] for arm, (_, flange) in self.arms.items()}


def read_machine(task: Task, builtins: Mapping[str, Any], folder: Path) -> Machine:
    """The robot and hands of a task.

    Args:
        task: The task.
        builtins: The same as the plan document has it.
        folder: Where its relative paths start.

    Raises:
        InputError: A file is missing or cannot be read, or the task names an arm or state that does not exist.
    """
    files = model_files(builtins, folder)
    tree = read_tree(files.urdf, files.packages)
    own = task.robot if isinstance(task.robot, OwnRobot) else None
    try:
        arms, states, disabled = _srdf(tree, files.srdf)
        limits = _limits(tree, files)
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        raise InputError(files.srdf, f"does not fit {files.urdf.name} ({error})", "give files of one robot") from error
    wanted = own.home if own else "home"
    if wanted not in states and wanted != "home":
        raise InputError(files.srdf, f"there is no state named {wanted!r}", f"known: {', '.join(states)}")
    for arm in task.hands:
        if arm not in arms:
            raise InputError("hands", f"there is no arm named {arm!r}", f"known: {', '.join(arms)}")
    home = np.clip(0.0, limits[0], limits[1])
    for i, joint in enumerate(tree.moving):
        home[i] = states.get(wanted, {}).get(joint.name, home[i])
    mounts = {arm: hand.mount for arm, hand in task.hands.items() if isinstance(hand, Mounted)}
    kinds = {hand.name: _gripper(hand) for hand in {hand.name: hand for hand in files.hands.values()}.values()}
    grippers = {
        arm: replace(kinds[hand.name], mount=pose(mounts[arm].xyz, mounts[arm].rpy))
        if arm in mounts
        else kinds[hand.name]
        for arm, hand in files.hands.items()
    }
    base = pose(own.base.xyz, own.base.rpy) if own else np.eye(4)
    return Machine(tree, base, arms, grippers, disabled, home, limits)


def _srdf(
    tree: Tree, path: Path
) -> tuple[dict[str, tuple[npt.NDArray[np.intp], int]], dict[str, dict[str, float]], frozenset[frozenset[str]]]:
    """Arms, states and disabled pairs of an SRDF."""
    root = read_xml(path)
    arms = {}
    for group in root.findall("group"):
        chain, listed = group.find("chain"), [joint.attrib["name"] for joint in group.findall("joint")]
        if chain is not None:
            base, tip = (tree.links.index(chain.attrib[end]) for end in ("base_link", "tip_link"))
            joints = [i for i in _above(tree, tip) if i not in _above(tree, base)]
        else:
            joints = [i for i, joint in enumerate(tree.moving) if joint.name in listed]
            tip = next((joint.child for joint in tree.joints if listed and joint.name == listed[-1]), 0)
            below = [i for i in _above(tree, tip) if i >= joints[0]] if joints else []
            joints = joints if joints == below and len(joints) >= _FEWEST_JOINTS else []
        if joints:
            arms[group.attrib["name"]] = np.array(joints), tip
    states: dict[str, dict[str, float]] = {}
    for state in root.iter("group_state"):
        values = {joint.attrib["name"]: float(joint.attrib["value"].split()[0]) for joint in state.findall("joint")}
        states.setdefault(state.attrib["name"], {}).update(values)
    pairs = root.iter("disable_collisions")
    return arms, states, frozenset(frozenset((pair.attrib["link1"], pair.attrib["link2"])) for pair in pairs)


def _above(tree: Tree, link: int) -> list[int]:
    """The moving joints that move a link, from the root outwards."""
    chain = [link, *tree.ancestors(link)]
    return sorted({tree.movers[i] for i in chain} - {-1})


def _limits(tree: Tree, files: ModelFiles) -> Array:
    """Lower and upper positions, velocities and accelerations (4, nq): of the URDF, and of joint_limits.yaml."""
    limits = np.array([[j.lower, j.upper, j.velocity, _ACCELERATION] for j in tree.moving]).reshape(-1, 4).T
    if files.limits is not None:
        names = [joint.name for joint in tree.moving]
        for name, given in read_yaml(files.limits)["joint_limits"].items():
            i = names.index(name)
            if given.get("has_position_limits"):
                limits[0, i] = max(limits[0, i], given.get("min_position", -np.inf))
                limits[1, i] = min(limits[1, i], given.get("max_position", np.inf))
            if given.get("has_velocity_limits"):
                limits[2, i] = given["max_velocity"]
            if given.get("has_acceleration_limits"):
                limits[3, i] = given["max_acceleration"]
    return limits


def _gripper(files: HandFiles) -> Gripper:
    spec, tree = files.content, read_tree(files.urdf)
    try:
        pads, lip = spec.get("pads", []), spec.get("lip")
        driver = spec.get("driver", {"joint": "", "open": 0.0, "closed": 0.0})
        return Gripper(
            tree=tree,
            mount=np.eye(4),
            stroke=(float(spec["stroke"][0]), float(spec["stroke"][1])) if pads else (0.0, 0.0),
            depth=float(spec.get("contact_depth", 0.0)),
            speed=float(spec.get("speed", 0.0)),
            pads=tuple(tree.links.index(pad["link"]) for pad in pads),
            sizes=np.array([pad["size"] for pad in pads], dtype=float).reshape(-1, 2),
            lip=(tree.links.index(lip["link"]), float(lip["radius"]), float(lip["compliance"])) if lip else None,
            values=np.linspace(float(driver["closed"]), float(driver["open"]), _TABLE_SIZE),
            mimics=_mimics(tree, driver["joint"]),
        )
    except (LookupError, ValueError, TypeError, AttributeError, ArithmeticError) as error:
        problem = f"does not fit {files.urdf.name} ({error})"
        raise InputError(files.yaml, problem, "give the files of one hand") from error


def _mimics(tree: Tree, driver: str) -> Array:
    """Factors and offsets (2, joints) of the joints by the driving one."""
    mimics = np.zeros((2, len(tree.moving)))
    for i, joint in enumerate(tree.moving):
        root, mimics[0, i], mimics[1, i] = joint.mimic or (joint.name, 1.0, 0.0)
        if root != driver:
            raise ValueError(f"joint {joint.name} does not follow {driver}")
    return mimics


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


def adjacent(tree: Tree) -> frozenset[frozenset[str]]:
    """Pairs of links with nothing but joints, and links without shape, between them."""
    pairs = set()
    for i, link in enumerate(tree.links):
        above = next((tree.links[a] for a in tree.ancestors(i) if tree.links[a] in tree.meshes), None)
        if link in tree.meshes and above is not None:
            pairs.add(frozenset((link, above)))
    return frozenset(pairs)


def rigid_pairs(tree: Tree) -> frozenset[frozenset[str]]:
    """Pairs of links that no joint moves against each other."""
    shaped = [i for i, link in enumerate(tree.links) if link in tree.meshes]
    both = itertools.combinations(shaped, 2)
    return frozenset(frozenset((tree.links[a], tree.links[b])) for a, b in both if tree.movers[a] == tree.movers[b])
