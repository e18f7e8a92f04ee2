"""Goals, and what they pin: the arms, the place, whether the assembly is held in the end."""

from __future__ import annotations

import numpy as np
import pytest
from mutations import joining, with_goal
from plans import sample_plan, standing_plan

from kumitate.tasks.document import Plan
from kumitate.tasks.verify import verify
from kumitate.tasks.verify_cell import read_cell
from kumitate.tasks.verify_faults import Fault, Findings
from kumitate.tasks.verify_goals import Goals
from kumitate.tasks.verify_holds import follow
from kumitate.tasks.verify_motion import Curve

HAND_OVER, PLACE, ATTACH = 0, 1, 2


def goal_faults(plan: Plan) -> tuple[Fault, ...]:
    """What is found without looking for collisions."""
    findings = Findings()
    cell = read_cell(plan, findings)
    curves = [Curve.of(action, cell) for action in plan.actions]
    Goals(plan, cell, curves, follow(plan, cell, curves, findings)[1], findings).check()
    return findings.faults


def faults(number: int, kind: str, **changes: object) -> tuple[Fault, ...]:
    return goal_faults(with_goal(sample_plan(), number, kind, **changes))


def where_joined(shift: float) -> dict[str, list[float]]:
    """Where the tube is when the peg comes, in the world."""
    at = np.array(sample_plan().actions[joining(sample_plan())[0]].end.poses["tube"])
    return {"xyz": (at[:3, 3] + [shift, 0.0, 0.0]).tolist(), "rpy": [np.pi / 2, 0.0, 0.0]}


@pytest.mark.parametrize(
    ("number", "kind", "changes", "found"),
    [
        (ATTACH, "attach", {"arm": "left", "to_arm": "right", "where": where_joined, "shift": 0.0}, set()),
        (ATTACH, "attach", {"where": where_joined, "shift": 1e-3}, {"insertion"}),
        (ATTACH, "attach", {"arm": "right"}, {"insertion"}),
        (ATTACH, "attach", {"to_arm": "left"}, {"insertion"}),
        (ATTACH, "attach", {"then": "place"}, {"goal"}),
        (PLACE, "place", {"arm": "right"}, set()),
        (PLACE, "place", {"arm": "left"}, {"goal"}),
        (HAND_OVER, "hand_over", {"at": {"xyz": [0.4, 0.0, 0.251], "rpy": [-np.pi / 2, 0.0, 0.0]}}, {"goal"}),
    ],
)
def test_a_goal_is_reached_as_it_is_written(number, kind, changes, found):
    changes = dict(changes)
    if "where" in changes:
        changes["where"] = where_joined(changes.pop("shift"))
    assert {fault.name for fault in faults(number, kind, **changes)} == found


def test_faults_of_goals_name_the_action_that_should_have_reached_them():
    at = {"xyz": [0.35, -0.35, 0.02], "rpy": [np.pi, 0.0, 0.0]}
    (fault,) = faults(PLACE, "place", at=at)
    assert fault.action == max(i for i, action in enumerate(sample_plan().actions) if action.goal == PLACE)
    assert fault.bodies == ("block",)
    assert "10.000 mm" in fault.words


def test_what_is_joined_where_it_stands_need_not_be_held():
    """The goal says hold, but no hand held the tube when the peg came, and none need hold it now."""
    assert standing_plan().task["goals"][0]["attach"].get("then", "hold") == "hold"
    assert verify(standing_plan()).faults == ()
    assert goal_faults(with_goal(standing_plan(), 0, "attach", then="place")) == ()
    (fault,) = goal_faults(with_goal(sample_plan(), ATTACH, "attach", then="place"))
    assert "held by right" in fault.words
