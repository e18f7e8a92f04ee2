"""A second opinion on collisions, and scenes to ask it about.

`Reference` shares nothing with the package's checker: it reads URDF and SRDF by itself, moves the bodies by pinocchio,
and lets python-fcl decide on full triangle meshes.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import fcl
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import kumitate.robots.library
from kumitate.robots.library import load_robot, make_models
from kumitate.robots.scene import Scene
from kumitate.robots.state import Body, SceneState
from kumitate.transforms import Array, invert, pose, transform_points

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


def _prism(outline: list[tuple[float, float]], tiles: list[tuple[int, ...]], height: float) -> trimesh.Trimesh:
    """A closed prism along z over a polygon, counter-clockwise, that convex ``tiles`` of its corners fill."""
    flat, n = np.array(outline), len(outline)
    vertices = np.vstack([np.column_stack([flat, np.full(n, z)]) for z in (-height / 2.0, height / 2.0)])
    cap = np.array([(a, b, c) for a, *rest in tiles for b, c in itertools.pairwise(rest)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    sides = np.vstack([np.column_stack([i, j, j + n]), np.column_stack([i, j + n, i + n])])
    return trimesh.Trimesh(vertices, np.vstack([cap[:, ::-1], cap + n, sides]))


def _bracket(side: float, thickness: float, height: float) -> trimesh.Trimesh:
    """An L of two plates along x and y, its outer corner at the origin, ``height`` along z."""
    s, t = side, thickness
    return _prism([(0, 0), (s, 0), (s, t), (t, t), (t, s), (0, s)], [(0, 1, 2, 3), (0, 3, 4, 5)], height)


def _fork(side: float, thickness: float, height: float) -> trimesh.Trimesh:
    """A U, open along +y, about the origin; ``height`` along z."""
    a, b = side / 2.0, side / 2.0 - thickness
    outline = [(-a, -a), (a, -a), (a, a), (b, a), (b, -b), (-b, -b), (-b, a), (-a, a)]
    return _prism(outline, [(0, 1, 4, 5), (1, 2, 3, 4), (0, 5, 6, 7)], height)


def _wheel(bore: float, radius: float, width: float) -> trimesh.Trimesh:
    """A thin disc with a thick hub and a thick rim about z, a bore through the hub."""
    hub, rim, web = bore + 0.2 * (radius - bore), bore + 0.8 * (radius - bore), width / 4.0
    half = [(bore, width), (hub, width), (hub, web), (rim, web), (rim, width), (radius, width)]
    profile = [(r, z / 2.0) for r, z in half] + [(r, -z / 2.0) for r, z in reversed(half)]
    return trimesh.creation.revolve(np.array([*profile, profile[0]]), sections=48)


def _bossed(size: float, at: float, rise: float, height: float) -> trimesh.Trimesh:
    """A square block whose face at +x has a boss, ``rise`` high, where y is above ``at``; ``height`` along z."""
    a = size / 2.0
    outline = [(-a, -a), (a, -a), (a, at), (a + rise, at), (a + rise, a), (-a, a), (-a, at)]
    return _prism(outline, [(0, 1, 2, 6), (2, 3, 4, 5, 6)], height)


MAKERS: dict[str, Callable[..., trimesh.Trimesh]] = {
    "bracket": _bracket,
    "fork": _fork,
    "bossed": _bossed,
    "wheel": _wheel,
    "ring": lambda bore, radius, width: trimesh.creation.annulus(bore, radius, width, sections=64),
}


@pytest.fixture(scope="session")
def make_mesh() -> Callable[..., trimesh.Trimesh]:
    """Closed non-convex meshes by kind and sizes: see the functions above."""
    return lambda kind, *sizes: MAKERS[kind](*sizes)


@pytest.fixture(scope="session")
def reference() -> Callable[[Scene], Reference]:
    """Makes the reference of a scene of a shipped robot."""
    return Reference


def _bodies(table: float) -> list[Body]:
    return [
        Body.box("table", (0.6, 1.2, 0.06), fixed=True),
        Body.from_mesh("rack", _fork(0.25, 0.03, 0.3), fixed=True),
        Body.from_mesh("bracket", _bracket(0.06, 0.012, 0.05)),
        Body.from_mesh("ring", MAKERS["ring"](0.022, 0.03, 0.06)),
        Body.from_mesh("fork", _fork(0.1, 0.015, 0.04)),
        Body.from_mesh("wheel", _wheel(0.01, 0.06, 0.03)),
        Body.box("block", (0.03, 0.05, 0.1)),
    ]


CELLS = {
    "ur3_dual": ({"left": "robotiq_2f85", "right": "robotiq_2f85"}, (0.75, 0.0, 1.05)),
    "nextage": ({"left": "robotiq_2f85", "right": "suction_cup"}, (0.5, 0.0, -0.08)),
    "hrp5p": ({"left": "hrp5p_three_finger", "right": "robotiq_2f85"}, (0.6, 0.0, 0.1)),
}


@pytest.fixture(scope="session")
def cell() -> Callable[[str], tuple[Scene, list[SceneState]]]:
    """A robot with hands, a table, a rack and five parts; and states of it in which no two still bodies touch."""
    return _cell


def _cell(name: str) -> tuple[Scene, list[SceneState]]:
    hands, table = CELLS[name]
    robot = load_robot(name, hands)
    scene = Scene.of(robot, _bodies(table[2]))
    x, y, z = table
    top = z + 0.03
    lying = scene.state(
        {
            "table": pose(table),
            "rack": pose((x + 0.05, y - 0.3, top + 0.15), (0.0, 0.0, 0.3)),
            "bracket": pose((x, y + 0.1, top + 0.027)),
            "ring": pose((x - 0.1, y, top + 0.032)),
            "fork": pose((x - 0.15, y + 0.3, top + 0.022), (0.0, 0.0, 1.0)),
            "wheel": pose((x + 0.1, y + 0.3, top + 0.017)),
            "block": pose((x + 0.15, y, top + 0.052)),
        }
    )
    floating = scene.state(
        {
            **lying.poses,
            "bracket": pose((x - 0.1, y + 0.25, top + 0.3), (0.4, 0.2, 0.1)),
            "fork": pose((x - 0.2, y, top + 0.25), (1.0, 0.3, 0.0)),
            "wheel": pose((x - 0.15, y - 0.2, top + 0.3), (0.2, 1.2, 0.0)),
        },
        openings={arm: hand.stroke[1] / 2.0 for arm, hand in robot.hands.items()},
    )
    # Parts held clear of the fingers; the wheel hangs on the ring, the ring on the right hand.
    held = lying
    grips = {
        "bracket": ("left", pose((-0.006, 0.0, 0.04), (-np.pi / 2.0, 0.0, 0.0))),
        "ring": ("right", pose((0.0, 0.0, 0.04))),
    }
    for body, (arm, hand_from_body) in grips.items():
        held = held.with_pose(body, robot.hand_pose(arm, held.q, held.openings[arm]) @ hand_from_body)
        held = scene.attach(held, body, arm)
    held = held.with_pose("wheel", scene.world_from_body(held, "ring") @ pose((0.0, 0.0, 0.05)))
    held = scene.attach(held, "wheel", "ring")
    return scene, [lying, floating, held]
