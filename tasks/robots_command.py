"""The command ``kumitate robots``: the shipped robots and hands, as task files name them."""

from __future__ import annotations

import argparse

from .output import say


def add_robots(parser: argparse.ArgumentParser) -> None:
    """Describe the command."""
    parser.description = "List the shipped robots with their arms, and the shipped hands."
    parser.set_defaults(run=_robots)


def _robots(options: argparse.Namespace) -> int:
    from ..robots.library import HANDS, ROBOTS, load_hand, load_robot

    say(f"{'robot':<24}{'joints':>8}  arms (joints)")
    for robot in map(load_robot, ROBOTS):
        arms = ", ".join(f"{name} ({len(arm.indices)})" for name, arm in robot.arms.items())
        say(f"{robot.name:<24}{len(robot.joint_names):>8}  {arms}")
    say(f"{'hand':<24}{'opens mm':>8}{'force N':>10}  kind")
    for hand in map(load_hand, HANDS):
        opens = f"{hand.stroke[1] * 1e3:.0f}" if hand.pads else "-"
        say(f"{hand.name:<24}{opens:>8}{hand.grip_force:>10.0f}  {hand.kind.replace('_', ' ')}")
    return 0
