"""The page of placements, in a browser without a network: each on its plate, hidden and shown one by one."""

from __future__ import annotations

import shutil

import pytest
import trimesh

from kumitate.grasping.part import Part
from kumitate.regrasp.placements import find_placements
from kumitate.tasks.view_placements import write_placement_page

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    part = Part.from_mesh(trimesh.creation.box([0.04, 0.03, 0.02]), mass=0.05, name="block <b>")
    path = tmp_path_factory.mktemp("page") / "block.html"
    write_placement_page(path, part, find_placements(part))
    return path


def test_the_page_lists_the_placements_and_escapes_names(page_file):
    text = page_file.read_text(encoding="utf-8")
    assert "Placements of block &lt;b&gt;" in text
    assert "block <b>" not in text
    assert text.count('data-path="placement') == 6
    assert text.count("<td>56.3</td><td>10.0</td><td>1200</td>") == 2


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_draws_each_placement_and_hides_it(page_file):
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        page = browser.new_context(offline=True).new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("request", lambda request: problems.append(request.url) if request.url.startswith("http") else None)
        page.goto(page_file.as_uri())
        page.wait_for_function("window.pageReady === true")
        find = 'viewer.scene_tree.find(["meshcat", "placement%d"]).object'
        for i in range(6):
            low = page.evaluate(
                f"""() => {{ const object = {find % i}; object.updateWorldMatrix(true, true);
                    return object.children[0].children.filter(o => o.isMesh).map(o => {{
                        o.geometry.computeBoundingBox();
                        const box = o.geometry.boundingBox.clone().applyMatrix4(o.matrix);
                        return [box.min.z, box.max.z]; }}); }}"""
            )
            plate, part = low
            assert plate[1] == pytest.approx(part[0], abs=1e-6)  # it stands on its plate
        page.uncheck('input[data-path="placement3"]')
        assert not page.evaluate(f"() => {find % 3}.visible")
        assert page.evaluate(f"() => {find % 2}.visible")
        assert problems == []
        browser.close()
