"""Time of one state check, against python-fcl on full meshes, as a Markdown table.

Free states of two UR3 with two 2F-85, a table, a rack and five parts: random ones; those of them that python-fcl finds
within 5 cm of contact, between any two bodies that may touch; and states at the very border, bisected towards a
collision and turned a little.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

from cells import make_cell
from reference import Reference

RUNS = 7
STATES = 300


def main() -> None:
    scene, states = make_cell("ur3_dual")
    state = states[0]
    reference = Reference(scene)
    rng = np.random.default_rng(1)
    checker = scene.checker(state)

    def free_ones(draw):
        kept = []
        while len(kept) < STATES:
            kept += [q for q in draw(STATES) if not reference.touching(state, q, first_only=True)]
        return np.array(kept[:STATES])

    lower, upper = scene.robot.lower, scene.robot.upper

    def random(n):
        return rng.uniform(lower, upper, (n, len(lower)))

    def near(q):
        return min(reference.distances(state, q, 0.05).values(), default=1.0) < 0.05

    kinds = {
        "random": free_ones(random),
        "random, within 5 cm of contact": free_ones(lambda n: [q for q in random(n) if near(q)]),
        "at the border": free_ones(lambda n: reference.near_states(state, rng, n)),
    }
    drawn, close, border = kinds.values()
    kinds["random and within 5 cm, half and half"] = np.concatenate([drawn, close])
    kinds["random and at the border, half and half"] = np.concatenate([drawn, border])
    print("| free states | microseconds a state, median of runs | refused though the meshes are free |")
    print("|---|---|---|")
    for name, states_of_kind in kinds.items():
        seconds = []
        for _ in range(RUNS):
            start = time.perf_counter()
            answers = [checker.free(q) for q in states_of_kind]
            seconds.append((time.perf_counter() - start) / len(states_of_kind))
        print(f"| {name} | {1e6 * np.median(seconds):.1f} | {100 * (1 - np.mean(answers)):.1f}% |")


if __name__ == "__main__":
    main()
