"""A second opinion on collisions.

`Reference` shares nothing with the package's checker: it reads URDF and SRDF by itself, moves the bodies by pinocchio,
and lets python-fcl decide on full triangle meshes.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio as pin
import trimesh

import kumitate.robots.library
from kumitate.robots.library import make_models
from kumitate.robots.scene import Scene
from kumitate.robots.state import SceneState
from kumitate.transforms import Array, invert, transform_points

LIBRARY = Path(kumitate.robots.library.__file__).parent
SECTIONS = 128


class Reference:
    """The bodies of a scene as fcl meshes: which pairs touch, how far they are apart, how far states move them."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        robot = scene.robot
        self.model, links = _read(robot.name)
        self.data = self.model.createData()
        self.hands = {arm: _read(hand.name) for arm, hand in robot.hands.items()}
        meshes = {name: mesh for name, (_, mesh) in links.items()}
        self._links = [joint for joint, _ in links.values()]
        for arm, (_, pieces) in self.hands.items():
            meshes.update({f"{arm}/{name}": mesh for name, (_, mesh) in pieces.items()})
        meshes.update({body.name: body.mesh for body in scene.bodies.values()})
        self.names, self.meshes = list(meshes), list(meshes.values())
        self._objects = [_collision_object(mesh) for mesh in self.meshes]
        self._corners = np.array([trimesh.bounds.corners(mesh.bounds) for mesh in self.meshes])
        self.pairs = np.array([p for p in itertools.combinations(range(len(meshes)), 2) if self._checked(links, *p)])

    def _checked(self, links: dict[str, tuple[int, trimesh.Trimesh]], i: int, j: int) -> bool:
        """All pairs but rigid ones: links of one joint, a hand and its flange, obstacles and base; and the SRDF's."""
        a, b = self.names[i], self.names[j]
        robot, bodies = self.scene.robot, self.scene.bodies
        still = [links[n][0] == 0 if n in links else n in bodies and bodies[n].fixed for n in (a, b)]
        arm = b.split("/")[0]
        if all(still):
            return False
        if a in links and b in links:
            srdf = ElementTree.parse(LIBRARY / f"{robot.name}.srdf").getroot()
            disabled = [{e.get("link1"), e.get("link2")} for e in srdf.iter("disable_collisions")]
            return links[a][0] != links[b][0] and {a, b} not in disabled
        if b in bodies:
            return True
        if a in links:
            return links[a][0] != self.model.frames[self.model.getFrameId(f"{arm}_flange")].parentJoint
        return a.split("/")[0] != arm

    def poses(self, state: SceneState, q: Array) -> Array:
        """Pose (n, 4, 4) of every body in the world."""
        pin.framesForwardKinematics(self.model, self.data, q)
        poses = [self.data.oMi[joint].homogeneous for joint in self._links]
        flanges = {arm: self._frame(f"{arm}_flange") for arm in self.scene.robot.arms}
        for arm, (model, pieces) in self.hands.items():
            data = model.createData()
            pin.forwardKinematics(model, data, self.scene.robot.hands[arm].joint_positions(state.openings[arm])[0])
            base = flanges[arm] @ self.scene.robot.arms[arm].flange_from_base
            poses += [base @ data.oMi[joint].homogeneous for joint, _ in pieces.values()]

        def of_body(name: str) -> Array:
            if name in flanges:
                return flanges[name]
            if name in state.attached:
                return of_body(state.attached[name].carrier) @ state.attached[name].carrier_from_body
            return np.asarray(state.poses[name])

        return np.array(poses + [of_body(name) for name in self.scene.bodies])

    def touching(self, state: SceneState, q: Array, first_only: bool = False) -> set[frozenset[str]]:
        """Pairs whose surfaces cross; at most one of them if ``first_only``."""
        poses = self.poses(state, q)
        points = transform_points(poses, self._corners)
        low, high = points.min(axis=1), points.max(axis=1)
        first, second = self.pairs.T
        near = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
        found: set[frozenset[str]] = set()
        for i, j in self.pairs[near]:
            if fcl.collide(self._placed(i, poses), self._placed(j, poses), *_collision_query()):
                found.add(frozenset((self.names[i], self.names[j])))
                if first_only:
                    break
        return found

    def distances(self, state: SceneState, q: Array, within: float) -> dict[tuple[str, str], float]:
        """Distances [m] of all pairs that may be nearer than ``within``, by the boxes around them."""
        points = transform_points(self.poses(state, q), self._corners)
        low, high = points.min(axis=1), points.max(axis=1) + within
        first, second = self.pairs.T
        near = ((low[first] <= high[second]) & (low[second] <= high[first])).all(axis=1)
        pairs = [(self.names[i], self.names[j]) for i, j in self.pairs[near]]
        return {(a, b): self.distance(state, q, a, b) for a, b in pairs}

    def distance(self, state: SceneState, q: Array, a: str, b: str) -> float:
        """Distance of the surfaces of two bodies [m]; 0 or less where they cross."""
        poses, (i, j) = self.poses(state, q), (self.names.index(a), self.names.index(b))
        return float(fcl.distance(self._placed(i, poses), self._placed(j, poses)))

    def contains(self, state: SceneState, q: Array, a: str, b: str) -> bool:
        """Whether ``a`` holds a corner of ``b``."""
        poses, (i, j) = self.poses(state, q), (self.names.index(a), self.names.index(b))
        points = transform_points(invert(poses[i]) @ poses[j], self.meshes[j].vertices)
        return any(piece.contains(points).any() for piece in self.meshes[i].split(only_watertight=False))

    def movement(self, state: SceneState, p: Array, q: Array) -> float:
        """How far apart configurations ``p`` and ``q`` put any corner of a box around any body [m]."""
        moved = [transform_points(self.poses(state, at), self._corners) for at in (p, q)]
        return float(np.linalg.norm(moved[0] - moved[1], axis=-1).max())

    def near_states(self, state: SceneState, rng: np.random.Generator, n: int, within: float = 0.05) -> Array:
        """Configurations (n, nq), free and colliding, from which contact is at most ``within`` [m] away.

        Each lies where a bisection between a free and a colliding state found the border, turned a little at random:
        no body has moved by more than half of ``within``, so that two of them are no farther apart than that.
        """
        lower, upper = self.scene.robot.lower, self.scene.robot.upper
        found: list[Array] = []
        free: list[Array] = []
        while len(found) < n:
            q = rng.uniform(lower, upper)
            if not self.touching(state, q, first_only=True):
                free.append(q)
            elif free:
                border = self._border(state, free[rng.integers(len(free))], q)
                turn = rng.normal(size=q.shape)
                turn *= rng.uniform(0.0, within / 2.0) / self.movement(state, border, border + 1e-3 * turn) * 1e-3
                near = np.clip(border + turn, lower, upper)
                if self.movement(state, border, near) <= within / 2.0:
                    found.append(near)
        return np.array(found)

    def _border(self, state: SceneState, free: Array, touching: Array) -> Array:
        while np.abs(free - touching).max() > 1e-3:
            middle = (free + touching) / 2.0
            if self.touching(state, middle, first_only=True):
                touching = middle
            else:
                free = middle
        return touching

    def _frame(self, name: str) -> Array:
        return np.array(self.data.oMf[self.model.getFrameId(name)].homogeneous)

    def _placed(self, i: int, poses: Array) -> fcl.CollisionObject:
        self._objects[i].setTransform(fcl.Transform(poses[i, :3, :3], poses[i, :3, 3]))
        return self._objects[i]


def _read(name: str) -> tuple[pin.Model, dict[str, tuple[int, trimesh.Trimesh]]]:
    """Kinematics of a shipped URDF, and for each link with shapes its joint and its mesh in that joint's frame.

    A hand's links on one joint are one piece, called by the first of them.
    """
    path = str(LIBRARY / f"{name}.urdf")
    model = pin.buildModelFromUrdf(path)
    geometry = pin.buildGeomFromUrdf(model, path, pin.COLLISION, package_dirs=[str(make_models.SHARE)])
    is_robot = (LIBRARY / f"{name}.srdf").is_file()
    groups: dict[str, list[pin.GeometryObject]] = {}
    first: dict[int, str] = {}
    for entry in geometry.geometryObjects:
        link = model.frames[entry.parentFrame].name
        groups.setdefault(link if is_robot else first.setdefault(entry.parentJoint, link), []).append(entry)
    return model, {
        link: (
            int(members[0].parentJoint),
            trimesh.util.concatenate([_mesh(m).apply_transform(m.placement.homogeneous) for m in members]),
        )
        for link, members in groups.items()
    }


def _mesh(entry: pin.GeometryObject) -> trimesh.Trimesh:
    shape = entry.geometry
    match type(shape).__name__:
        case "Box":
            return trimesh.creation.box(2.0 * np.ravel(shape.halfSide))
        case "Cylinder":
            return trimesh.creation.cylinder(shape.radius, 2.0 * shape.halfLength, sections=SECTIONS)
        case "Sphere":
            return trimesh.creation.icosphere(4, shape.radius)
    return trimesh.load_mesh(entry.meshPath).apply_scale(np.ravel(entry.meshScale))


def _collision_object(mesh: trimesh.Trimesh) -> fcl.CollisionObject:
    bvh = fcl.BVHModel()
    bvh.beginModel(len(mesh.vertices), len(mesh.faces))
    bvh.addSubModel(mesh.vertices, mesh.faces)
    bvh.endModel()
    return fcl.CollisionObject(bvh, fcl.Transform())


def _collision_query() -> tuple[fcl.CollisionRequest, fcl.CollisionResult]:
    return fcl.CollisionRequest(), fcl.CollisionResult()
