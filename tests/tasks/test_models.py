"""The files of a task's robot and hands, and their digests."""

from __future__ import annotations

import shutil
from hashlib import sha256

import pytest

from kumitate.errors import InputError
from kumitate.tasks.models import LIBRARY, model_digests, model_files

SHIPPED = {"robot": "ur3_dual", "hands": {"left": "robotiq_2f85", "right": {"hand": "suction_cup"}}}


@pytest.fixture
def own(tmp_path):
    (tmp_path / "grippers").mkdir()
    for name in ("nextage.urdf", "nextage.srdf", "nextage_limits.yaml"):
        shutil.copy(LIBRARY / name, tmp_path / name.replace("nextage", "mine"))
    for name in ("suction_cup.urdf", "suction_cup.yaml"):
        shutil.copy(LIBRARY / name, tmp_path / "grippers" / name)
    robot = {"urdf": "mine.urdf", "srdf": "mine.srdf", "limits": "mine_limits.yaml", "packages": ["meshes"]}
    return {"robot": robot, "hands": {"left": "grippers/suction_cup.yaml", "right": "suction_cup"}}


def test_digests_are_of_the_files(tmp_path):
    digests = model_digests(SHIPPED, tmp_path)
    assert sorted(digests) == [
        "hand/robotiq_2f85.urdf",
        "hand/robotiq_2f85.yaml",
        "hand/suction_cup.urdf",
        "hand/suction_cup.yaml",
        "robot/ur3_dual.srdf",
        "robot/ur3_dual.urdf",
        "robot/ur3_dual_limits.yaml",
    ]
    for name, digest in digests.items():
        assert digest == sha256((LIBRARY / name.partition("/")[2]).read_bytes()).hexdigest()


def test_files_of_the_users_own_lie_in_the_tasks_folder(own, tmp_path):
    files = model_files(own, tmp_path)
    assert files.urdf == tmp_path / "mine.urdf"
    assert files.packages == (tmp_path / "meshes",)
    assert files.hands["left"].urdf == tmp_path / "grippers" / "suction_cup.urdf"
    assert files.hands["right"].urdf == LIBRARY / "suction_cup.urdf"
    before = model_digests(own, tmp_path)
    assert "hand/grippers/suction_cup.yaml" in before
    (tmp_path / "mine.srdf").write_text("<robot/>")
    after = model_digests(own, tmp_path)
    assert [name for name in before if before[name] != after[name]] == ["robot/mine.srdf"]


def test_what_is_missing_is_told(own, tmp_path):
    for task, message in (
        ({**SHIPPED, "robot": "nothing"}, "no robot named 'nothing'"),
        ({**SHIPPED, "robot": "../library/nextage"}, "no robot named"),
        ({**SHIPPED, "hands": {"left": "nothing"}}, "no hand named 'nothing'"),
        ({**SHIPPED, "hands": {"left": "nextage_limits"}}, "names no URDF"),
        ({**own, "robot": {"urdf": "other.urdf", "srdf": "mine.srdf"}}, "cannot be read"),
        ({**own, "hands": {"left": "grippers/other.yaml"}}, "cannot be read"),
    ):
        with pytest.raises(InputError, match=message):
            model_digests(task, tmp_path)
    (tmp_path / "grippers" / "suction_cup.yaml").write_text("urdf: [")
    with pytest.raises(InputError, match="no YAML"):
        model_digests(own, tmp_path)


@pytest.mark.parametrize(
    "text", ["urdf: !!bool x", "urdf: !!timestamp x", "urdf: " + "[" * 5000, "urdf: 2020-13-45", "[]", "- a\n" * 2**18]
)
def test_yaml_that_means_nothing_is_told(own, tmp_path, text):
    (tmp_path / "grippers" / "suction_cup.yaml").write_text(text)
    with pytest.raises(InputError, match=r"suction_cup\.yaml: (no YAML|no mapping|larger)"):
        model_digests(own, tmp_path)


@pytest.mark.parametrize("name", ["/dev/zero", "/dev/null", "/", "a" * 5000, "a\0b", "\ud800"])
def test_what_is_no_plain_file_is_not_read(own, tmp_path, name):
    for task in ({**own, "robot": {"urdf": name, "srdf": "mine.srdf"}}, {**own, "hands": {"left": f"{name}.yaml"}}):
        with pytest.raises(InputError, match=r"cannot be read|no hand"):
            model_digests(task, tmp_path)
    for task in ({**own, "robot": name}, {**own, "hands": {"left": name}}):
        with pytest.raises(InputError, match="there is no"):
            model_digests(task, tmp_path)
