"""The page of grasps, in a browser without a network: it draws, hides and shows."""

from __future__ import annotations

import shutil
from dataclasses import replace

import pytest
import trimesh

from kumitate.grasping.parameters import GraspParameters
from kumitate.grasping.part import Part
from kumitate.grasping.planner import plan_grasps
from kumitate.grasping.record import Stage
from kumitate.robots.library import load_hand
from kumitate.tasks.view_grasps import write_grasp_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    part = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.05, name="block <b>")
    hand = load_hand("robotiq_2f85")
    grasps = plan_grasps(part, hand)
    foreign = Stage("stage <b>", 2, 1, {"reason <b>": 1})  # as a file that somebody else wrote may have it
    path = tmp_path_factory.mktemp("page") / "block.html"
    write_grasp_page(path, part, hand, GraspParameters(), replace(grasps, record=(*grasps.record, foreign)))
    return path


def test_the_page_needs_nothing_else_and_escapes_names(page_file):
    text = page_file.read_text(encoding="utf-8")
    assert "block &lt;b&gt; grasped by robotiq_2f85" in text
    assert "<td>stage &lt;b&gt;</td>" in text
    assert "1 reason &lt;b&gt;" in text
    assert "<b>" not in text[: text.index("<script>")]
    assert text.count("data-path=") >= 6
    assert len(text) < 5e6


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_draws_the_layers_and_hides_them(page_file):
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_context(offline=True).new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: problems.append(request.url) if request.url.startswith("http") else None)
        page.goto(page_file.as_uri())
        page.wait_for_function("window.pageReady === true")

        def meshes(layer):
            return page.evaluate(
                """layer => { let n = 0; viewer.scene_tree.find(["meshcat", layer]).object.traverse(
                    o => { if (o.isMesh || o.isPoints || o.isLineSegments) n += 1; }); return n; }""",
                layer,
            )

        def visible(layer):
            return page.evaluate('layer => viewer.scene_tree.find(["meshcat", layer]).object.visible', layer)

        assert meshes("part") == meshes("contacts") == meshes("pairs") == 1
        assert meshes("facets") == 6
        assert meshes("kept") == 24 * len(load_hand("robotiq_2f85").pieces)
        assert visible("kept")
        assert not visible("colliding")
        page.check('input[data-path="colliding"]')
        page.uncheck('input[data-path="kept"]')
        assert visible("colliding")
        assert not visible("kept")
        assert problems == []
        browser.close()
