"""Grasp sets: indexing, thinning, and files that say what is wrong with them."""

from __future__ import annotations

import io
import json
import os
import pickle
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from kumitate.errors import InputError
from kumitate.grasping.grasps import GraspSet
from kumitate.grasping.measured import Measured
from kumitate.grasping.planner import plan_grasps
from kumitate.robots.library import load_hand


@pytest.fixture(scope="module")
def grasps(block) -> GraspSet:
    return plan_grasps(block, load_hand("robotiq_2f85"))


@pytest.fixture(scope="module")
def simulated(grasps) -> GraspSet:
    """Two of three grasps were tried, half of those held; the shift tells which row it is [m]."""
    row = np.arange(len(grasps))
    tried = row % 3 > 0
    none = np.zeros(len(grasps))
    return replace(grasps, measured=Measured(tried, np.where(tried, row, 0.0), none, none, row % 3 == 2))


def same(a: GraspSet, b: GraspSet) -> bool:
    names = (
        "part_from_hand",
        "opening",
        "approach_opening",
        "contacts",
        "normals",
        "facets",
        "force",
        "margin",
        "quality",
    )
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in names) and (a.part, a.hand) == (b.part, b.hand)


def test_indexing_by_mask_indices_and_slice_agree(grasps):
    chosen = np.arange(len(grasps)) % 3 == 0
    assert same(grasps[chosen], grasps[np.flatnonzero(chosen)])
    assert same(grasps[chosen], grasps[::3])
    assert same(grasps[:0].joined(grasps), grasps)


def test_arrays_are_read_only(grasps):
    with pytest.raises(ValueError, match="read-only"):
        grasps.opening[0] = 0.0


def test_thinning_keeps_the_best_and_spreads(grasps):
    few = grasps.thin(30)
    assert len(few) == 30
    assert few.quality[0] == grasps.quality.max()
    assert np.all(np.diff(few.quality) <= 0.0)

    def cover(some):
        """Farthest that a grasp of the whole set lies from a kept one, in position and in approach direction."""
        far = np.linalg.norm(grasps.part_from_hand[:, None, :3, 3] - some.part_from_hand[None, :, :3, 3], axis=-1)
        turned = grasps.part_from_hand[:, :3, 2] @ some.part_from_hand[:, :3, 2].T
        return far.min(axis=1).max(), np.arccos(np.clip(turned.max(axis=1).min(), -1.0, 1.0))

    best = grasps[:30]
    assert cover(few)[0] < cover(best)[0]
    assert cover(few)[1] <= np.radians(46.0)
    assert few.quality.mean() > 0.5 * grasps.quality.mean()
    assert same(grasps.thin(len(grasps) + 1), grasps)
    assert len(grasps[:0].thin(5)) == 0


def test_a_file_gives_back_what_was_saved(grasps, tmp_path):
    grasps.save(tmp_path / "g.npz")
    loaded = GraspSet.load(tmp_path / "g.npz")
    assert same(loaded, grasps)
    assert loaded.record == grasps.record
    assert loaded.key == grasps.key
    replace(grasps, part="\udcff").save(tmp_path / "n.npz")  # of a file whose name is no text
    assert GraspSet.load(tmp_path / "n.npz").part == "\udcff"
    empty = grasps[:0]
    empty.save(tmp_path / "e.npz")
    assert same(GraspSet.load(tmp_path / "e.npz"), empty)


def test_what_was_measured_goes_with_its_grasps(grasps, simulated):
    row = {where.tobytes(): i for i, where in enumerate(grasps.part_from_hand)}

    def rows(some):
        """The rows that the grasps are, by their poses; and by what was measured, where they were tried."""
        found = np.array([row[where.tobytes()] for where in some.part_from_hand])
        return found, np.where(some.measured.tried, some.measured.shift, found)

    for some in (simulated[::7], simulated[np.arange(len(grasps)) % 5 == 1], simulated.thin(40)):
        assert np.array_equal(*rows(some))
        assert np.array_equal(*rows(some.joined(simulated[:9])))
        assert some.joined(grasps).measured is None
        assert grasps.joined(some).measured is None
    held = simulated.held()
    assert np.array_equal(rows(held)[0], np.arange(2, len(grasps), 3))
    assert held.measured.held.all()
    assert len(simulated[::3].held()) == 0
    with pytest.raises(InputError, match="nothing was measured of them; run `kumitate simulate`"):
        grasps.held()
    with pytest.raises(InputError, match="grasps: measured"):
        replace(grasps, measured=simulated.measured.take(slice(5)))


def test_a_file_keeps_what_was_measured(grasps, simulated, tmp_path):
    path = tmp_path / "g.npz"
    for some in (simulated, simulated[:0], simulated.thin(7)):
        some.save(path)
        loaded = GraspSet.load(path)
        assert same(loaded, some)
        assert loaded.measured.held.dtype == loaded.measured.tried.dtype == bool
        for name in ("tried", "shift", "turn", "slip", "held"):
            assert np.array_equal(getattr(loaded.measured, name), getattr(some.measured, name))
    grasps.save(path)
    assert GraspSet.load(path).measured is None
    with np.load(path) as file:
        assert not any("measured" in name for name in file.files)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"measured_held": None}, "no grasp set .*measured_held"),
        ({"measured_tried": None, "measured_shift": None}, "no grasp set .*measured_tried"),
        ({"measured_turn": np.zeros(3)}, "measured: turn: shape"),
        ({"measured_slip": np.array([{}], dtype=object)}, "no grasp set"),
        ({f"measured_{name}": np.zeros(3) for name in ("shift", "turn", "slip")}, "measured: shift: shape"),
    ],
)
def test_a_file_with_broken_measures_is_refused(simulated, tmp_path, changes, words):
    path = tmp_path / "g.npz"
    simulated.save(path)
    rewritten(path, **changes)
    with pytest.raises(InputError, match=words) as error:
        GraspSet.load(path)
    assert str(error.value).startswith(str(path))


def test_measures_of_fewer_grasps_are_refused(simulated, tmp_path):
    path = tmp_path / "g.npz"
    simulated.save(path)
    names = ("tried", "shift", "turn", "slip", "held")
    rewritten(path, **{f"measured_{name}": getattr(simulated.measured, name)[:-1] for name in names})
    with pytest.raises(InputError, match="grasps: measured: of"):
        GraspSet.load(path)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "g.npz")
    for path in (tmp_path, tmp_path / "g.npz"):
        with pytest.raises(InputError, match="a folder or a device"):
            GraspSet.load(path)


def rewritten(path, **changes):
    """The file with some arrays replaced, or left out where None."""
    with np.load(path) as file:
        arrays = {**{name: file[name] for name in file.files}, **changes}
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})


def header(path, **changes):
    with np.load(path) as file:
        return np.array(json.dumps({**json.loads(str(file["header"][()])), **changes}))


def claimed(shape, kind="<f8"):
    """An array of two numbers whose header claims another shape or kind."""
    head = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(16)


def with_entry(path, name, data):
    """The file with other contents of an entry, which are packed."""
    with zipfile.ZipFile(path) as file:
        entries = {**{entry: file.read(entry) for entry in file.namelist()}, f"{name}.npy": data}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
        for entry, content in entries.items():
            file.writestr(entry, content)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda p, g: p.unlink(), "no such file"),
        (lambda p, g: p.write_bytes(b""), "no grasp set"),
        (lambda p, g: p.write_bytes(p.read_bytes()[:2000]), "no grasp set"),
        (lambda p, g: p.write_bytes(pickle.dumps({"opening": 1})), "no grasp set"),
        (lambda p, g: np.save(p.open("wb"), g.opening), "no grasp set"),
        (lambda p, g: rewritten(p, opening=None), "no grasp set"),
        (lambda p, g: rewritten(p, opening=np.array([{}], dtype=object)), "no grasp set"),
        (lambda p, g: rewritten(p, header=np.array("{")), "no grasp set"),
        (lambda p, g: rewritten(p, header=header(p, format=99)), "format 99"),
        (lambda p, g: rewritten(p, header=header(p, record=[{"name": "x"}])), "no grasp set"),
        (lambda p, g: rewritten(p, header=header(p, part=["x"])), "no grasp set"),
        (lambda p, g: with_entry(p, "opening", claimed("(10**9,)")), "no grasp set"),
        (lambda p, g: with_entry(p, "opening", claimed("(1000000000000,)")), "claims shape"),
        (lambda p, g: with_entry(p, "opening", claimed("(2, 3")), "no grasp set"),
        (lambda p, g: with_entry(p, "header", claimed("(1,)", "|O")), "no grasp set"),
        (lambda p, g: rewritten(p, opening=g.opening[:-1]), "opening: shape"),
        (lambda p, g: rewritten(p, quality=np.full(len(g), np.nan)), "quality"),
        (lambda p, g: rewritten(p, part_from_hand=2.0 * g.part_from_hand), "no rigid pose"),
        (lambda p, g: rewritten(p, normals=2.0 * g.normals), "unit length"),
        (lambda p, g: rewritten(p, approach_opening=g.opening - 1e-3), "approach opening"),
        (lambda p, g: rewritten(p, facets=g.facets.astype(float)), "facets"),
    ],
)
def test_a_malformed_file_is_refused_with_the_reason(grasps, tmp_path, spoil, words):
    path = tmp_path / "g.npz"
    grasps.save(path)
    spoil(path, grasps)
    with pytest.raises(InputError, match=words) as error:
        GraspSet.load(path)
    assert "g.npz" in str(error.value)


def test_what_is_much_larger_unpacked_is_not_unpacked(grasps, tmp_path, monkeypatch):
    monkeypatch.setattr("kumitate.grasping.grasps.LARGEST_FILE", 10**6)
    grasps.save(tmp_path / "g.npz")
    with_entry(tmp_path / "g.npz", "opening", bytes(10**6))
    assert (tmp_path / "g.npz").stat().st_size < 10**5
    with pytest.raises(InputError, match="more than 1000000"):
        GraspSet.load(tmp_path / "g.npz")


def test_nothing_is_pickled(simulated, tmp_path):
    simulated.save(tmp_path / "g.npz")
    with np.load(io.BytesIO((tmp_path / "g.npz").read_bytes()), allow_pickle=False) as file:
        assert all(file[name].dtype.kind in "bfiU" for name in file.files)


def test_a_set_that_is_no_set_is_refused(grasps):
    with pytest.raises(InputError, match="give an array of shape"):
        replace(grasps, contacts=grasps.contacts[:, 0])
