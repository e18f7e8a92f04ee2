"""What must not change a plan: another process, more threads, a cache that has its grasps already."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
import trimesh

TASK = """\
robot: nextage
hands: {left: robotiq_2f85}
cell:
  - {name: table, box: [300 mm, 1320 mm, 20 mm], at: {xyz: [0.40, 0, -0.06]}, support: true}
parts:
  block: {mesh: block.stl, unit: mm, mass: 100 g, at: {xyz: [0.40, 0.30, 0.01]}}
goals:
  - place: {part: block, at: {xyz: [0.40, 0.20, 0.01]}}
"""
PLAN = "import sys, kumitate as km\nkm.plan(km.read_task(sys.argv[1]), sys.argv[2], seed=5).save(sys.argv[3])\n"


@pytest.mark.slow
def test_neither_threads_nor_a_warm_cache_nor_the_order_of_sets_change_a_plan(tmp_path):
    trimesh.creation.box([30, 30, 120]).export(tmp_path / "block.stl")
    (tmp_path / "task.yaml").write_text(TASK, encoding="utf-8")
    plans = []
    for cache, threads in (("one", "1"), ("one", "2"), ("two", "2")):  # cold, warm, cold
        environment = {
            **os.environ,
            "KUMITATE_CACHE": str(tmp_path / cache),
            "OPENBLAS_NUM_THREADS": threads,
            "OMP_NUM_THREADS": threads,
            "PYTHONHASHSEED": threads,
        }
        warm = (tmp_path / cache).exists()
        assert warm == (len(plans) == 1)
        arguments = [str(tmp_path / "task.yaml"), str(tmp_path), str(tmp_path / "plan.json")]
        subprocess.run([sys.executable, "-c", PLAN, *arguments], check=True, env=environment)
        plans.append(json.loads((tmp_path / "plan.json").read_bytes()))
        assert plans[-1].pop("seconds")
    assert plans[0] == plans[1] == plans[2]
