# ruff: noqa: E402 (the number of threads must be set before NumPy is imported)
"""Inverse kinematics in figures: ``python tests/bench/bench_ik.py`` prints tables, median CPU times on one thread."""

from __future__ import annotations

import os

for threads in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[threads] = "1"

import sysconfig
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from kumitate.robots import library
from kumitate.robots.chain import Chain
from kumitate.robots.ik import IKSolutions, IKSolver, make_solver, track
from kumitate.robots.ik_newton import is_at, newton

RUNS = 7
BATCH = 500
TARGETS = 1000
DENSE_TARGETS, DENSE_SEEDS = 100, 400
LIBRARY = Path(library.__file__).parent
EXAMPLES = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots")
ARMS = {
    "UR3": (EXAMPLES / "ur_description/urdf/ur3_robot.urdf", "", "tool0"),
    "Nextage": (LIBRARY / "nextage.urdf", "LARM_", "left_flange"),
    "HRP-5P": (LIBRARY / "hrp5p.urdf", "left_", "left_flange"),
    "Panda": (EXAMPLES / "panda_description/urdf/panda.urdf", "panda_joint", "panda_hand_tcp"),
}


def load(name: str) -> Chain:
    path, prefix, tip = ARMS[name]
    model = pin.buildModelFromUrdf(str(path))
    chain = Chain.from_model(model, [joint for joint in model.names[1:] if joint.startswith(prefix)], tip)
    return replace(chain, lower=np.maximum(chain.lower, -np.pi), upper=np.minimum(chain.upper, np.pi))


def median_seconds(run: Callable[[], object]) -> float:
    run()
    seconds = []
    for _ in range(RUNS):
        start = time.process_time()
        run()
        seconds.append(time.process_time() - start)
    return float(np.median(seconds))


def solve_in_batches(solver: IKSolver, targets: np.ndarray) -> list[IKSolutions]:
    return [solver(targets[start : start + BATCH]) for start in range(0, len(targets), BATCH)]


def solved(batches: list[IKSolutions]) -> float:
    return float(np.concatenate([batch.solved for batch in batches]).mean())


def branch_recall(solver: IKSolver, targets: np.ndarray) -> tuple[float, int]:
    """Share of the configurations from damped least squares out of many random ones that the solver gives too."""
    rng = np.random.default_rng(1)
    solutions, found, total = solver(targets), 0, 0
    for i, target in enumerate(targets):
        goals = np.broadcast_to(target, (DENSE_SEEDS, 4, 4))
        q = newton(solver.chain, solver.chain.random(rng, DENSE_SEEDS), goals, 40)
        q = q[is_at(solver.chain, q, goals)]
        while len(q):
            total += 1
            found += bool((np.abs(solutions.of(i) - q[0]).max(axis=1, initial=0.0) < 1e-3).any())
            q = q[np.abs(q - q[0]).max(axis=1) > 1e-3]
    return found / total, total


def main() -> None:
    rng = np.random.default_rng(2026)
    print(f"{TARGETS} random reachable poses in batches of {BATCH}, every answer checked by forward kinematics\n")
    print("| arm | solver | microseconds a target | solved | answers a target | out of reach, microseconds a target |")
    print("|---|---|---|---|---|---|")
    chains = {name: load(name) for name in ARMS}
    solvers = {name: make_solver(chain) for name, chain in chains.items()}
    targets = {name: chain.forward(chain.random(rng, TARGETS)) for name, chain in chains.items()}
    for name, solver in solvers.items():
        batches = solve_in_batches(solver, targets[name])
        near = 1e6 * median_seconds(lambda solver=solver, name=name: solve_in_batches(solver, targets[name])) / TARGETS
        away = targets[name].copy()
        away[:, :3, 3] *= 1.5
        away = away[np.concatenate([~batch.solved for batch in solve_in_batches(solver, away)])]
        far = 1e6 * median_seconds(lambda solver=solver, away=away: solve_in_batches(solver, away)) / len(away)
        answers = sum(len(batch.q) for batch in batches) / TARGETS
        family = type(solver.family).__name__
        print(f"| {name} | {family} | {near:.1f} | {solved(batches):.1%} | {answers:.2f} | {far:.1f} |")

    print(f"\nBranches of {DENSE_TARGETS} targets that damped least squares from {DENSE_SEEDS} random starts finds\n")
    print("| arm | branches | also given |\n|---|---|---|")
    for name in ("UR3", "Nextage"):
        recall, total = branch_recall(solvers[name], targets[name][:DENSE_TARGETS])
        print(f"| {name} | {total} | {recall:.1%} |")

    print("\n1000 straight lines of 10 poses, 5 mm apart, from random configurations\n")
    print("| arm | ms in all | followed to the end |\n|---|---|---|")
    for name, chain in chains.items():
        q = chain.random(rng, 1000)
        direction = rng.normal(size=(1000, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        lines = np.tile(chain.forward(q), (10, 1, 1, 1))
        lines[..., :3, 3] += 0.005 * np.arange(1, 11)[:, None, None] * direction
        _, reached = track(chain, q, lines)
        seconds = median_seconds(lambda chain=chain, q=q, lines=lines: track(chain, q, lines))
        print(f"| {name} | {1e3 * seconds:.0f} | {(reached == 10).mean():.1%} |")


if __name__ == "__main__":
    main()
