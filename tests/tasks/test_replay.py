"""The replay page, in a browser without a network: it shows the plan, seeks, plays, and keeps to its size."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import stills
import trimesh
from msgspec.structs import replace
from plans import sample_plan
from scipy.spatial.transform import Rotation
from stills import CHROMIUM, opened

from kumitate.errors import InputError
from kumitate.tasks.document import Mesh, matrix
from kumitate.tasks.replay import write_replay

LARGEST = 6_000_000  # bytes
WORDS = "left hand <b>goes</b> & takes"


@pytest.fixture(scope="module")
def plan():
    whole = sample_plan()
    return replace(whole, actions=(replace(whole.actions[0], words=WORDS), *whole.actions[1:]))


@pytest.fixture(scope="module")
def page_file(plan, tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "plan.html"
    write_replay(plan, path)
    return path


@pytest.fixture(scope="module")
def browser(page_file):
    if CHROMIUM is None:
        pytest.skip("no Chromium here")
    pytest.importorskip("playwright.sync_api")
    with opened(page_file, size=(820, 500)) as both:
        yield both


@pytest.fixture
def page(browser):
    """The page, standing still at its start; at the end it has had no error and asked for nothing."""
    page, problems = browser
    page.evaluate("() => { replay.pause(); replay.speed = 1; replay.seek(0); }")
    yield page
    assert problems == []


def starts(plan):
    return np.cumsum([0.0, *(action.motion.duration for action in plan.actions)])


def position_of(page, name):
    return np.array(page.evaluate("name => replay.poseOf(name).position", name))


def lit(page):
    return page.eval_on_selector_all("#steps li", "all => all.flatMap((li, i) => li.className === 'now' ? [i] : [])")


def test_the_page_is_small_needs_nothing_else_and_escapes_words(page_file, plan):
    text = page_file.read_text(encoding="utf-8")
    assert len(text) < LARGEST / 4
    assert "left hand &lt;b&gt;goes&lt;/b&gt; &amp; takes" in text
    assert WORDS not in text
    assert text.count("<li ") == len(plan.actions)
    assert "src=" not in text.split("<script>")[0]


def test_every_step_stands_there_with_its_times(page, plan):
    assert page.title() == "nextage: block, peg, tube"
    rows = page.eval_on_selector_all("#steps li", "all => all.map(li => [...li.children].map(x => x.textContent))")
    assert rows == [
        [str(i), action.words, f"{start:.1f} s + {action.motion.duration:.1f} s"]
        for i, (start, action) in enumerate(zip(starts(plan), plan.actions, strict=False), start=1)
    ]
    assert page.evaluate("replay.duration") == pytest.approx(plan.duration, abs=1e-4)
    assert page.text_content("#clock") == f"0.0 of {plan.duration:.1f} s"


def test_at_every_end_parts_are_where_the_plan_says(page, plan):
    parts = list(plan.meshes.keys() - {"table"})
    found = page.evaluate(
        "([times, parts]) => times.map(time => { replay.seek(time); return parts.map(replay.poseOf); })",
        [starts(plan)[1:].tolist(), parts],
    )
    for poses, action in zip(found, plan.actions, strict=True):
        for part, pose in zip(parts, poses, strict=True):
            expected = np.array(action.end.poses[part])
            assert np.abs(pose["position"] - expected[:3, 3]).max() < 5e-5
            assert np.abs(Rotation.from_quat(pose["quaternion"]).as_matrix() - expected[:3, :3]).max() < 5e-5


def test_what_is_drawn_is_the_part_where_its_pose_is(page, plan):
    page.evaluate("time => { replay.seek(time); viewer.render(); }", plan.duration)
    for i, (part, pose) in enumerate(plan.actions[-1].end.poses.items()):
        box = page.evaluate(
            """path => { const drawn = viewer.scene_tree.find(path).object.children[0].children[0];
                drawn.geometry.computeBoundingBox();
                const box = drawn.geometry.boundingBox.applyMatrix4(drawn.matrixWorld);
                return [box.min, box.max].map(corner => [corner.x, -corner.z, corner.y]); }""",
            ["meshcat", "parts", str(i)],
        )
        corners = trimesh.transform_points(trimesh.bounds.corners(plan.meshes[part].trimesh().bounds), np.array(pose))
        drawn = np.array(box)
        assert drawn.min(axis=0) == pytest.approx(corners.min(axis=0), abs=1e-4)
        assert drawn.max(axis=0) == pytest.approx(corners.max(axis=0), abs=1e-4)


def test_a_click_on_a_step_goes_there_and_lights_it(page, plan):
    assert lit(page) == [0]
    before = position_of(page, "block")
    for i in (10, len(plan.actions) - 1, 4):
        page.click(f"#steps li:nth-child({i + 1})")
        assert lit(page) == [i]
        assert page.evaluate("replay.time") == pytest.approx(starts(plan)[i], abs=1e-5)
        assert page.evaluate("+document.querySelector('#slider').value") == pytest.approx(starts(plan)[i], abs=1e-5)
        expected = np.array(plan.actions[i].start.poses["block"])[:3, 3]
        position = position_of(page, "block")
        assert np.abs(position - expected).max() < 5e-5
        assert np.abs(position - before).max() > 0.01
        inside = page.evaluate(
            """() => { const list = document.querySelector("#steps").getBoundingClientRect();
                const step = document.querySelector("#steps .now").getBoundingClientRect();
                return list.top <= step.top && step.bottom <= list.bottom; }"""
        )
        assert inside


def test_play_moves_time_on_and_pause_stops_it(page):
    for go in (lambda: page.click("#play"), lambda: page.keyboard.press("Space")):
        before = page.evaluate("replay.time")
        go()
        assert page.text_content("#play") == "Pause"
        page.wait_for_function("before => replay.time > before + 0.2", arg=before)
        go()
        assert page.text_content("#play") == "Play"
        stopped = page.evaluate("replay.time")
        page.wait_for_timeout(150)
        assert page.evaluate("replay.time") == stopped
        assert not page.evaluate("replay.playing")


def test_it_stops_at_the_end_and_begins_again(page, plan):
    page.evaluate("() => { replay.seek(replay.duration - 0.2); replay.play(); }")
    page.wait_for_function("!replay.playing")
    assert page.evaluate("replay.time === replay.duration")
    assert lit(page) == [len(plan.actions) - 1]
    page.click("#play")
    page.wait_for_function("replay.playing && 0 < replay.time && replay.time < replay.duration / 2")


@pytest.mark.parametrize("speed", [0.25, 0.5, 1, 2, 4])
def test_the_speed_is_that_of_the_button(page, speed):
    page.click(f'button[data-speed="{speed}"]')
    assert page.eval_on_selector_all("[data-speed].on", "all => all.map(x => +x.dataset.speed)") == [speed]
    ratio = page.evaluate(
        """() => new Promise(done => {
            let first;
            const look = now => {
                const here = [replay.time, now / 1000];
                if (first === undefined) first = here;
                if (here[1] - first[1] < 0.3) return requestAnimationFrame(look);
                replay.pause();
                done((here[0] - first[0]) / (here[1] - first[1]));
            };
            replay.play();
            requestAnimationFrame(() => requestAnimationFrame(look));
        })"""
    )
    assert ratio == pytest.approx(speed, rel=1e-3)


def test_the_slider_seeks(page, plan):
    page.evaluate("() => { slider.value = 12.5; slider.dispatchEvent(new Event('input')); }")
    assert page.evaluate("replay.time") == pytest.approx(12.5, abs=1e-6)
    assert lit(page) == [int(np.searchsorted(starts(plan), 12.5)) - 1]


def test_boxes_hide_robot_hands_cell_and_parts(page):
    for path in ("robot", "hands", "cell", "parts/1"):
        visible = f"viewer.scene_tree.find(['meshcat', ...'{path}'.split('/')]).object.visible"
        page.uncheck(f'input[data-path="{path}"]')
        assert not page.evaluate(visible)
        page.check(f'input[data-path="{path}"]')
        assert page.evaluate(visible)


def test_the_camera_stands_in_front_and_goes_where_it_is_told(page):
    def seen(name):
        return page.evaluate(
            """name => { viewer.render(); const [x, y, z] = replay.poseOf(name).position;
                const p = new MeshCat.THREE.Vector3(x, z, -y).project(viewer.camera); return [p.x, p.y, p.z]; }""",
            name,
        )

    left, right = seen("left/base"), seen("right/base")
    assert right[0] < left[0]  # its left is on the right, seen from the front
    for name in ("block", "peg", "tube", "left/base", "right/base"):
        assert np.abs(seen(name)).max() < 1.0
    assert seen("left/base")[1] > seen("block")[1]  # up is up
    position = position_of(page, "peg")
    beside = position + np.array([0.3, 0.1, 0.2])
    page.evaluate("([from, to]) => replay.camera(from, to)", [beside.tolist(), position.tolist()])
    assert seen("peg")[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_stills_are_pictures_of_their_moments(page_file):
    pytest.importorskip("playwright.sync_api")
    where = ["--camera", "1.2", "0.3", "0.6", "--target", "0.4", "0", "0.1", "--scene", "--size", "320", "240"]
    command = [sys.executable, stills.__file__, str(page_file), "--at", "0", "8.5", *where]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
    first, second = (Path(file).read_bytes() for file in printed)
    assert printed == [str(page_file.with_suffix(suffix)) for suffix in (".0.png", ".8.5.png")]
    assert first.startswith(b"\x89PNG")
    assert first != second


@pytest.mark.slow
def test_half_an_hour_and_fine_meshes_keep_to_the_size(plan, tmp_path):
    ball = trimesh.creation.icosphere(7, 0.03)
    long = replace(plan, actions=plan.actions * 41, meshes={**plan.meshes, "peg": Mesh.of(ball)})
    assert long.duration > 1800.0
    assert len(ball.faces) > 300_000
    write_replay(long, tmp_path / "long.html")
    assert (tmp_path / "long.html").stat().st_size < LARGEST


def test_motions_that_numbers_of_the_page_cannot_hold_are_told(plan, tmp_path):
    action = plan.actions[0]
    there = np.eye(4)
    there[0, 3] = 1e9
    far = dict.fromkeys(action.start.poses, matrix(there))
    moved = replace(action, start=replace(action.start, poses=far))
    with pytest.raises(InputError, match="moves kilometres"):
        write_replay(replace(plan, actions=(moved, *plan.actions[1:])), tmp_path / "page.html")


def test_a_plan_whose_triangles_are_missing_or_broken_is_told(plan, tmp_path):
    meshes = {
        "no triangles": {**plan.meshes, "table": Mesh("AAAA", "AAAA")},
        r"peg: no triangles": {**plan.meshes, "peg": Mesh("", "")},
        "no mesh named 'table'": {name: mesh for name, mesh in plan.meshes.items() if name != "table"},
    }
    for words, given in meshes.items():
        with pytest.raises(InputError, match=words):
            write_replay(replace(plan, meshes=given), tmp_path / "page.html")
    assert not (tmp_path / "page.html").exists()
