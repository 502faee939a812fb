"""An engineer records, labels and judges proposals, in Debian's Chromium."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lumpwatch.service.console.work import Library
from lumpwatch.service.console.work.tracks import Key, Track
from tests.bus.test_bus_support import eventually
from tests.console.chromium import needs_chromium
from tests.console.plant import Client, Console, Plant
from tests.console.test_console_browser import TEXT, violations

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def console(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    folder = tmp_path_factory.mktemp("console")
    with Console(plant, folder, '{listen: "127.0.0.1:0", anonymous: engineer}') as console:
        yield console


@pytest.fixture(scope="module")
def library(console: Console) -> Library:
    return Library(console.config.parent / "var" / "console" / "clips", 1 << 30)


@pytest.fixture
def page(browser: Browser, console: Console) -> Iterator[Page]:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if "Content Security" in said.text else None)
    page.on("dialog", lambda dialog: dialog.accept())
    yield page
    page.close()
    assert not wrong


@pytest.fixture(scope="module")
def clip(browser: Browser, console: Console, library: Library) -> str:
    """Recorded from the live camera through the page."""
    page = browser.new_page()
    page.goto(f"{console.url}/clips", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    page.fill("#record [name=seconds]", "3")
    page.click("#record button.primary")
    page.wait_for_selector("#clips tbody tr", timeout=20_000)
    page.close()
    (about,) = library.clips()
    assert (about.origin, about.camera, about.width, about.height) == ("recorded", "cam", 160, 120)
    assert 15 < about.frames <= 31
    assert about.fps == pytest.approx(10, rel=0.3)
    return about.id


def opened(page: Page, console: Console, clip: str) -> Page:
    page.goto(f"{console.url}/clips/{clip}", wait_until="commit")
    page.wait_for_selector("#stage[data-ready][data-frame='1']")
    return page


def drag(page: Page, begin: tuple[float, float], end: tuple[float, float]) -> None:
    """By the mouse, in pixels of the clip."""
    box = page.locator("#stage").bounding_box()
    assert box is not None
    (ax, ay), (bx, by) = [
        (box["x"] + x * box["width"] / 160, box["y"] + y * box["height"] / 120) for x, y in (begin, end)
    ]
    page.mouse.move(ax, ay)
    page.mouse.down()
    page.mouse.move((ax + bx) / 2, (ay + by) / 2)
    page.mouse.move(bx, by)
    page.mouse.up()


def saved(page: Page, library: Library, clip: str) -> tuple[Track, ...]:
    page.wait_for_selector("#saved:text-is('saved')")
    return library.labels(clip).labels.tracks


def test_boxes_by_mouse_and_keyboard_are_interpolated_and_exported(
    page: Page, console: Console, library: Library, clip: str
) -> None:
    opened(page, console, clip)
    drag(page, (20, 30), (60, 70))
    page.wait_for_selector("#lumps tr[data-id='1']")
    page.keyboard.press("PageDown")
    drag(page, (40, 50), (80, 60))  # where the lump was last, a dim box waits to be dragged
    (track,) = saved(page, library, clip)
    assert [key.frame for key in track.keys] == [1, 11]
    assert track.keys[0].place == pytest.approx((20, 30, 40, 40), abs=1.5)
    assert track.keys[1].place == pytest.approx((60, 40, 40, 40), abs=1.5)
    # In between by the keyboard: a nudge makes a key frame.
    for _ in range(5):
        page.keyboard.press("ArrowLeft")
    between = track.boxes()[5]
    assert float(page.input_value("#box [name=x]")) == pytest.approx(between.x, abs=0.1)
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Control+Shift+ArrowRight")
    (track,) = saved(page, library, clip)
    assert [key.frame for key in track.keys] == [1, 6, 11]
    assert track.keys[1].place == pytest.approx((between.x, between.y + 2, 42, 40), abs=0.1)
    page.keyboard.press("Delete")
    assert [key.frame for key in saved(page, library, clip)[0].keys] == [1, 11]
    page.keyboard.press("z")
    assert len(saved(page, library, clip)[0].keys) == 3
    # What is drawn elsewhere is another lump.
    drag(page, (120, 90), (150, 110))
    assert [len(track.keys) for track in saved(page, library, clip)] == [3, 1]
    page.keyboard.press("Shift+Delete")
    # A second lump by the keyboard alone, and its numbers typed in.
    page.keyboard.press("b")
    page.fill("#box [name=w]", "33")
    page.keyboard.press("Enter")
    page.focus("#stage")
    assert [key.w for key in saved(page, library, clip)[1].keys] == [33]
    _, headers, text = Client(console.url).ask("GET", f"/api/v1/clips/{clip}/labels.txt")
    assert headers["content-disposition"].startswith("attachment")
    rows = [line.split(",") for line in text.splitlines() if not line.startswith("#")]
    assert sorted({row[1] for row in rows}) == ["1", "2"]
    assert [row[0] for row in rows if row[1] == "1"] == [str(n) for n in range(1, 12)]
    page.keyboard.press("Shift+Delete")
    assert len(saved(page, library, clip)) == 1
    page.reload(wait_until="commit")
    page.wait_for_selector("#lumps tr[data-id='1']")


def test_proposals_are_judged_with_one_key_each(
    page: Page, console: Console, library: Library, clip: str
) -> None:
    key = Key(frame=3, x=10, y=10, w=20, h=20)
    later = key.model_copy(update={"frame": 9, "x": 70.0})
    before = library.labels(clip).labels.tracks
    library.propose(clip, tuple(Track(id=n, keys=(key, later), existence=0.6) for n in (1, 2, 3)))
    opened_at = f"{console.url}/clips/{clip}"
    page.goto(opened_at, wait_until="commit")
    page.wait_for_selector("#accept:not([disabled])")
    for answer in ("x", "y", "x"):
        page.keyboard.press(answer)
    page.wait_for_selector("#accept[disabled]")
    tracks = saved(page, library, clip)
    assert [track.keys for track in tracks] == [*(track.keys for track in before), (key, later)]
    assert library.labels(clip).labels.proposals == ()


def test_what_somebody_else_has_changed_is_not_overwritten(
    page: Page, console: Console, library: Library, clip: str
) -> None:
    opened(page, console, clip)
    kept = library.labels(clip)
    library.label(clip, kept.labels, kept.revision, "otto")
    page.keyboard.press("b")
    page.wait_for_selector("#wrong:has-text('otto has changed these labels')")
    assert library.labels(clip).labels == kept.labels


def test_a_file_is_taken_with_its_labels_and_its_name_stays_text(
    page: Page, console: Console, library: Library, clip: str, tmp_path: Path
) -> None:
    page.goto(f"{console.url}/clips", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    name = f"{TEXT}.mkv".replace("/", "")
    video: Any = {"name": name, "mimeType": "video/x-matroska", "buffer": library.video(clip).read_bytes()}
    page.set_input_files("#upload [name=file]", files=video)
    page.click("#upload button.primary")
    page.wait_for_selector("#clips tbody tr >> nth=1")
    assert name in page.inner_text("#clips")
    page.click("#clips tbody tr >> nth=0 >> a.button")
    page.wait_for_selector("#stage[data-ready]")
    labels: Any = {
        "name": "gt.txt",
        "mimeType": "text/plain",
        "buffer": b"1,5,10,10,20,20,1,1,1\n2,5,12,10,20,20,1,1,1\n",
    }
    page.set_input_files("#take", files=labels)
    page.wait_for_selector("#lumps tr[data-id='5']")
    labels = {**labels, "buffer": b"1,5,ten\n"}
    page.set_input_files("#take", files=labels)
    page.wait_for_selector("#wrong:has-text('line 1')")
    assert name in page.inner_text("h1")
    page.goto(f"{console.url}/training/cam/apron", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    assert name in page.inner_text("#clips")
    assert page.title() != "taken"
    assert not page.query_selector_all("#main img, #main script")
    page.goto(f"{console.url}/clips", wait_until="commit")
    page.wait_for_selector("#clips tbody tr")
    page.click("#clips tbody tr >> nth=0 >> text=Remove")
    eventually(lambda: len(library.clips()) == 1)


@pytest.mark.slow
def test_work_is_ordered_followed_and_cancelled_on_the_page(
    page: Page, console: Console, library: Library, clip: str
) -> None:
    page.goto(f"{console.url}/training/cam/apron", wait_until="commit")
    page.wait_for_selector("#main[data-ready]")
    page.click("[data-work=backtest]")
    page.click("#train button.primary")
    page.wait_for_selector("#jobs tr >> nth=2")
    page.click("#jobs tr[data-state=queued] >> text=Cancel")
    page.wait_for_selector("#jobs tr[data-state=cancelled]")
    page.wait_for_selector("#jobs tr[data-state=running] progress, #jobs tr[data-state=running]")
    page.reload(wait_until="commit")  # the page goes, the work goes on
    page.wait_for_selector("#jobs tr[data-state=running], #jobs tr[data-state=done]", timeout=20_000)
    page.click("#jobs tr:not([data-state=cancelled]) a")
    page.wait_for_selector("#main[data-state=done]", timeout=90_000)
    page.wait_for_selector("#backtest:not([hidden])")
    first = page.inner_text("#threshold")
    page.focus("#slider")
    page.keyboard.press("Home")
    assert float(page.inner_text("#threshold")) < float(first)
    assert re.search(r"\d+ of \d+", page.inner_text("#point"))


@pytest.mark.parametrize("size", [(1280, 800), (800, 1280)], ids=["desktop", "tablet"])
def test_axe_finds_no_violation(page: Page, console: Console, clip: str, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    jobs: list[dict[str, Any]] = json.loads(Client(console.url).ask("GET", "/api/v1/jobs")[2])["jobs"]
    paths = ["clips", f"clips/{clip}", "training/cam/apron", *(f"jobs/{job['id']}" for job in jobs[-1:])]
    if size[0] < size[1]:
        paths += ["", "cameras/cam", "alarms", "events", "shift", "trends", "health", "regions/cam/apron"]
    for path in paths:
        page.goto(f"{console.url}/{path}", wait_until="commit")
        page.wait_for_selector("#link:text-is('connected')")
        assert violations(page) == [], path
        assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0, path
