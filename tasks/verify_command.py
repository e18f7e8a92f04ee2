"""The command ``kumitate verify``: whether a plan does its task, within all limits and free of collision."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .output import progress_line, say, say_json

if TYPE_CHECKING:
    from .document import Plan
    from .verify_faults import Fault


def add_verify(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = (
        "Check a plan with nothing of what made it. Ends with 0 when there is no fault, with 1 when there are some, and"
        " with 2 when the file is no plan."
    )
    parser.add_argument("plan", type=Path, help="a plan that `kumitate plan` wrote")
    parser.add_argument("--json", action="store_true", help="print the answer for programs")
    parser.set_defaults(run=_verify)


def _verify(options: argparse.Namespace) -> int:
    import msgspec

    from .document import Plan
    from .verify import verify

    plan = Plan.load(options.plan)
    with progress_line() as progress:
        progress("verification")
        found = verify(plan)
    if options.json:
        say_json({"verified": found.ok, **msgspec.to_builtins(found)})
        return 0 if found.ok else 1
    for fault in found.faults:
        say(f"{_where(fault, plan)}{fault.name}: {fault.words}")
    if found.nearest:
        say(f"clearance {found.clearance * 1e3:.2f} mm, {' to '.join(found.nearest)}")
    job = f"{len(plan.actions)} actions, {plan.duration:.1f} s of motion"
    if not found.ok:
        say(f"{len(found.faults)} faults in {job}, found in {found.seconds:.1f} s")
        return 1
    say(f"verified: {job}; {found.samples} instants, {found.distances} distances in {found.seconds:.1f} s")
    return 0


def _where(fault: Fault, plan: Plan) -> str:
    """The action of a fault, counted from 1 as in the replay, and the time in it."""
    if fault.action is None:
        return ""
    words = f"action {fault.action + 1} ({plan.actions[fault.action].words})"
    return f"{words}: " if fault.time is None else f"{words} at {fault.time:.3f} s: "
