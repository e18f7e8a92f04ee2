"""The command ``kumitate export``: a plan for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path

from .output import say, write_file
from .quantities import parse_quantity

_SUFFIXES = {"ros-json": ".trajectories.json", "ros-yaml": ".trajectories.yaml", "csv": ".csv"}


def add_export(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = (
        "Write a plan as ROS JointTrajectory messages, one for each action, or as a table with one row a sample."
    )
    parser.add_argument("plan", type=Path, help="a plan that `kumitate plan` wrote")
    parser.add_argument("--format", required=True, choices=_SUFFIXES, help="what to write")
    parser.add_argument("--step", default="20 ms", help='longest time between two points; "20 ms" unless given')
    parser.add_argument("--output", type=Path, metavar="FILE", help="the file; beside the plan unless given")
    parser.set_defaults(run=_export)


def _export(options: argparse.Namespace) -> int:
    import msgspec

    from .document import Plan
    from .export import table, trajectories

    step = parse_quantity(options.step, "time", "--step")
    plan = Plan.load(options.plan)
    if options.format == "csv":
        content = table(plan, step).encode()
    else:
        encode = msgspec.json.encode if options.format == "ros-json" else msgspec.yaml.encode
        content = encode(trajectories(plan, step))
    file = options.output or options.plan.with_suffix(_SUFFIXES[options.format])
    write_file(file, lambda path: path.write_bytes(content))
    say(f"{len(plan.actions)} actions, {plan.duration:.1f} s -> {file}")
    return 0
