"""The command ``kumitate explain``: why a task has no plan, and what would help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, PlanningError
from .output import check_writable, progress_line, say, say_json, write_file
from .plan_command import seed_of, time_limit
from .supervised import CLEAR

if TYPE_CHECKING:
    from .document import Plan
    from .task import Task


def add_explain(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = (
        "Plan a task; where there is no plan, tell why, and which single changes would help, each of them tried. Ends"
        " with 0 when there is a plan after all, with 1 when there is none, and with 2 when the task is wrong."
    )
    parser.add_argument("task", type=Path, help="the task file (YAML)")
    parser.add_argument("--seed", default="0", help="number that all random samples follow from; 0 unless given")
    parser.add_argument("--time-limit", default="60 s", help='longest time of each try; "60 s" unless given')
    parser.add_argument(
        "--view",
        type=Path,
        metavar="HTML",
        help="write a page with the nearest candidate, and in red what is in its way",
    )
    parser.add_argument("--json", action="store_true", help="print the answer for programs")
    parser.set_defaults(run=_explain)


def _explain(options: argparse.Namespace) -> int:
    from .document import Plan
    from .reasons import NoPlanError
    from .suggestions import suggestions
    from .task_file import read_task
    from .view_blocked import write_blocked_page

    seed, limit = seed_of(options.seed), time_limit(options)
    task, folder = read_task(options.task), options.task.parent
    if options.view is not None:
        check_writable(options.view)
    with progress_line() as progress:
        answer = _planned(options.task, task, seed, limit, progress)
    tell = _silent if options.json else say
    if isinstance(answer, Plan):
        tell(f"there is a plan: {len(answer.actions)} actions, {answer.duration:.1f} s of motion")
        if options.json:
            say_json({"planned": True})
        return 0
    lines = [str(line) for line in getattr(answer, "report", ())]
    for line in [str(answer), *(f"  {line}" for line in lines), "what would help, one thing at a time:"]:
        tell(line)
    helps: list[str] = []
    with progress_line() as progress:
        for words in suggestions(task, folder, answer, seed=seed, time_limit=limit, progress=progress):
            helps.append(words)
            _clear_line()
            tell(f"  {words}")
    if not helps:
        tell("  nothing that was tried")
    if options.json:
        say_json({"planned": False, "because": str(answer), "causes": _causes(answer), "report": lines, "helps": helps})
    if options.view is not None:
        if isinstance(answer, NoPlanError):
            report = answer.report
            write_file(options.view, lambda path: write_blocked_page(path, report, helps))
            tell(f"page -> {options.view}")
        else:
            tell("no page: there is no candidate to show")
    return 1


def _planned(file: Path, task: Task, seed: int, limit: float, progress: Callable[[str], None]) -> Plan | PlanningError:
    """The plan, or why there is none."""
    from .planner import plan
    from .task_file import in_file

    try:
        return plan(task, file.parent, seed=seed, time_limit=limit, progress=progress)
    except InputError as error:
        raise in_file(error, file) from error
    except PlanningError as error:
        return error


def _causes(error: PlanningError) -> list[dict[str, object]]:
    """What decides, for programs."""
    from .reasons import NoPlanError

    if not isinstance(error, NoPlanError):
        return []
    return [{"words": cause.words, "bodies": cause.bodies, "count": n} for cause, n in error.report.causes]


def _silent(line: str) -> None:
    """Say nothing."""


def _clear_line() -> None:
    """Take what is being done off the terminal, so that a line of the answer can stand there."""
    if sys.stderr.isatty():
        sys.stderr.write(CLEAR)
        sys.stderr.flush()
