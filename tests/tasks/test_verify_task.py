"""Tasks in plan documents: what is none is refused, whatever a planner would have made of it."""

from __future__ import annotations

import numpy as np
import pytest
from edits import with_goal, with_part
from msgspec.structs import replace
from plans import sample_plan, short_plan, use_plan

from kumitate.errors import InputError
from kumitate.tasks.verify_task import read_task

AREA = {"on": "table", "corners": [[0.3, 0.3], [0.4, 0.4]]}


@pytest.mark.parametrize(
    ("kind", "changes", "message"),
    [
        ("use", {"part": "wheel"}, "unknown: wheel"),
        ("use", {"frame": "tail"}, "unknown: tail"),
        ("use", {"of": "wheel"}, "unknown: wheel"),
        ("use", {"of": "block"}, "unknown: block"),
        ("use", {"arm": "third"}, "unknown: third"),
        ("use", {"any_turn": [0.0, 0.0, 0.0]}, "no direction"),
        ("use", {"approach": {"direction": [0.0, 0.0, 0.0], "distance": 0.1}}, "no direction"),
        ("use", {"approach": {"direction": [0.0, 0.0, 1.0], "distance": 0.0}}, "no way"),
        ("place", {"at": None}, "not one place"),
        ("place", {"area": AREA}, "not one place"),
        ("place", {"at": None, "area": {**AREA, "on": "block"}}, "unknown: block"),
        ("place", {"at": None, "area": {**AREA, "up": [0.0, 0.0, 0.0]}}, "no direction"),
        ("place", {"at": None, "area": {**AREA, "corners": [[0.3, 0.3], [0.3, 0.4]]}}, "is empty"),
        ("place", {"any_turn": [np.nan, 0.0, 1.0]}, "no direction"),
        ("hand_over", {"any_turn": [0.0, 0.0, 0.0]}, "no direction"),
        ("hand_over", {"to": "third"}, "unknown: third"),
    ],
)
def test_goals_of_what_there_is_not_are_refused(kind, changes, message):
    plan = {"use": use_plan, "place": short_plan, "hand_over": sample_plan}[kind]()
    with pytest.raises(InputError, match=message):
        read_task(with_goal(plan, 0, kind, **changes).task)


def test_a_goal_is_one():
    plan = short_plan()
    for goal in ({}, {**plan.task["goals"][0], **use_plan().task["goals"][0]}):
        with pytest.raises(InputError, match="is not one of"):
            read_task(replace(plan, task={**plan.task, "goals": [goal]}).task)


def test_regions_are_not_empty():
    with pytest.raises(InputError, match="is empty"):
        read_task(with_part(short_plan(), "block", no_touch=[{"box": [0.1, 0.0, 0.1]}]).task)


@pytest.mark.parametrize("make", [short_plan, sample_plan, use_plan])
def test_sound_tasks_are_read(make):
    task = read_task(make().task)
    assert len(task.goals) == len(make().task["goals"])
    assert set(task.parts) == set(make().task["parts"])
