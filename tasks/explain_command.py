"""The command ``kumitate explain``: why a task has no plan, and what would help."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, PlanningError
from .output import check_writable, progress_line, say, say_json, write_file
from .plan_command import seed_of, time_limit

if TYPE_CHECKING:
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
    from .reasons import NoPlanError
    from .suggestions import suggestions
    from .task_file import read_task
    from .view_blocked import write_blocked_page

    seed, limit = seed_of(options.seed), time_limit(options)
    task, folder = read_task(options.task), options.task.parent
    if options.view is not None:
        check_writable(options.view)
    with progress_line() as progress:
        failure = _failure(options, task, seed, limit, progress)
        if failure is None:
            return 0
        lines = [str(failure), *(f"  {line}" for line in getattr(failure, "report", ()))]
        if not options.json:
            progress("")
            for line in [*lines, "what would help, one thing at a time:"]:
                say(line)
        helps = []
        for words in suggestions(task, folder, failure, seed=seed, time_limit=limit, progress=progress):
            helps.append(words)
            if not options.json:
                say(f"  {words}")
    if options.json:
        say_json({"planned": False, "report": lines, "helps": helps})
    elif not helps:
        say("  nothing that was tried")
    if options.view is not None and isinstance(failure, NoPlanError):
        report = failure.report
        write_file(options.view, lambda path: write_blocked_page(path, report, helps))
        if not options.json:
            say(f"page -> {options.view}")
    return 1


def _failure(
    options: argparse.Namespace, task: Task, seed: int, limit: float, progress: Callable[[str], None]
) -> PlanningError | None:
    """Why there is no plan; nothing, once that is said, if there is one."""
    from .planner import plan
    from .task_file import in_file

    try:
        made = plan(task, options.task.parent, seed=seed, time_limit=limit, progress=progress)
    except InputError as error:
        raise in_file(error, options.task) from error
    except PlanningError as error:
        return error
    if options.json:
        say_json({"planned": True})
    else:
        say(f"there is a plan: {len(made.actions)} actions, {made.duration:.1f} s of motion")
    return None
