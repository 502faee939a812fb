"""A newcomer commissions a recorded feed from nothing to a promoted prior, in the browser alone."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from lumpwatch.service.config import load_config
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage import PriorStore, read_labels
from tests.bus.test_bus_support import eventually, free_endpoint
from tests.console.chromium import needs_chromium
from tests.integration.site import LUMPWATCH

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SIZE = (320, 240)
KEYS = 16
"""Every so many frames a box is drawn."""


@contextlib.contextmanager
def watched(folder: Path, feed: FeedSpec, seconds: float) -> Iterator[tuple[Path, str, Path]]:
    """A daemon on a recorded feed of which it knows nothing, and its console: configuration, address, labels."""
    written = write_video(feed, seconds, folder)
    config = folder / "site.yaml"
    # A given share of evidence spares the training its longest step.
    config.write_text(f"""\
site: pit
bus: {{mode: router, listen: ["{free_endpoint()}"]}}
store: {{path: var}}
telemetry: {{listen: "127.0.0.1:0"}}
console: {{listen: "127.0.0.1:0", anonymous: engineer}}
cameras:
  - id: cam
    source: {{url: "{written.video}", loop: true}}
    rois:
      - id: apron
        polygon: [[0.05, 0.05], [0.95, 0.05], [0.95, 0.95], [0.05, 0.95]]
        detector: {{working_size_px: 160, particles: 500, likelihood: {{kind: lump, evidence: 0.8}}}}
""")
    said = folder / "said.log"
    with said.open("ab") as out:
        processes = [
            subprocess.Popen([*LUMPWATCH, command, str(config)], stdout=out, stderr=out)
            for command in ("run", "console")
        ]
    try:
        eventually(lambda: re.search(r"console on (http\S+)", said.read_text()), 90.0)
        yield config, re.findall(r"console on (http\S+)", said.read_text())[0], written.labels
    finally:
        for process in reversed(processes):
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=30)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[Path, str, Path]]:
    feed = FeedSpec(seed=3, fps=10, width=SIZE[0], height=SIZE[1], lump_spacing_s=2.5, lumps_per_minute=20)
    with watched(tmp_path, feed, 15.0) as made:
        yield made


def at(page: Page, x: float, y: float) -> tuple[float, float]:
    """A place in the picture, relative, as one on the screen; it must be in sight."""
    page.locator("#stage").scroll_into_view_if_needed()
    box = page.locator("#stage").bounding_box()
    assert box is not None
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def drag(page: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    page.mouse.move(*at(page, *begin))
    page.mouse.down()
    page.mouse.move(*at(page, *end), steps=2)
    page.mouse.up()


def go(page: Page, frame: int) -> None:
    """To a frame by the keyboard."""
    page.focus("#stage")
    page.keyboard.press("Home")
    for key, times in (("PageDown", (frame - 1) // 10), ("ArrowRight", (frame - 1) % 10)):
        for _ in range(times):
            page.keyboard.press(key)
    page.wait_for_selector(f"#stage[data-frame='{frame}']")


def draw_region(page: Page, url: str) -> None:
    """The belt, with its lip and four points of known places."""
    page.goto(f"{url}/regions/cam/apron", wait_until="commit")
    page.wait_for_selector(
        "#stage[data-ready][data-still]", timeout=60_000
    )  # the camera may still be starting
    for begin, end in (
        ((0.05, 0.05), (0.3, 0.0)),
        ((0.95, 0.05), (0.7, 0.0)),
        ((0.95, 0.95), (0.89, 0.95)),
        ((0.05, 0.95), (0.11, 0.95)),
    ):
        drag(page, begin, end)
    page.wait_for_selector("#save:not([disabled])")
    page.click("#save")
    page.wait_for_selector("#toast:text('Written')")


def label(page: Page, labels: Path) -> int:
    """Each lump that the belt carries, by a box every few frames; gives how many there are."""
    tracks: dict[int, dict[int, tuple[float, ...]]] = {}
    for box in read_labels(labels):
        tracks.setdefault(box.track, {})[box.frame] = (box.x, box.y, box.w, box.h)
    drawn = 0
    for boxes in tracks.values():
        frames = [frame for frame in sorted(boxes) if boxes[frame][3] > 12]
        if len(frames) < KEYS:
            continue
        drawn += 1
        for i, frame in enumerate([*frames[:-1:KEYS], frames[-1]]):
            go(page, frame)
            x, y, w, h = boxes[frame]
            if i == 0:
                page.keyboard.press("Escape")
                drag(page, (x / SIZE[0], y / SIZE[1]), ((x + w) / SIZE[0], (y + h) / SIZE[1]))
                page.wait_for_selector(f"#lumps tr[aria-selected=true] >> text=lump {drawn}")
            else:  # by its numbers: a person would drag its corners
                for name, value in (("x", x), ("y", y), ("w", w), ("h", h)):
                    page.fill(f"#box [name={name}]", f"{value:.1f}")
                    page.keyboard.press("Enter")
    page.wait_for_selector("#saved:text-is('saved')")
    return drawn


@pytest.mark.slow
@needs_chromium
def test_from_nothing_to_a_promoted_prior(browser: Browser, site: tuple[Path, str, Path]) -> None:
    config, url, labels = site
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    draw_region(page, url)
    assert load_config(config).camera("cam").roi("apron").polygon[0] == pytest.approx((0.3, 0.0), abs=0.01)

    page.goto(f"{url}/clips", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    page.set_input_files("#upload [name=file]", labels.parent / "video.mp4")
    page.click("#upload button.primary")
    page.click("#clips a.button")
    page.wait_for_selector("#stage[data-ready]")
    lumps = label(page, labels)
    assert lumps >= 3

    page.goto(f"{url}/training/cam/apron", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    page.select_option("[name=folds]", "0")
    page.click("#train button.primary")
    page.wait_for_selector("#jobs tr[data-state=done]", timeout=240_000)
    page.wait_for_selector("#priors tr[data-state='in shadow']")
    store = PriorStore(config.parent / "var")
    assert store.load("cam", "apron", 1).learned.tracks == lumps
    # The daemon runs it beside the stated defaults, and tells how they differ.
    page.wait_for_selector("#trial pre:has-text('version 1')", timeout=60_000)
    page.click("#promote")
    page.wait_for_selector("#priors tr[data-version='1'][data-state='in use']")
    assert "console: version 1 is promoted" in page.inner_text("#deeds")
    assert store.pointer("cam", "apron") == 1
    page.click("#priors tr[data-version='1'] >> text=Report")
    page.wait_for_selector("h1, h2")
    assert f"from {lumps} labelled lumps" in page.inner_text("body")
    page.goto(f"{url}/training/cam/apron", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    page.click("[data-work=replay]")
    page.locator("#jobs tr a", has_text="replay").click()  # waits until it is listed
    page.wait_for_selector("#overlay:not([hidden])", timeout=120_000)
    page.wait_for_function("() => document.querySelector('#overlay video').duration > 10")
    found = json.loads(
        (next((config.parent / "var" / "console" / "jobs").glob("*/summary.json"))).read_text()
    )
    assert found["rois"]["apron"]["prior"] == 1
    page.close()
