"""Names and words that are HTML and JavaScript: pages show them as they are, and nothing of them runs."""

from __future__ import annotations

import json
from dataclasses import replace

import msgspec
import pytest
import trimesh
from plans import short_plan
from stills import CHROMIUM, opened

from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.regrasp.placements import find_placements
from kumitate.robots.library import load_hand
from kumitate.tasks.document import Plan
from kumitate.tasks.reasons import Report
from kumitate.tasks.replay import write_replay
from kumitate.tasks.view_blocked import write_blocked_page
from kumitate.tasks.view_grasps import write_grasp_page
from kumitate.tasks.view_placements import write_placement_page

EVIL = (
    "</script><script>window.ran = 1; alert(1)</script>--><!--<svg onload='window.ran = 2'>"
    '"\'><img src=x onerror="window.ran = 3; alert(3)">`${window.ran = 4}`&lt;@motion@{panel}\u2028%s\\'
)


def replayed(path):
    """The replay of a plan whose part, obstacle and words are all evil."""
    document = msgspec.to_builtins(short_plan())
    for action in document["actions"]:
        action["words"] = EVIL
    text = json.dumps(document)
    for name, evil in (("block", EVIL), ("table", f"{EVIL} table")):
        text = text.replace(json.dumps(name), json.dumps(evil))
    write_replay(msgspec.json.decode(text.encode(), type=Plan), path)


def grasped(path):
    part = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.05, name=EVIL)
    hand, coarse = replace(load_hand("suction_cup"), name=EVIL), GraspParameters(t_rnn=8e-3, n_da=2)
    write_grasp_page(path, part, hand, coarse, plan_grasps(part, hand, coarse))


def placed(path):
    part = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.05, name=EVIL)
    write_placement_page(path, part, find_placements(part))


def blocked(path):
    write_blocked_page(path, Report(0, EVIL, (), notes=(EVIL,)), [EVIL])


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
@pytest.mark.parametrize("write", [replayed, grasped, placed, blocked])
def test_nothing_of_a_name_runs(tmp_path, write):
    pytest.importorskip("playwright.sync_api")
    write(tmp_path / "page.html")
    with opened(tmp_path / "page.html") as (page, problems):
        page.wait_for_timeout(100)  # time enough for an image that is not there
        assert page.evaluate("window.ran") is None
        assert EVIL in page.evaluate("document.querySelector('#panel').textContent")
        assert page.evaluate("document.querySelectorAll('img, svg:not(.dg *), #panel script').length") == 0
        if write is replayed:
            assert page.title() == f"nextage: {EVIL}"
            assert len(page.evaluate("name => replay.poseOf(name).position", EVIL)) == 3
        assert problems == []
