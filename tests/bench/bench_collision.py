"""Time of one state check, against python-fcl on full meshes, as a Markdown table.

Free states of two UR3 with two 2F-85, a table, a rack and five parts; half of them random, half within 5 cm of contact.
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
    kinds = {
        "random": free_ones(lambda n: rng.uniform(lower, upper, (n, len(lower)))),
        "within 5 cm of contact": free_ones(lambda n: reference.near_states(state, rng, n)),
    }
    kinds["both"] = np.concatenate(list(kinds.values()))
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
