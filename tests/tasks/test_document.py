"""The plan document: what it holds survives its file, and what is no plan is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace
from plans import short_plan

from kumitate.errors import InputError
from kumitate.tasks.document import FORMAT, Mesh, Plan, matrix, plan_schema
from kumitate.transforms import pose


@pytest.fixture
def file(tmp_path):
    short_plan().save(tmp_path / "plan.json")
    return tmp_path / "plan.json"


def test_a_plan_survives_its_file_bit_for_bit(file, tmp_path):
    assert Plan.load(file) == short_plan()
    Plan.load(file).save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == file.read_bytes()


def test_it_is_json_that_needs_nothing_of_the_package(file):
    document = json.loads(file.read_bytes())
    assert document["format"] == FORMAT
    assert len(document["actions"]) == len(short_plan().actions)
    for action in document["actions"]:
        motion = action["motion"]
        assert np.shape(motion["positions"]) == (len(motion["times"]), len(document["joints"]))
        assert np.shape(action["end"]["poses"]["block"]) == (4, 4)


def test_the_duration_is_that_of_all_actions():
    times = [action.motion.times for action in short_plan().actions]
    assert short_plan().duration == pytest.approx(sum(t[-1] for t in times))


def test_meshes_keep_every_triangle_and_number(rng):
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.vertices *= rng.uniform(0.9, 1.1, size=(len(mesh.vertices), 1))
    kept = Mesh.of(mesh, "digest").trimesh()
    assert (kept.vertices == mesh.vertices).all()
    assert (kept.faces == mesh.faces).all()
    soup = trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3), process=False)
    assert len(Mesh.of(soup).trimesh().vertices) == len(soup.vertices)  # nothing is merged


@pytest.mark.parametrize("text", ["AAAA*", "AAA", "é", "AAAA"])
def test_triangles_that_are_no_base64_of_threes_are_told(text):
    for mesh in (Mesh(text, ""), Mesh("", text)):
        with pytest.raises(ValueError):  # noqa: PT011
            mesh.trimesh()


def test_a_motion_without_samples_takes_no_time():
    action = short_plan().actions[0]
    assert replace(action.motion, times=()).duration == 0.0


def test_matrices_are_poses_row_by_row():
    written = matrix(pose([1.0, 2.0, 3.0], [0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(written, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)
    assert all(type(x) is float for row in written for x in row)


def test_saving_replaces_the_whole_file_or_nothing(file, monkeypatch):
    before = file.read_bytes()

    def interrupted(self, data):
        with self.open("wb") as half:
            half.write(data[:100])
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "write_bytes", interrupted)
    with pytest.raises(KeyboardInterrupt):
        replace(short_plan(), seed=99).save(file)
    assert file.read_bytes() == before
    assert list(file.parent.iterdir()) == [file]


def _without(name):
    def change(document):
        del document[name]

    return change


def _with(**more):
    def change(document):
        document.update(more)

    return change


def _wrong_kind(document):
    document["actions"][0]["kind"] = "dance"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_with(format=FORMAT + 1), "plan the task again"),
        (_without("format"), "no plan"),
        (_without("actions"), "no plan"),
        (_with(extra=1), "no plan"),
        (_with(seed="zero"), "no plan"),
        (_wrong_kind, "dance"),
    ],
)
def test_what_is_no_plan_is_refused(file, change, words):
    document = json.loads(file.read_bytes())
    change(document)
    file.write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError, match=words) as caught:
        Plan.load(file)
    assert caught.value.place == str(file)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe\x00", b"solid block", b'{"format": 1}', b'{"a":' + b"[" * 10**5]
)
def test_what_is_no_json_is_refused(tmp_path, content):
    (tmp_path / "plan.json").write_bytes(content)
    with pytest.raises(InputError, match="no plan"):
        Plan.load(tmp_path / "plan.json")


def test_a_missing_or_huge_file_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="cannot be read"):
        Plan.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read"):
        Plan.load(tmp_path)
    monkeypatch.setattr("kumitate.tasks.document.LARGEST_PLAN", 10)
    (tmp_path / "plan.json").write_bytes(b" " * 11)
    with pytest.raises(InputError, match="larger than 10 bytes"):
        Plan.load(tmp_path / "plan.json")


def test_the_schema_names_every_field():
    schema = plan_schema()
    fields = schema["$defs"]["Plan"]["properties"]
    assert set(fields) == set(Plan.__struct_fields__)
    assert set(schema["$defs"]["Plan"]["required"]) == set(fields)
