"""The rows of the cost table add up."""

import pytest

from kumitate.grasping.record import Stage


def test_a_stage_that_filters_adds_up():
    assert Stage("refinement 1", 10, 7, {"near the boundary": 3}).dropped["near the boundary"] == 3
    with pytest.raises(ValueError, match="refinement 1"):
        Stage("refinement 1", 10, 7, {"near the boundary": 2})


def test_a_stage_that_makes_something_new_need_not():
    assert Stage("sampling", 10, 25).kept == 25


def test_the_record_cannot_be_changed():
    dropped = {"reason": 1}
    stage = Stage("pairs", 2, 1, dropped)
    dropped["reason"] = 5
    assert stage.dropped["reason"] == 1
    with pytest.raises(TypeError):
        stage.dropped["reason"] = 2
