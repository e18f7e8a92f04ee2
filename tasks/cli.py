"""The command line ``kumitate``."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial

from ..errors import InputError, KumitateError
from .explain_command import add_explain
from .export_command import add_export
from .grasps_command import add_grasps
from .output import say_error
from .placements_command import add_placements
from .plan_command import add_plan
from .replay_command import add_replay
from .robots_command import add_robots
from .schema_command import add_schema
from .simulate_command import add_simulate
from .supervised import supervised, unsupervised
from .verify_command import add_verify

_INTERRUPTED = 130  # as shells count it: 128 and the number of the signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it did what was asked, 1 when there is no answer, 2 when the input is wrong.

    As a program, which is without ``arguments``, it does its work in a child process, which it ends when the command's
    time limit is over or when it is asked to end, whatever the work is at. Called by other code it forks nothing.
    """
    options = _parser().parse_args(arguments)
    work = partial(_status, options, lambda: options.run(options))
    if arguments is not None:
        return unsupervised(work)
    return _status(options, lambda: supervised(work, options.limit(options) if "limit" in options else math.inf))


def _status(options: argparse.Namespace, work: Callable[[], int]) -> int:
    """The exit code of some work, once its answer is out and what went wrong is told."""
    try:
        try:
            status = int(work())
        except KumitateError as error:
            say_error(error, as_json=getattr(options, "json", False))
            status = 2 if isinstance(error, InputError) else 1
        sys.stdout.flush()
        return status
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:  # whoever reads has enough
        status = 0
    except OSError as error:  # commands tell what is wrong with a file; left is the answer on a disk that is full
        say_error(KumitateError(f"the answer cannot be written ({error})"), as_json=False)
        status = 1
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left must not be tried again at the end
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="kumitate", description="Assembly planning for dual-arm robots.")
    commands = parser.add_subparsers(required=True, metavar="command")
    add_plan(commands.add_parser("plan", help="plan a task, and verify the plan"))
    add_explain(commands.add_parser("explain", help="tell why a task has no plan, and what would help"))
    add_verify(commands.add_parser("verify", help="check a plan, independently of what made it"))
    add_replay(commands.add_parser("replay", help="write a page that plays a plan in a browser"))
    add_export(commands.add_parser("export", help="write a plan as ROS trajectories or as a table"))
    add_grasps(commands.add_parser("grasps", help="plan the grasps of a part by a hand"))
    add_placements(commands.add_parser("placements", help="find the stable placements of a part on a plane"))
    add_simulate(commands.add_parser("simulate", help="try the grasps of a part in physics, and see which hold"))
    add_robots(commands.add_parser("robots", help="list the shipped robots and hands"))
    add_schema(commands.add_parser("schema", help="print the JSON Schema of task files or plans"))
    return parser


if __name__ == "__main__":
    sys.exit(main())
