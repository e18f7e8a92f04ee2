"""The world of a trial in MuJoCo: a hand with its fingers and motor, a part that lies free, and a table.

The hand's base is the frame of the world: it stands still, and the table is moved away under it. All hands are built
from what ``Hand`` knows: pieces, joints and how the driver moves them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial import ConvexHull

from ..grasping.part import Part
from ..robots.hand import Hand
from ..robots.shapes import Shape
from ..transforms import Array, transform_points
from .surface import wedges

TIME_STEP = 2.5e-4  # s; with longer ones parts that are pushed drift by some tenths of a millimetre
TABLE_FRICTION = 0.3  # part on table
METAL_FRICTION = 0.3  # part on what carries no pad
_TORSION, _ROLLING = 3e-3, 1e-5  # m: where MuJoCo knows a point, bodies touch in a patch
SURFACE, _HULL = 0, 1  # groups of shapes: a ray may meet the surface of a part, and its hull is none
_TABLE, _FINGERS = 1, 2  # bits: what collides with the table, and with the hand
_METAL = 2700.0  # kg/m3
_ROTOR = 2e-4  # kg m2, or kg: what the motor moves, seen from each finger joint
_STIFF, _SOFT = (1e-3, 1.0), (2e-3, 1.0)  # time constant [s] and damping ratio of couplings and of contacts
_GEAR = (0.999, 0.9999, 1e-3, 0.5, 2.0)  # share of their error that couplings take away
_RUBBER = (0.95, 0.99, 2e-4, 0.5, 2.0)  # and contacts: they give by hundredths of a millimetre
_MEMORY = 1 << 28  # bytes for contacts: some hundred thousand; a hand may lie on thousands of pieces
_GAIN = 50.0  # of the motor's speed control: N m s/rad or N s/m
_LIP_BALLS, _LIP_BALL = 12, 5e-4  # balls that make a lip, and their radius [m]
_PRESS = 2e4  # N/m, and twice its square root N s/m: of the drive that brings a cup to the part


@dataclass(frozen=True, eq=False)
class World:
    """A model and where its things are.

    Attributes:
        model: MuJoCo's model.
        part: Body of the part.
        table: Body of the table.
        pads: Bodies that carry the pads, in the hand's order, or a cup's lip.
        joints: First address of the finger joints, or of the way of a cup along its approach, in ``qpos``.
        free: First address of the part in ``qpos``, and in ``qvel``.
        lip: Shapes of a cup's lip; none for fingers.
    """

    model: mujoco.MjModel
    part: int
    table: int
    pads: tuple[int, ...]
    joints: int
    free: tuple[int, int]
    lip: tuple[int, ...]


def build_world(part: Part, hand: Hand) -> World:
    """The world of trials of ``hand`` on ``part``."""
    spec = mujoco.MjSpec()
    spec.compiler.boundmass, spec.compiler.boundinertia = 1e-3, 1e-7  # joints that carry no shape
    spec.memory = _MEMORY
    option = spec.option
    option.timestep, option.integrator = TIME_STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
    table = spec.worldbody.add_body(name="table", mocap=True)
    _add_geom(table, "plane", [1.0, 1.0, 0.1], TABLE_FRICTION, contype=_TABLE, conaffinity=0)
    bodies = [spec.worldbody.add_body(name="base")]
    add_drive = _add_fingers if hand.pads else _add_cup
    add_drive(spec, bodies, hand)
    _add_shapes(spec, bodies, hand)
    _add_part(spec, part)
    model = spec.compile()
    joint = model.joint("part")
    return World(
        model=model,
        part=model.body("part").id,
        table=model.body("table").id,
        pads=tuple(model.body(bodies[pad.joint].name).id for pad in hand.pads) or (model.body("base").id,),
        joints=int(model.joint(hand.joint_names[0] if hand.pads else "press").qposadr[0]),
        free=(int(joint.qposadr[0]), int(joint.dofadr[0])),
        lip=tuple(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE).tolist()) if hand.lip else (),
    )


def _add_fingers(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], hand: Hand) -> None:
    """The fingers on their joints, the couplings between the joints, and the motor; adds a body a joint."""
    linkage = hand.mechanism
    for name, parent, placement, axis, slides in zip(
        hand.joint_names, linkage.parents[1:], linkage.placements[1:], linkage.axes, linkage.prismatic, strict=True
    ):
        body = bodies[parent].add_body(name=name, pos=placement[:3, 3], quat=quaternion(placement[:3, :3]))
        kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(name=name, type=kind, axis=axis, armature=_ROTOR)
        bodies.append(body)
    driver = hand.joint_names[linkage.leader]
    for name, factor, offset in zip(hand.joint_names, linkage.factors, linkage.offsets, strict=True):
        if name != driver:
            spec.add_equality(
                type=mujoco.mjtEq.mjEQ_JOINT, objtype=mujoco.mjtObj.mjOBJ_JOINT, name1=name, name2=driver,
                data=[offset, factor, *[0.0] * 10], solref=_STIFF, solimp=_GEAR,
            )  # fmt: skip
    motor = spec.add_actuator(name="motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=driver)
    motor.set_to_velocity(kv=_GAIN)
    motor.forcelimited, motor.forcerange = True, [-1.0, 1.0]  # each trial sets its own


def _add_cup(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], hand: Hand) -> None:
    """The drive along the approach, and the lip: a ring of balls that stand out by half of what it gives.

    Each pulls with its share of the vacuum's force; trials switch it off and on.
    """
    assert hand.lip is not None
    base, placement = bodies[0], hand.base_from_hand([0.0])[0]
    base.add_joint(name="press", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=placement[:3, 2], armature=_ROTOR)
    angles = 2.0 * np.pi * np.arange(_LIP_BALLS) / _LIP_BALLS
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(_LIP_BALLS)], axis=1) * (hand.lip.radius - _LIP_BALL)
    ring[:, 2] = hand.lip.compliance / 2.0 - _LIP_BALL
    for center in transform_points(placement, ring):
        _add_geom(
            base, "sphere", [_LIP_BALL, 0.0, 0.0], hand.friction, pos=center, contype=_FINGERS, conaffinity=_TABLE,
            adhesion=hand.lip.force / _LIP_BALLS, gap=hand.lip.compliance,  # it pulls on what has come off by less
        )  # fmt: skip
    press = spec.add_actuator(name="motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="press")
    press.set_to_position(kp=_PRESS, kv=2.0 * np.sqrt(_PRESS))
    press.forcelimited, press.forcerange = True, [-1.0, 1.0]


def _add_shapes(spec: mujoco.MjSpec, bodies: list[mujoco.MjsBody], hand: Hand) -> None:
    """What the bodies of the hand look like; rubber on those that carry a pad."""
    carriers = {pad.joint for pad in hand.pads}
    for piece in hand.pieces:
        friction = hand.friction if piece.joint in carriers else METAL_FRICTION
        for shape, placement in zip(piece.shapes, piece.placements, strict=True):
            _add_shape(spec, bodies[piece.joint], shape, placement, friction)


def _add_shape(spec: mujoco.MjSpec, body: mujoco.MjsBody, shape: Shape, placement: Array, friction: float) -> None:
    """A box or cylinder as it is, any other shape as its convex hull."""
    bits = {"contype": _FINGERS, "conaffinity": _TABLE, "pos": placement[:3, 3], "quat": quaternion(placement[:3, :3])}
    match shape.geometry:
        case coal.Box():
            _add_geom(body, "box", np.ravel(shape.geometry.halfSide), friction, **bits)
        case coal.Cylinder():
            size = [shape.geometry.radius, shape.geometry.halfLength, 0.0]
            _add_geom(body, "cylinder", size, friction, **bits)
        case _:
            name = f"{body.name} {len(body.geoms)}"
            _add_mesh(
                spec, body, name, shape.mesh.vertices, friction, mass=_METAL * shape.mesh.convex_hull.volume, **bits
            )


def _add_part(spec: mujoco.MjSpec, part: Part) -> None:
    """The part as a free body: its hull meets the table, its surface the hand."""
    solid = part.mesh if part.watertight else part.mesh.convex_hull
    inertia = solid.moment_inertia * (part.mass / solid.mass)  # about the centre of mass
    body = spec.worldbody.add_body(name="part", mass=part.mass, ipos=part.center_of_mass, explicitinertial=True)
    body.fullinertia = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    body.add_freejoint(name="part")
    points = part.mesh.vertices
    hull = points[ConvexHull(points).vertices]
    _add_mesh(spec, body, "hull", hull, 0.0, contype=0, conaffinity=_TABLE, mass=0.0, group=_HULL)
    for i, corners in enumerate(wedges(part.mesh)):
        _add_mesh(spec, body, f"wedge{i}", corners, 0.0, contype=0, conaffinity=_FINGERS, mass=0.0)


def _add_mesh(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, points: Array, friction: float, **given: Any
) -> None:
    """The hull of points (n, 3); thin ones are weighed as shells, which MuJoCo can always do."""
    spec.add_mesh(name=name, uservert=np.ravel(points), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    _add_geom(body, "mesh", [0.0, 0.0, 0.0], friction, meshname=name, **given)


def _add_geom(body: mujoco.MjsBody, kind: str, size: npt.ArrayLike, friction: float, **given: Any) -> None:
    """A shape whose friction counts where it meets one of friction 0, as the part's are."""
    body.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"), size=size, condim=4, solref=_SOFT, solimp=_RUBBER,
        friction=[friction, _TORSION if friction else 0.0, _ROLLING], density=_METAL, **given,
    )  # fmt: skip


def quaternion(rotation: Array) -> Array:
    """A rotation (3, 3) as MuJoCo's quaternion (4,): w, x, y, z."""
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(rotation).ravel())
    return quat
