"""The command line ``kumitate``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from types import FrameType

from ..errors import InputError, KumitateError
from .export_command import add_export
from .grasps_command import add_grasps
from .output import on_interrupt, say_error
from .placements_command import add_placements
from .plan_command import add_plan
from .replay_command import add_replay
from .robots_command import add_robots
from .schema_command import add_schema
from .verify_command import add_verify

_INTERRUPTED = 130  # as shells count it: 128 and the number of the signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; 0 when it did what was asked, 1 when there is no answer, 2 when the input is wrong."""
    try:
        with on_interrupt(_end_at_once):
            return _answered(_parser().parse_args(arguments))
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:  # whoever reads has enough; what is not written yet must not be tried again at the end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _end_at_once(number: int, frame: FrameType | None) -> None:
    """Where files are written, an exception ends it; elsewhere one could get lost, most likely in loading libraries."""
    if sys.stderr.isatty():
        os.write(sys.stderr.fileno(), b"\n")
    os._exit(_INTERRUPTED)


def _answered(options: argparse.Namespace) -> int:
    try:
        status = int(options.run(options))
    except KumitateError as error:
        say_error(error, as_json=getattr(options, "json", False))
        status = 2 if isinstance(error, InputError) else 1
    sys.stdout.flush()
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="kumitate", description="Assembly planning for dual-arm robots.")
    commands = parser.add_subparsers(required=True, metavar="command")
    add_plan(commands.add_parser("plan", help="plan a task, and verify the plan"))
    add_verify(commands.add_parser("verify", help="check a plan, independently of what made it"))
    add_replay(commands.add_parser("replay", help="write a page that plays a plan in a browser"))
    add_export(commands.add_parser("export", help="write a plan as ROS trajectories or as a table"))
    add_grasps(commands.add_parser("grasps", help="plan the grasps of a part by a hand"))
    add_placements(commands.add_parser("placements", help="find the stable placements of a part on a plane"))
    add_robots(commands.add_parser("robots", help="list the shipped robots and hands"))
    add_schema(commands.add_parser("schema", help="print the JSON Schema of task files or plans"))
    return parser


if __name__ == "__main__":
    sys.exit(main())
