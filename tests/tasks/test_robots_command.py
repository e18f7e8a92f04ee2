"""``kumitate robots``: what a task file may name."""

from __future__ import annotations

import pytest

from kumitate.robots.library import HANDS, ROBOTS, load_hand, load_robot
from kumitate.tasks.cli import main


@pytest.fixture(scope="module")
def lines():
    with pytest.MonkeyPatch.context() as patch:
        said: list[str] = []
        patch.setattr("kumitate.tasks.robots_command.say", said.append)
        assert main(["robots"]) == 0
    return said


def test_every_shipped_robot_is_listed_with_its_arms(lines):
    for name in ROBOTS:
        robot = load_robot(name)
        (line,) = [line for line in lines if line.split()[0] == name]
        assert line.split()[1] == str(len(robot.joint_names))
        for arm, mounted in robot.arms.items():
            assert f"{arm} ({len(mounted.indices)})" in line


def test_every_shipped_hand_is_listed_with_what_it_can(lines):
    for name in HANDS:
        hand = load_hand(name)
        (line,) = [line for line in lines if line.split()[0] == name]
        _, opens, force, *kind = line.split()
        assert opens == (f"{1e3 * hand.stroke[1]:.0f}" if hand.pads else "-")
        assert force == f"{hand.grip_force:.0f}"
        assert "_".join(kind) == hand.kind


def test_nothing_else_is_listed(lines):
    assert len(lines) == 2 + len(ROBOTS) + len(HANDS)
