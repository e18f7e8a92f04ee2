"""The page of what is in the way, in a browser without a network: red is what blocks, and it is in view."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from infeasible import refusal
from stills import CHROMIUM, opened

from kumitate.regrasp.diagnosis import Cause
from kumitate.tasks.reasons import Report
from kumitate.tasks.view_blocked import write_blocked_page

in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
LOOK = """color => {
    viewer.camera.updateMatrixWorld(true);
    const found = [];
    viewer.scene.updateMatrixWorld(true);
    viewer.scene.traverse(object => {
        if (object.isMesh && object.material.color && object.material.color.getHex() === color) {
            object.geometry.computeBoundingBox();
            const box = object.geometry.boundingBox;
            const place = box.min.clone().add(box.max).multiplyScalar(0.5).applyMatrix4(object.matrixWorld);
            const seen = place.clone().project(viewer.camera);
            found.push({place: [place.x, -place.z, place.y], seen: [seen.x, seen.y], opacity: object.material.opacity});
        }
    });
    return found;
}"""
RED, PART, HAND = 0xD0021B, 0xE8801A, 0x59616E


@contextlib.contextmanager
def page_of(name, tmp_path):
    """What finds the meshes of a colour on a task's page."""
    pytest.importorskip("playwright.sync_api")
    file = tmp_path / "page.html"
    write_blocked_page(file, refusal(name).report, ["without it there is a plan"])
    with opened(file) as (page, problems):
        yield lambda color: page.evaluate(LOOK, color)
        assert problems == []


@in_a_browser
@pytest.mark.parametrize(
    ("name", "places"),
    [
        ("a lid over the part", [(0.4, 0.25, 0.08)]),
        ("a bar across the bore", [(0.35, -0.2, -0.025), (0.35, 0.35, -0.005)]),
    ],
)
def test_red_is_what_blocks_and_nothing_else_and_it_is_in_view(name, places, tmp_path):
    with page_of(name, tmp_path) as look:
        red = look(RED)
        np.testing.assert_allclose(sorted(mesh["place"] for mesh in red), places, atol=1e-4)
        for mesh in [*red, *look(PART)]:
            assert max(map(abs, mesh["seen"])) < 0.9


@in_a_browser
def test_a_hand_that_no_arm_brings_there_is_pale_and_at_the_part(tmp_path):
    with page_of("a goal out of reach", tmp_path) as look:
        assert look(RED) == []
        pale = [mesh for mesh in look(HAND) if mesh["opacity"] < 1.0]
        assert len(pale) == len(look(HAND)) / 3  # two hands are on the robot
        (part,) = look(PART)
        assert part["place"] == pytest.approx([0.5, 0.6, 0.01], abs=1e-4)  # where it shall be
        assert part["seen"] == pytest.approx([0.0, 0.0], abs=1e-3)
        for mesh in pale:
            assert mesh["place"] == pytest.approx(part["place"], abs=0.25)


def test_the_page_tells_all_of_the_report_and_escapes_names(tmp_path):
    file, cause = tmp_path / "page.html", Cause("hand against", ("<b>lid</b>",))
    report = Report(1, "no grasp of <i>block</i> works", ((cause, 3),), notes=("a & b",))
    write_blocked_page(file, report, ["without <u>it</u> there is a plan"])
    text = file.read_text(encoding="utf-8")
    for line in ("goal 2 is not reached: no grasp of &lt;i&gt;block&lt;/i&gt; works", "&lt;b&gt;lid&lt;/b&gt; (3)"):
        assert line in text
    assert "<p>a &amp; b</p>" in text
    assert "<p>without &lt;u&gt;it&lt;/u&gt; there is a plan</p>" in text
    assert not any(tag in text for tag in ("<b>lid", "<i>block", "<u>it"))


def test_what_is_red_is_named(tmp_path):
    file = tmp_path / "page.html"
    write_blocked_page(file, refusal("a goal that is occupied").report)
    text = file.read_text(encoding="utf-8")
    assert "<p>in the way, red: crate</p>" in text
    assert "what would help" not in text
    assert len(text) < 5e6


def test_a_page_that_cannot_be_written_is_an_error(tmp_path):
    with pytest.raises(OSError, match="none"):
        write_blocked_page(tmp_path / "none" / "page.html", refusal("a goal that is occupied").report)
