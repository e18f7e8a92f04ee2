"""The cache: found by contents, safe against broken entries and folders."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from kumitate.grasping import planner, store
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


def test_that_there_are_no_grasps_is_cached_too(block, gripper, tmp_path, planned):
    heavy = replace(block, mass=1000.0)
    for _ in range(2):
        assert len(cached_grasps(heavy, gripper, folder=tmp_path)) == 0
    assert len(planned) == 1


# Entries that are not as they were written ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def truth(block, gripper):
    """What planning gives."""
    return planner.plan_grasps(block, gripper)


@pytest.fixture
def ask(block, gripper, truth, tmp_path, monkeypatch):
    """What comes through the cache, and whether it was planned; the planner answers with the truth at once."""
    runs = []
    monkeypatch.setattr(planner, "plan_grasps", lambda *args: runs.append(args) or truth)

    def answer(folder=tmp_path / "cache"):
        before = len(runs)
        return cached_grasps(block, gripper, folder=folder), len(runs) > before

    return answer


@pytest.fixture
def entry(ask, tmp_path):
    """The entry that the truth has in the cache."""
    assert ask()[1]
    (path,) = (tmp_path / "cache").iterdir()
    return path


def same(one, other):
    """Whether two sets have the same arrays, bit for bit."""
    arrays = [item.name for item in fields(GraspSet) if isinstance(getattr(one, item.name), np.ndarray)]
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays)


SPOILED = {
    "empty": lambda path, truth: path.write_bytes(b""),
    "half": lambda path, truth: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "one byte short": lambda path, truth: path.write_bytes(path.read_bytes()[:-1]),
    "random": lambda path, truth: path.write_bytes(np.random.default_rng(0).bytes(10_000)),
    "another format": lambda path, truth: np.savez(path, header=np.array('{"format": 99}')),
    "deep": lambda path, truth: np.savez(path, header=np.array("[" * 100_000)),
    "another key": lambda path, truth: replace(truth[:1], key="0" * 64).save(path),
    "the key itself": lambda path, truth: replace(truth[:1], key=truth.key).save(path),
    "fewer grasps": lambda path, truth: GraspSet.load(path)[:-1].save(path),
    "other numbers": lambda path, truth: replace(GraspSet.load(path), quality=truth.quality[::-1].copy()).save(path),
    "swapped arrays": lambda path, truth: replace(
        GraspSet.load(path), margin=truth.quality.copy(), quality=truth.margin.copy()
    ).save(path),
}


@pytest.mark.parametrize("spoil", SPOILED.values(), ids=SPOILED)
def test_a_spoiled_entry_is_planned_again_and_replaced(ask, entry, truth, block, gripper, spoil):
    spoil(entry, replace(truth, key=grasp_key(block, gripper, GraspParameters())))
    grasps, anew = ask()
    assert anew
    assert same(grasps, truth)
    grasps, anew = ask()
    assert not anew
    assert same(grasps, truth)
    assert list(entry.parent.iterdir()) == [entry]


def test_no_changed_byte_gives_a_wrong_answer(entry, truth, block, gripper, rng):
    whole, key = entry.read_bytes(), grasp_key(block, gripper, GraspParameters())
    end = len(whole) - 3000  # the directory of the file, and what leads there, are changed more often
    read = []
    for place in (*rng.integers(0, len(whole), 40), *rng.integers(end, len(whole), 40), *range(0, 200, 5)):
        spoiled = bytearray(whole)
        spoiled[place] ^= rng.integers(1, 256)
        entry.write_bytes(spoiled)
        read.append(store._read(entry, key))
    assert all(found is None or same(found, truth) for found in read)
    assert sum(found is None for found in read) > len(read) / 3  # the others do not matter, such as dates


def test_a_fifo_in_the_place_of_an_entry_does_not_hang(ask, entry, truth):
    entry.unlink()
    os.mkfifo(entry)
    assert ask()[1]
    assert not ask()[1]


def test_a_folder_in_the_place_of_an_entry_is_no_error(ask, entry, truth):
    entry.unlink()
    entry.mkdir()
    assert same(ask()[0], truth)
    assert list(entry.parent.iterdir()) == [entry]


# Folders --------------------------------------------------------------------------------------------------------------


def test_a_folder_that_cannot_be_is_no_error(ask, truth, tmp_path):
    (tmp_path / "file").write_text("in the way")
    for folder in (tmp_path / "file", tmp_path / "file" / "cache", tmp_path / ("x" * 300)):
        assert same(ask(folder)[0], truth)
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_folder_that_cannot_be_written_is_no_error(ask, entry, monkeypatch):
    def refuse(**where):
        raise PermissionError(13, "Permission denied")

    entry.write_bytes(b"spoiled")
    monkeypatch.setattr(store.tempfile, "mkstemp", refuse)
    assert ask()[1]
    assert ask()[1]
    assert entry.read_bytes() == b"spoiled"


def test_a_full_disk_is_no_error_and_leaves_nothing(ask, tmp_path):
    import resource
    import signal

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        assert ask()[1]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert list((tmp_path / "cache").iterdir()) == []


def test_what_killed_processes_left_goes_after_a_day(ask, entry):
    old, new = entry.with_name("tmpold.part"), entry.with_name("tmpnew.part")
    for left in (old, new):
        left.write_bytes(b"half")
    day_ago = time.time() - 90_000.0
    os.utime(old, (day_ago, day_ago))
    entry.unlink()
    ask()
    assert not old.exists()
    assert new.exists()


def test_processes_share_a_folder(entry, truth, tmp_path):
    """Two spoil, write and read one entry as fast as they can; neither ever gets anything but the truth."""
    truth.save(tmp_path / "truth.npz")
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "import numpy as np\n"
        "from kumitate.grasping import store\n"
        "from kumitate.grasping.grasps import GraspSet\n"
        "entry, truth = Path(sys.argv[1]), GraspSet.load(sys.argv[2])\n"
        "key, written = 'k' * 64, 0\n"
        "for turn in range(40):\n"
        "    found = store._read(entry, key)\n"
        "    if found is None:\n"
        "        store._write(store.replace(truth, key=store._seal(truth, key)), entry)\n"
        "        written += 1\n"
        "    else:\n"
        "        assert np.array_equal(found.part_from_hand, truth.part_from_hand) and found.key == key\n"
        "    if turn % 5 == int(sys.argv[3]):\n"
        "        entry.write_bytes(b'spoiled')\n"
        "print(written)\n"
    )
    running = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(entry), str(tmp_path / "truth.npz"), turn],
            stdout=subprocess.PIPE,
            text=True,
        )
        for turn in "13"
    ]
    assert [int(process.communicate()[0]) > 0 for process in running] == [True, True]
    assert [process.returncode for process in running] == [0, 0]
    assert list(entry.parent.iterdir()) == [entry]


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


def test_a_user_without_a_home_has_a_folder_too(monkeypatch, tmp_path):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    for name in ("KUMITATE_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    assert cache_folder().is_absolute()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert tmp_path in (cache_folder().parent, cache_folder())  # if this platform has the variable
