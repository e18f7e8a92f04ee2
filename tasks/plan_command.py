"""The command ``kumitate plan``: from a task file to a verified plan, and a page that plays it."""

from __future__ import annotations

import argparse
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from ..errors import InputError, TimeLimitError
from .output import check_writable, progress_line, say, say_json, write_file
from .quantities import parse_quantity

if TYPE_CHECKING:
    from .document import Plan

_LARGEST_SEED = 2**32 - 1


def add_plan(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = (
        "Plan a task, verify the plan and write it. Ends with 0 when there is a plan, with 1 when there is none, and"
        " with 2 when the task file is wrong."
    )
    parser.add_argument("task", type=Path, help="the task file (YAML)")
    parser.add_argument("--seed", default="0", help="number that all random samples follow from; 0 unless given")
    parser.add_argument("--output", type=Path, metavar="JSON", help="the plan; TASK.plan.json beside it unless given")
    parser.add_argument(
        "--replay", type=Path, nargs="?", const=Path(), metavar="HTML", help="write a page that plays the plan too"
    )
    parser.add_argument("--time-limit", default="120 s", help='longest time of the whole command; "120 s" unless given')
    parser.add_argument("--json", action="store_true", help="print the answer for programs")
    parser.set_defaults(run=_plan, limit=time_limit)


def time_limit(options: argparse.Namespace) -> float:
    """The time that the command has [s].

    Raises:
        InputError: The option is no time, or none is left.
    """
    limit = parse_quantity(options.time_limit, "time", "--time-limit")
    if limit <= 0.0:
        raise InputError("--time-limit", f"{limit:g} s leaves no time", 'give more, such as "120 s"')
    return limit


def _plan(options: argparse.Namespace) -> int:
    started = perf_counter()
    import msgspec

    from .planner import plan
    from .task_file import in_file, read_task

    seed, limit = seed_of(options.seed), time_limit(options)
    task = read_task(options.task)
    output = options.output or options.task.with_suffix(".plan.json")
    page = options.replay if options.replay is None or options.replay.name else output.with_suffix(".html")
    files = [output] if page is None else [output, page]
    if len({path.resolve() for path in (options.task, *files)}) <= len(files):
        raise InputError("--output", "task, plan and replay are not three files", "name every file differently")
    for path in files:
        check_writable(path)
    with progress_line() as progress:
        try:
            left = limit - (perf_counter() - started)
            made = plan(task, options.task.parent, seed=seed, time_limit=left, progress=progress)
        except TimeLimitError as error:
            raise TimeLimitError(limit, error.doing) from None
        except InputError as error:
            raise in_file(error, options.task) from error
        content = msgspec.json.encode(made)
        write_file(output, lambda path: path.write_bytes(content))
        if page is not None:
            from .replay import write_replay

            progress("replay")
            write_file(page, lambda path: write_replay(made, path))
    (_say_json if options.json else _say)(made, output, page)
    return 0


def seed_of(text: str) -> int:
    """The seed that an option gives.

    Raises:
        InputError: It is none.
    """
    if not text.isdecimal() or int(text) > _LARGEST_SEED:
        raise InputError("--seed", f"{text!r} is no whole number up to {_LARGEST_SEED}", "write one such as 0")
    return int(text)


def _say(made: Plan, output: Path, page: Path | None) -> None:
    for number, action in enumerate(made.actions, start=1):
        say(f"{number:>4}{action.motion.duration:>7.1f} s  {action.words}")
    say(f"{len(made.actions)} actions, {made.duration:.1f} s of motion")
    say(f"planned in {sum(made.seconds.values()):.1f} s: {_stages(made)}")
    say("verified: no faults")
    say(f"plan -> {output} ({output.stat().st_size / 1e6:.1f} MB)")
    if page is not None:
        say(f"replay -> {page} ({page.stat().st_size / 1e6:.1f} MB)")


def _stages(made: Plan) -> str:
    return ", ".join(f"{stage} {seconds:.1f} s" for stage, seconds in made.seconds.items())


def _say_json(made: Plan, output: Path, page: Path | None) -> None:
    say_json(
        {
            "plan": str(output),
            "replay": None if page is None else str(page),
            "actions": len(made.actions),
            "duration": made.duration,
            "seconds": made.seconds,
            "verified": True,
        }
    )
