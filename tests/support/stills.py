"""Stills of a replay page: PNG pictures at given moments, drawn by a headless Chromium without a network.

As a script: ``python tests/support/stills.py plan.html --at 3.2 7.5``, with ``--camera`` and ``--target`` to look from
elsewhere and ``--scene`` to leave the panel out.
"""

from __future__ import annotations

import argparse
import contextlib
import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]


@contextlib.contextmanager
def opened(page_file: Path, size: tuple[int, int] = (1280, 720)) -> Iterator[tuple[Any, list[str]]]:
    """The page of a file once it is ready, and a list that fills with its errors and requests."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        context = browser.new_context(offline=True, viewport={"width": size[0], "height": size[1]})
        page = context.new_page()
        problems: list[str] = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda said: problems.append(said.text) if said.type == "error" else None)
        page.on("request", lambda request: problems.append(request.url) if request.url.startswith("http") else None)
        page.goto(page_file.resolve().as_uri())
        page.wait_for_function("window.pageReady === true")
        yield page, problems
        browser.close()


def stills(
    page_file: Path,
    times: Sequence[float],
    *,
    camera: Sequence[float] | None = None,
    target: Sequence[float] | None = None,
    scene: bool = False,
    size: tuple[int, int] = (1280, 720),
) -> list[Path]:
    """Draw a replay page at ``times`` [s] into PNG files beside it, from ``camera`` at ``target`` [m] if given."""
    files = []
    with opened(page_file, size) as (page, problems):
        if scene:
            page.add_style_tag(content="#panel { display: none !important } #view { left: 0 !important }")
            page.evaluate("viewer.set_3d_pane_size()")
        if camera is not None and target is not None:
            page.evaluate("([from, to]) => replay.camera(from, to)", [list(camera), list(target)])
        for time in times:
            page.evaluate("time => { replay.seek(time); viewer.render(); }", time)
            page.wait_for_timeout(100)
            files.append(page_file.with_suffix(f".{time:g}.png"))
            page.screenshot(path=files[-1])
        if problems:
            raise RuntimeError("; ".join(problems))
    return files


def _main() -> None:
    parser = argparse.ArgumentParser(description="Stills of a replay page.")
    parser.add_argument("page", type=Path)
    parser.add_argument("--at", type=float, nargs="+", required=True, metavar="SECONDS")
    parser.add_argument("--camera", type=float, nargs=3, metavar=("X", "Y", "Z"), help="m; needs --target")
    parser.add_argument("--target", type=float, nargs=3, metavar=("X", "Y", "Z"), help="m; needs --camera")
    parser.add_argument("--scene", action="store_true", help="without the panel")
    parser.add_argument("--size", type=int, nargs=2, default=(1280, 720), metavar=("WIDTH", "HEIGHT"))
    given = parser.parse_args()
    for file in stills(
        given.page,
        given.at,
        camera=given.camera,
        target=given.target,
        scene=given.scene,
        size=tuple(given.size),
    ):
        print(file)  # noqa: T201


if __name__ == "__main__":
    _main()
