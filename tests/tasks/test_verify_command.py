"""``kumitate verify``: what it says of a sound and of a spoilt plan, and how it ends."""

from __future__ import annotations

import json

import pytest
from mutations_of_goals import the_way_home_left_out
from mutations_of_motions import too_fast
from mutations_of_scenes import an_obstacle_in_the_way
from plans import short_plan

from kumitate.tasks.cli import main
from kumitate.tasks.verify import verify


@pytest.fixture
def file(tmp_path):
    short_plan().save(tmp_path / "plan.json")
    return tmp_path / "plan.json"


def test_a_sound_plan_is_verified_with_its_clearance(file, capsys):
    assert main(["verify", str(file)]) == 0
    clearance, verified = capsys.readouterr().out.splitlines()
    found = verify(short_plan())
    assert clearance == f"clearance {found.clearance * 1e3:.2f} mm, {' to '.join(found.nearest)}"
    actions = len(short_plan().actions)
    assert verified.startswith(f"verified: {actions} actions, {short_plan().duration:.1f} s of motion; ")
    assert f"{found.samples} instants, {found.distances} distances" in verified


def test_faults_are_listed_with_their_action_counted_from_1(tmp_path, capsys):
    spoilt = too_fast(the_way_home_left_out(short_plan()))
    spoilt.save(tmp_path / "plan.json")
    assert main(["verify", str(tmp_path / "plan.json")]) == 1
    printed = capsys.readouterr().out
    number, action = next((i, a) for i, a in enumerate(spoilt.actions, start=1) if a.kind == "transfer")
    assert f"action {number} ({action.words}) at " in printed
    assert ": velocity: " in printed
    assert ": end: " in printed
    assert f" faults in {len(spoilt.actions)} actions" in printed.splitlines()[-1]
    assert "verified" not in printed


def test_json_has_every_fault_and_number(tmp_path, capsys):
    an_obstacle_in_the_way(short_plan()).save(tmp_path / "plan.json")
    assert main(["verify", str(tmp_path / "plan.json"), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["verified"] is False
    faults = {fault["name"]: fault for fault in answer["faults"]}
    assert set(faults["collision"]["bodies"]) >= {"speck"}
    assert set(answer) == {"verified", "faults", "clearance", "nearest", "samples", "distances", "seconds"}


def test_json_of_a_sound_plan(file, capsys):
    assert main(["verify", str(file), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["verified"] is True
    assert answer["faults"] == []
    assert answer["clearance"] == pytest.approx(verify(short_plan()).clearance)


@pytest.mark.parametrize("content", ["", "{}", "robot: nextage"])
def test_what_is_no_plan_is_exit_2(tmp_path, capsys, content):
    (tmp_path / "plan.json").write_text(content, encoding="utf-8")
    assert main(["verify", str(tmp_path / "plan.json")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"kumitate: {tmp_path / 'plan.json'}: no plan")
    assert error.count("\n") == 1


def test_a_missing_file_is_exit_2(tmp_path, capsys):
    assert main(["verify", str(tmp_path / "none.json"), "--json"]) == 2
    captured = capsys.readouterr()
    assert "none.json" in captured.err
    assert json.loads(captured.out)["error"]["kind"] == "InputError"
