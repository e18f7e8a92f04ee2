"""The error that tells why there is no way: its cause, and figures that are those of the search."""

from __future__ import annotations

import numpy as np
import pytest
from tabletops import Tabletop, tabletop

from kumitate.errors import NoRegraspError, PlanningError
from kumitate.regrasp.graph import Goal, Held, RegraspGraph
from kumitate.regrasp.reach import Node
from kumitate.regrasp.report import report_on

ARMS = ("left", "right")


@pytest.fixture(scope="module")
def table() -> Tabletop:
    return tabletop("ur3_dual", "bracket")


def search(table: Tabletop, start, goals, between=(), arms=ARMS, n=30, held=None, failures=()) -> NoRegraspError:
    """The error after a search of all routes."""
    grasps = table.grasps.thin(n) if n else table.grasps[:0]
    reacher = table.reacher(start.world_from_part, grasps, arms)
    graph = RegraspGraph(reacher, start, held, between)
    ends = [Goal(goal, {arm: np.ones(n, dtype=bool) for arm in arms}) for goal in goals]
    list(graph.routes(graph.reachable(ends), most_regrasps=1))
    return report_on(graph, ends, failures)


@pytest.fixture(scope="module")
def here(table):
    return table.node("start", table.at([0.3, -0.2, 0.025]))


@pytest.fixture(scope="module")
def over_there(table):
    """Upside down, where nothing but a regrasp helps."""
    return table.node("goal", table.at([0.3, -0.25, 0.025], [np.pi, 0.0, 0.0]))


def test_a_hand_without_a_grasp(table, here, over_there):
    error = search(table, here, [over_there], n=0)
    assert isinstance(error, PlanningError)
    assert error.part == "bracket"
    assert error.cause == "no hand has a grasp of it; is the hand too small?"
    assert str(error) == f"no way for bracket: {error.cause}"


def test_a_start_that_no_arm_reaches(table, over_there):
    error = search(table, table.node("start", table.at([0.8, 0.0, 0.025])), [over_there])
    assert error.cause.startswith("no grasp of it works where it is: ")
    assert "no inverse kinematics" in error.cause


def test_a_goal_that_no_arm_reaches(table, here):
    error = search(table, here, [table.node("goal", table.at([0.8, 0.0, 0.025]))])
    assert error.cause.startswith("no grasp of it works at the goal: ")
    assert "no inverse kinematics" in error.cause


def test_a_goal_that_stands_in_something(table, here):
    error = search(table, here, [table.node("goal", table.at([0.3, 0.2, 0.01]))])
    assert error.cause == "no grasp of it works at the goal: part against table / bracket"


def test_several_goals_of_which_one_is_reached(table, here, over_there):
    far = table.node("far away", table.at([0.8, 0.0, 0.025]))
    error = search(table, here, [far, over_there], arms=("right",))
    assert error.cause.startswith("no grasp is shared by start and goal")
    assert any(line.startswith("far away, right arm: 0 of 30 grasps work") for line in error.report)
    assert any(line.startswith("goal, right arm: ") for line in error.report)


def test_no_support_and_no_second_arm(table, here, over_there):
    error = search(table, here, [over_there], arms=("right",))
    words = "no grasp is shared by start and goal, and there is no support to put it down on, nor a second arm"
    assert error.cause == words
    assert error.report[-1] == "0 of 0 placements and handovers looked at, 0 with any grasp"


def test_nodes_that_lead_nowhere(table, here, over_there):
    useless = [table.node("sunk", table.at([0.3, 0.0, 0.01])), table.node("far", table.at([0.8, 0.3, 0.025]))]
    error = search(table, here, [over_there], useless, arms=("right",))
    assert (
        error.cause
        == "no grasp is shared by start and goal, nor along any way over the placements and handovers looked at"
    )
    assert error.report[-1] == "2 of 2 placements and handovers looked at, 0 with any grasp"


def test_motions_that_failed_come_last_each_once(table, here, over_there):
    failures = ["start to goal: lift of bracket by the right arm: blocked", "start to goal: transfer: no path"]
    error = search(table, here, [over_there], arms=("right",), failures=[failures[0], *failures])
    assert error.cause == f"no motion was found: {failures[1]}"
    assert error.report[-2:] == tuple(failures)


def test_a_part_that_is_held_is_not_said_to_be_out_of_reach(table, over_there):
    held = Held("right", 0, np.zeros(6))
    start = Node("start", table.at([0.8, 0.0, 0.4]), None)
    error = search(table, start, [over_there], arms=("right",), held=held)
    assert "where it is" not in error.cause


def test_figures_are_those_of_the_search(table, here, over_there):
    grasps = table.grasps.thin(30)
    reacher = table.reacher(here.world_from_part, grasps, ARMS)
    graph = RegraspGraph(reacher, here, None, [])
    goals = [Goal(over_there, {arm: np.ones(30, dtype=bool) for arm in ARMS})]
    list(graph.routes(goals))
    lines = report_on(graph, goals, []).report
    for node, arm in ((node, arm) for node in ("start", "goal") for arm in ARMS):
        if (node, arm) in reacher.tested():
            asked, kept = reacher.tested()[node, arm]
            (line,) = (line for line in lines if line.startswith(f"{node}, {arm} arm: "))
            assert line.startswith(f"{node}, {arm} arm: {kept} of {asked} grasps work (")
            causes = line[line.index("(") + 1 : -1].split(", ")
            shown = sum(int(cause.split(" ", 1)[0]) for cause in causes)
            assert 0 < shown <= asked - kept
            first = int(causes[0].split(" ", 1)[0])
            assert first == max(reacher.dropped()[node, arm].values())
