"""The cache: found by contents, safe against broken entries and folders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from kumitate.grasping import planner
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.store import cache_folder, cached_grasps, grasp_key
from kumitate.robots.library import load_hand


@pytest.fixture
def planned(monkeypatch):
    """How often the planner ran."""
    runs = []
    plan = planner.plan_grasps
    monkeypatch.setattr(planner, "plan_grasps", lambda *args: runs.append(args) or plan(*args))
    return runs


def test_the_second_run_takes_it_from_the_cache(block, gripper, tmp_path, planned):
    first = cached_grasps(block, gripper, folder=tmp_path)
    second = cached_grasps(block, gripper, folder=tmp_path)
    assert len(planned) == 1
    assert np.array_equal(first.part_from_hand, second.part_from_hand)
    assert second.record == first.record
    assert len(list(tmp_path.iterdir())) == 1


def test_a_broken_entry_is_planned_again_and_replaced(block, gripper, tmp_path, planned):
    first = cached_grasps(block, gripper, folder=tmp_path)
    (entry,) = tmp_path.iterdir()
    for spoiled in (b"", entry.read_bytes()[:500]):
        entry.write_bytes(spoiled)
        assert len(cached_grasps(block, gripper, folder=tmp_path)) == len(first)
        assert len(GraspSet.load(entry)) == len(first)
    assert len(planned) == 3


def test_an_entry_of_another_key_is_not_believed(block, gripper, tmp_path, planned):
    first = cached_grasps(block, gripper, folder=tmp_path)
    (entry,) = tmp_path.iterdir()
    replace(first[:1], key="0" * 64).save(entry)
    assert len(cached_grasps(block, gripper, folder=tmp_path)) == len(first)


def test_a_folder_that_cannot_be_written_is_no_error(block, gripper, tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("in the way")
    assert len(cached_grasps(block, gripper, folder=blocked / "cache")) > 0


def test_the_key_follows_everything_that_decides_the_grasps(block, gripper):
    base = GraspParameters()
    moved = trimesh.Trimesh(block.mesh.vertices + 1e-6, block.mesh.faces, process=False)
    keys = [
        grasp_key(block, gripper, base),
        grasp_key(block, gripper, replace(base, n_da=9)),
        grasp_key(block, gripper, replace(base, h_max=1e-3)),
        grasp_key(replace(block, mass=0.2), gripper, base),
        grasp_key(replace(block, center_of_mass=np.array([0.0, 0.0, 1e-3])), gripper, base),
        grasp_key(Part.from_mesh(moved, mass=0.1), gripper, base),
        grasp_key(block, replace(gripper, grip_force=50.0), base),
        grasp_key(block, replace(gripper, friction=0.4), base),
        grasp_key(block, replace(gripper, contact_depth=0.01), base),
        grasp_key(block, replace(gripper, pieces=gripper.pieces[:-1]), base),
        grasp_key(block, load_hand("suction_cup"), base),
    ]
    assert len(set(keys)) == len(keys)
    assert grasp_key(replace(block, name="other"), load_hand("robotiq_2f85"), GraspParameters()) == keys[0]


def test_the_folder_can_be_named(monkeypatch, tmp_path):
    monkeypatch.setenv("KUMITATE_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("KUMITATE_CACHE")
    assert cache_folder().name in ("kumitate", "cache")
