"""Whole plans: what every grasp promises, checked by coal and formulas of its own; records; the mesh's quality."""

from __future__ import annotations

import coal
import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from kumitate.grasping.facets import segment
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.hand import Hand

DEFAULTS = GraspParameters()
PAPER_ROWS = ["segmentation", "sampling", "refinement 1", "refinement 2", "contact pairs"]


def rows(grasps):
    return {stage.name: stage for stage in grasps.record}


SLACK = np.radians(0.2)
NUDGE = 2e-5  # m: a face this far out is free, this far in touches


def bvh(mesh: trimesh.Trimesh) -> coal.BVHModelOBBRSS:
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.asarray(mesh.vertices, dtype=float))
    model.addTriangles(np.asarray(mesh.faces, dtype=np.int64))
    model.endModel()
    return model


def touches(body, pose: np.ndarray, part: coal.BVHModelOBBRSS) -> bool:
    at = coal.Transform3s(np.array(pose[:3, :3]), np.array(pose[:3, 3]))
    return bool(coal.collide(body, at, part, coal.Transform3s(), coal.CollisionRequest(), coal.CollisionResult()))


def pad_box_touches(part, pad_pose: np.ndarray, size, low: float, high: float) -> bool:
    """Whether the box over a pad's face from ``low`` to ``high`` along its normal (towards the part) meets the part."""
    pose = pad_pose.copy()
    pose[:3, 3] += pose[:3, 0] * (low + high) / 2.0
    return touches(coal.Box(high - low, *size), pose, part)


def eccentricity(radius: float, h_max: float, pad_radius: float) -> float:
    """Eq. 2 under eq. 3 by numerical integration; a flat surface is one of 100 m radius."""
    radius = min(radius, 100.0)
    h = min(h_max, radius)
    edge = min(np.sqrt(2.0 * radius * h - h**2), pad_radius)

    def depth(r):
        return np.sqrt(radius**2 - r**2) - (radius - h)

    return quad(lambda r: r * r * depth(r), 0.0, edge)[0] / quad(lambda r: r * depth(r), 0.0, edge)[0]


def faces_at(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """A triangle under each point (n,), -1 where none is within 0.1 micrometres."""
    a, b, c = np.swapaxes(mesh.triangles.view(np.ndarray), 0, 1)
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=-1)
    found = np.full(len(points), -1)
    for i, p in enumerate(points):
        on_plane = np.abs(np.sum((p - a) * normal, axis=-1)) < 1e-7 * area
        sides = [np.sum(np.cross(v - u, p - u) * normal, axis=-1) for u, v in ((a, b), (b, c), (c, a))]
        inside = on_plane & (np.min(sides, axis=0) > -1e-9 * area)
        if inside.any():
            found[i] = np.argmax(np.where(inside, np.min(sides, axis=0), -np.inf))
    return found


def check_two_finger_grasps(part: Part, hand: Hand, parameters: GraspParameters, grasps: GraspSet, radii) -> None:
    """Every promise of a two-finger grasp, on the actual mesh; ``radii`` are the facets' radii of curvature."""
    solid = bvh(part.mesh)
    pieces = [bvh(piece.mesh) for piece in hand.pieces]
    at_grasp, loose = grasps.opening, grasps.opening + 2.0 * parameters.contact_tolerance
    assert np.all((at_grasp >= hand.stroke[0]) & (loose <= hand.stroke[1] + 1e-9))
    assert np.all(grasps.approach_opening <= hand.stroke[1] + 1e-9)

    # Contacts lie on the surface, and the mesh's own normals there oppose each other and the closing axis.
    face = faces_at(part.mesh, grasps.contacts.reshape(-1, 3))
    assert np.all(face >= 0)
    on_mesh = part.mesh.face_normals[face].reshape(-1, 2, 3)
    assert np.abs(np.sum(on_mesh * grasps.normals, axis=-1) - 1.0).max() < 1e-6
    axis = grasps.contacts[:, 1] - grasps.contacts[:, 0]
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    least = np.cos(np.pi - parameters.theta_parl + SLACK)
    assert np.all(-np.sum(on_mesh[:, 0] * on_mesh[:, 1], axis=-1) >= least)
    assert np.all(-np.sum(on_mesh[:, 0] * axis, axis=-1) >= least)
    assert np.all(np.sum(on_mesh[:, 1] * axis, axis=-1) >= least)
    assert np.abs(np.sum(grasps.part_from_hand[:, :3, 0] * axis, axis=-1) - 1.0).max() < 1e-9

    part_from_base = grasps.part_from_hand @ np.linalg.inv(hand.base_from_hand(at_grasp))
    pads = grasps.part_from_hand[:, None] @ hand.hand_from_pad(at_grasp)
    for i in range(len(grasps)):
        # Each pad stands where its whole face first touches, and within h_max of its contact.
        travel = (hand.stroke[1] - at_grasp[i]) / 2.0
        for side, pad in enumerate(hand.pads):
            pose, contact = pads[i, side], grasps.contacts[i, side]
            stand_off = np.dot(contact - pose[:3, 3], pose[:3, 0])
            assert -1e-6 <= stand_off <= parameters.h_max + 1e-5
            across = (contact - pose[:3, 3]) @ pose[:3, 1:3]
            assert np.all(np.abs(across) <= np.array(pad.size) / 2.0)
            assert not pad_box_touches(solid, pose, pad.size, -travel, -NUDGE)
            assert pad_box_touches(solid, pose, pad.size, -NUDGE, NUDGE)
        # The hand is free of the part where it grasps and where it approaches.
        for opening in (loose[i], grasps.approach_opening[i]):
            poses = part_from_base[i] @ hand.base_from_piece([opening])[0]
            assert not any(touches(piece, pose, solid) for piece, pose in zip(pieces, poses, strict=True))

    # Eq. 4, with the centre of the contacts and the weaker contact.
    weight, friction_force = part.mass * 9.80665, hand.friction * hand.grip_force
    assert weight < friction_force
    lever = np.linalg.norm(grasps.contacts.mean(axis=1) - part.center_of_mass, axis=-1)
    for i in range(len(grasps)):
        e_n = min(eccentricity(radii[f], parameters.h_max, min(hand.pads[0].size) / 2.0) for f in grasps.facets[i])
        assert (weight * lever[i]) ** 2 <= e_n**2 * (friction_force**2 - weight**2) * 1.05


def distinct(grasps: GraspSet, distance: float, angle: float) -> int:
    """How many grasps are left when those within ``distance`` and ``angle`` of a kept one go."""
    kept: list[int] = []
    approach = grasps.part_from_hand[:, :3, 2]
    for i in range(len(grasps)):
        near = np.linalg.norm(grasps.contacts[kept] - grasps.contacts[i], axis=-1).max(axis=-1, initial=0.0) <= distance
        turned = np.arccos(np.clip(approach[kept] @ approach[i], -1.0, 1.0)) <= angle
        if not np.any(near & turned):
            kept.append(i)
    return len(kept)


@pytest.mark.parametrize("name", ["block", "tube", "bracket", "ball"])
def test_every_grasp_of_a_made_part_keeps_its_promises(gripper, name, made):
    part = made(name)
    grasps = plan_grasps(part, gripper)
    assert len(grasps) > 20
    radii = segment(part, DEFAULTS.theta_pln, DEFAULTS.theta_fct).radius
    check_two_finger_grasps(part, gripper, DEFAULTS, grasps.thin(120), radii)


@pytest.mark.parametrize(
    "name", ["housing", "planewheel", "ttube", "sandpart", "bunnysim", "tool_motordriver", "tool2"]
)
def test_every_grasp_of_a_paper_object_keeps_its_promises(gripper, paper_objects, name):
    part = Part.load(paper_objects / f"{name}.stl", unit="m", density=1000.0)
    grasps = plan_grasps(part, gripper)
    assert len(grasps) > 100
    radii = segment(part, DEFAULTS.theta_pln, DEFAULTS.theta_fct).radius
    check_two_finger_grasps(part, gripper, DEFAULTS, grasps.thin(120), radii)


@pytest.mark.parametrize(
    ("name", "at_least"),
    [("planewheel", 942), ("planefrontstay", 508), ("ttube", 304), ("sandpart", 370), ("tool_motordriver", 1488)],
)
def test_at_least_as_many_distinct_grasps_as_the_papers_later_system(gripper, paper_objects, name, at_least):
    part = Part.load(paper_objects / f"{name}.stl", unit="m", density=1000.0)
    grasps = plan_grasps(part, gripper)
    one_way = grasps[one_way_round(grasps)]
    assert len(one_way) == rows(grasps)["both ways round"].taken
    assert distinct(one_way, DEFAULTS.t_rnn, np.radians(20.0)) >= at_least


def one_way_round(grasps) -> np.ndarray:
    """Mask of one of every two grasps that differ by swapped fingers only."""
    key = np.sort(np.round(grasps.contacts @ [1.0, 3.7, 9.1], 9), axis=1)
    unswapped = np.round(np.concatenate([key, grasps.part_from_hand[:, :3, 2]], axis=1), 6)
    mask = np.zeros(len(grasps), dtype=bool)
    mask[np.unique(unswapped, axis=0, return_index=True)[1]] = True
    return mask


def test_the_record_follows_the_candidates_through_the_stages(gripper, made):
    record = plan_grasps(made("bracket"), gripper).record
    assert [s.name for s in record] == [
        *PAPER_ROWS,
        "stroke collision",
        "pad standing",
        "hand collision",
        "stability",
        "closing fingers",
        "both ways round",
    ]
    stages = {s.name: s for s in record}
    assert stages["stroke collision"].taken == stages["contact pairs"].kept
    assert stages["pad standing"].taken == DEFAULTS.n_da * stages["stroke collision"].kept
    assert stages["hand collision"].taken == stages["pad standing"].kept
    assert stages["stability"].taken == stages["hand collision"].kept
    assert stages["closing fingers"].taken == stages["stability"].kept
    assert stages["both ways round"].kept == 2 * stages["closing fingers"].kept
    for stage in record[5:-1]:
        assert stage.taken == stage.kept + sum(stage.dropped.values())


def test_the_best_grasp_comes_first_and_a_plan_repeats_exactly(gripper, made):
    part = made("bracket")
    one, two = plan_grasps(part, gripper), plan_grasps(part, gripper)
    assert np.all(np.diff(one.quality) <= 0.0)
    assert np.all((one.quality >= 0.0) & (one.quality <= 1.0))
    assert np.array_equal(one.part_from_hand, two.part_from_hand)


def test_a_part_wider_than_the_stroke_has_no_grasp_and_the_record_says_so(gripper):
    grasps = plan_grasps(Part.from_mesh(trimesh.creation.box([0.1, 0.1, 0.1]), mass=0.5), gripper)
    assert len(grasps) == 0
    assert grasps.contacts.shape == (0, 2, 3)
    assert rows(grasps)["stroke collision"].dropped["wider than the hand opens"] > 0


def test_a_part_too_heavy_to_hold_has_no_grasp_and_the_record_says_so(gripper, made):
    grasps = plan_grasps(Part.from_mesh(made("block").mesh, mass=6.0), gripper)
    assert len(grasps) == 0
    assert rows(grasps)["stability"].taken > 0
    assert rows(grasps)["stability"].dropped["turns under gravity"] == rows(grasps)["stability"].taken


def decimated(mesh: trimesh.Trimesh, shares) -> list[trimesh.Trimesh]:
    """The mesh simplified to shares of its faces, by bisection over the simplifier's tolerance."""
    manifold3d = pytest.importorskip("manifold3d", reason="decimates the mesh")
    corners, faces = np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
    solid = manifold3d.Manifold(manifold3d.Mesh(vert_properties=corners, tri_verts=faces))
    levels = []
    for share in shares:
        low, high = 1e-7, 5e-3
        for _ in range(20):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if solid.simplify(middle).num_tri() > share * len(faces) else (low, middle)
        level = solid.simplify(high).to_mesh()
        levels.append(trimesh.Trimesh(level.vert_properties[:, :3], level.tri_verts, process=False))
    return levels


@pytest.mark.slow
def test_the_meshs_quality_matters_little(gripper, paper_objects):
    """The paper's experiment (V.B.2) and its spans; tests/bench/bench_grasps.py prints all eight levels."""
    part = Part.load(paper_objects / "planerearstay.stl", unit="m", density=1000.0)
    meshes = [part.mesh, *decimated(part.mesh, (0.5, 0.35, 0.25, 0.18, 0.12))]
    assert len(meshes[-1].faces) < 0.13 * len(meshes[0].faces)
    for theta_parl, span in ((160.0, 4), (140.0, 6)):
        wanted = GraspParameters(theta_parl=np.radians(theta_parl))
        counts = [len(plan_grasps(Part.from_mesh(m, mass=part.mass), gripper, wanted)) for m in meshes[:span]]
        assert counts[0] > 100
        assert all(abs(n - counts[0]) <= 0.25 * counts[0] for n in counts), counts
