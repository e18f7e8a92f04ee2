"""What the verifier finds in a plan without looking for collisions."""

from __future__ import annotations

from kumitate.tasks.document import Plan
from kumitate.tasks.verify_cell import read_cell
from kumitate.tasks.verify_faults import Fault, Findings
from kumitate.tasks.verify_goals import Goals
from kumitate.tasks.verify_holds import follow
from kumitate.tasks.verify_motion import Curve


def goal_faults(plan: Plan) -> tuple[Fault, ...]:
    """Faults of goals, events and carriers."""
    findings = Findings()
    cell = read_cell(plan, findings)
    curves = [Curve.of(action, cell) for action in plan.actions]
    Goals(plan, cell, curves, follow(plan, cell, curves, findings)[1], findings).check()
    return findings.faults
