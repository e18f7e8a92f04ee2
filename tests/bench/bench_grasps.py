# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""Grasp planning in figures: ``python tests/bench/bench_grasps.py`` prints tables, best CPU times of a few runs."""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import resource
import sys
import tempfile
import time
from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import trimesh

import kumitate as km
from kumitate.grasping.suction import plan_suction  # noqa: F401 (loads what planning needs, so that no run pays for it)

RUNS = 3
HERE = Path(__file__).resolve()
OBJECTS = Path(os.environ.get("KUMITATE_OBJECTS", HERE.parents[3] / "shared" / "objects"))
# Seconds promised, and grasps that WRS finds at its defaults (its rotations are 22.5 deg apart, ours 45).
TWO_FINGER = {
    "housing": (1.0, 742),
    "planewheel": (1.0, 942),
    "ttube": (1.0, 304),
    "sandpart": (1.0, 370),
    "bunnysim": (1.0, 238),
    "tool_motordriver": (1.0, 1488),
    "tool2": (2.0, None),
    "planefrontstay": (3.0, 508),
    "planerearstay": (3.0, None),
}
SHARES = (1.0, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.055)
SHORT = {
    "segmentation": "segm.",
    "sampling": "sampl.",
    "refinement 1": "ref. 1",
    "refinement 2": "ref. 2",
    "contact pairs": "pairs",
    "stroke collision": "stroke",
    "pad standing": "stand",
    "seal": "seal",
    "hand collision": "hand",
    "stability": "stab.",
    "closing fingers": "close",
}


def load(name: str) -> km.Part:
    return km.Part.load(OBJECTS / f"{name}.stl", unit="m", density=1000.0)


def timed(part: km.Part, hand: km.Hand, parameters: km.GraspParameters | None = None) -> tuple[float, km.GraspSet]:
    """Least CPU time [s] of a few runs, and the grasps."""
    best = np.inf
    for _ in range(RUNS):
        started = time.process_time()
        grasps = km.plan_grasps(part, hand, parameters)
        best = min(best, time.process_time() - started)
    return best, grasps


def one_way(grasps: km.GraspSet) -> int:
    """Grasps before the fingers are swapped."""
    return {s.name: s for s in grasps.record}["closing fingers"].kept


def distinct(grasps: km.GraspSet, distance: float = 3e-3, angle: float = radians(20.0)) -> int:
    """Grasps that differ by more than ``distance`` at a contact or by ``angle``; swapped ones are the same."""
    kept: list[int] = []
    approach, contacts = grasps.part_from_hand[:, :3, 2], grasps.contacts
    for i in range(len(grasps)):
        near = np.zeros(len(kept), dtype=bool)
        for turned in (contacts[i], contacts[i, ::-1]):
            near |= np.linalg.norm(contacts[kept] - turned, axis=-1).max(axis=-1, initial=0.0) <= distance
        if not np.any(near & (np.arccos(np.clip(approach[kept] @ approach[i], -1.0, 1.0)) <= angle)):
            kept.append(i)
    return len(kept)


def two_finger_table() -> None:
    hand = km.load_hand("robotiq_2f85")
    names = [name for name in SHORT if name != "seal"]
    print("### robotiq_2f85, default parameters\n")
    print("| object | faces | facets | contacts | pairs | grasps | distinct | WRS | n_da 16 | s | at most", end=" | ")
    print(*(SHORT[n] for n in names), sep=" | ", end=" |\n")
    print("|---" * (11 + len(names)) + "|")
    for name, (limit, wrs) in TWO_FINGER.items():
        part = load(name)
        seconds, grasps = timed(part, hand)
        stages = {s.name: s for s in grasps.record}
        finer = one_way(km.plan_grasps(part, hand, km.GraspParameters(n_da=16)))
        counts = [stages[n].kept for n in ("segmentation", "refinement 2", "contact pairs")]
        cells = [name, len(part.mesh.faces), *counts, one_way(grasps), distinct(grasps), wrs or "-", finer]
        cells += [f"{seconds:.2f}", f"{limit:.1f}", *(f"{stages[n].seconds:.3f}" for n in names)]
        print("| " + " | ".join(str(cell) for cell in cells) + " |", flush=True)


def other_hands_table() -> None:
    cup, three = km.load_hand("suction_cup"), km.load_hand("hrp5p_three_finger")
    cases = [
        ("sandpart", "suction_cup, lip 8 mm", cup, 0.5),
        ("sandpart", "suction_cup, lip 30 mm", replace(cup, lip=replace(cup.lip, radius=0.03)), 0.5),
        ("ttube", "hrp5p_three_finger", three, 2.0),
    ]
    print("\n### other hands\n\n| object | hand | grasps | s | at most | stages: kept (dropped) |")
    print("|---|---|---|---|---|---|")
    for name, label, hand, limit in cases:
        seconds, grasps = timed(load(name), hand)
        stages = "; ".join(f"{s.name} {s.kept} {dict(s.dropped) or ''}".strip() for s in grasps.record[3:])
        print(f"| {name} | {label} | {len(grasps)} | {seconds:.2f} | {limit:.1f} | {stages} |", flush=True)


def cache_table() -> None:
    hand = km.load_hand("robotiq_2f85")
    print("\n### from the cache, ms (at most 20)\n\n| object | grasps | ms |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in ("planewheel", "tool2", "planerearstay"):
            part = load(name)
            km.cached_grasps(part, hand, folder=folder)
            times = []
            for _ in range(5):
                started = time.process_time()
                grasps = km.cached_grasps(part, hand, folder=folder)
                times.append(time.process_time() - started)
            print(f"| {name} | {len(grasps)} | {np.median(times) * 1e3:.1f} |", flush=True)


def decimated(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Eight levels: shares of the faces, by bisection over the simplifier's tolerance."""
    import manifold3d

    corners, faces = np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
    solid = manifold3d.Manifold(manifold3d.Mesh(vert_properties=corners, tri_verts=faces))
    levels = [mesh]
    for share in SHARES[1:]:
        low, high = 1e-7, 5e-3
        for _ in range(20):
            middle = np.sqrt(low * high)
            low, high = (middle, high) if solid.simplify(middle).num_tri() > share * len(faces) else (low, middle)
        level = solid.simplify(high).to_mesh()
        levels.append(trimesh.Trimesh(level.vert_properties[:, :3], level.tri_verts, process=False))
    return levels


def mesh_quality_table(name: str) -> None:
    """The paper's experiment (section V.B.2): grasps one way round, and CPU seconds of each stage at 160 deg."""
    hand, part = km.load_hand("robotiq_2f85"), load(name)
    names = [n for n in SHORT if n != "seal"]
    print(f"\n### quality of the mesh: {name}\n")
    print("| level | faces | grasps 160 | share | grasps 140 | share | " + " | ".join(SHORT[n] for n in names) + " |")
    print("|---" * (6 + len(names)) + "|")
    first: list[int] = []
    for level, mesh in enumerate(decimated(part.mesh), start=1):
        coarse = km.Part.from_mesh(mesh, mass=part.mass)
        _, strict = timed(coarse, hand)
        counts = [one_way(strict), one_way(km.plan_grasps(coarse, hand, km.GraspParameters(theta_parl=radians(140.0))))]
        first = first or counts
        shares = [n / m for n, m in zip(counts, first, strict=True)]
        stages = {s.name: s.seconds for s in strict.record}
        cells = [level, len(coarse.mesh.faces), counts[0], f"{shares[0]:.2f}", counts[1], f"{shares[1]:.2f}"]
        print("| " + " | ".join(str(c) for c in [*cells, *(f"{stages[n]:.3f}" for n in names)]) + " |", flush=True)


def main() -> None:
    if not (OBJECTS / "housing.stl").is_file():
        sys.exit("the paper's meshes are not here; KUMITATE_OBJECTS names their folder")
    two_finger_table()
    other_hands_table()
    cache_table()
    for name in ("planerearstay", "housing"):
        mesh_quality_table(name)
    print(f"\nlargest memory: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MiB")


if __name__ == "__main__":
    main()
