"""Makes the pictures of docs/console.md, of the demo and of a newcomer: `make pictures`, with Debian's chromium."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from lumpwatch.service.simulator.spec import FeedSpec
from tests.bus.test_bus_support import eventually
from tests.console.test_console_newcomer import watched
from tests.integration.site import LUMPWATCH

IMAGES = Path(__file__).parents[2] / "docs" / "images"
PAGES = {
    "live": "/cameras/crusher-1",
    "alarms": "/alarms",
    "events": "/events",
    "shift": "/shift",
    "trends": "/trends?hours=8",
    "health": "/health",
    "regions": "/regions/crusher-1/apron",
}

TO_THE_LUMP = """
async () => {
  const clip = document.getElementById("clip");
  clip.pause();
  const told = await (await fetch(clip.src.replace("clip.mp4", "curve.json"))).json();
  const sure = told.frames.filter((frame) => frame.objects.length && frame.existence > 0.9);
  clip.currentTime = (sure[Math.floor(sure.length / 2)] ?? told.frames.at(-1)).time_s + 0.01;
}
"""
"""The clip stands where a lump is seen for sure."""


def save(page: Page, name: str) -> None:
    """As JPEG: most of a page is a picture."""
    page.screenshot(path=IMAGES / f"console_{name}.jpg", type="jpeg", quality=70)


def commission(page: Page, folder: Path) -> None:
    """Clips, labels, training and a backtest, as a newcomer sees them."""
    feed = FeedSpec(seed=3, fps=10, lump_spacing_s=2.5, lumps_per_minute=20)
    with watched(folder, feed, 20.0) as (_, url, labels):
        page.goto(f"{url}/clips", wait_until="commit")
        page.wait_for_selector("#main[data-ready]")
        page.set_input_files("#upload [name=file]", labels.parent / "video.mp4")
        page.click("#upload button.primary")
        page.wait_for_selector("#clips a.button", timeout=60_000)
        page.click("#clips a.button")
        page.wait_for_selector("#stage[data-ready]")
        page.set_input_files("#take", labels)
        page.wait_for_selector("#lumps tr[data-kind=tracks]")
        page.click("#suggest")
        page.wait_for_selector("#accept:not([disabled])", timeout=300_000)
        page.wait_for_timeout(1500)
        page.evaluate("scrollTo(0, 0)")
        save(page, "label")
        while page.is_enabled("#refuse"):
            page.keyboard.press("x")
        page.wait_for_selector("#saved:text-is('saved')")
        page.goto(f"{url}/clips", wait_until="commit")
        page.wait_for_selector("#main[data-ready]")
        save(page, "clips")
        page.goto(f"{url}/training/cam/apron", wait_until="commit")
        page.wait_for_selector("#main[data-ready]")
        page.select_option("[name=folds]", "0")
        page.click("#train button.primary")
        page.wait_for_selector("#priors tr[data-state='in shadow']", timeout=600_000)
        page.click("[data-work=backtest]")
        page.click("[data-work=replay]")
        page.wait_for_selector("#trial pre:has-text('version 1')", timeout=120_000)
        page.wait_for_selector("#jobs progress[value]", timeout=120_000)
        page.evaluate("scrollTo(0, 0)")
        save(page, "training")
        page.locator("#jobs tr[data-state=done]", has_text="backtest").wait_for(timeout=300_000)
        page.locator("#jobs tr[data-state=done] a", has_text="backtest").click()
        page.wait_for_selector("#backtest:not([hidden])")
        page.locator("#backtest").scroll_into_view_if_needed()
        save(page, "backtest")


def demonstrate(page: Page, folder: Path) -> None:
    """What operators see, of the demo and of a newcomer's work."""
    said = folder / "demo.log"
    with said.open("wb") as out:
        demo = subprocess.Popen([*LUMPWATCH, "demo"], stdout=out, stderr=out)
    try:
        eventually(lambda: re.search(r"console  (http\S+)", said.read_text()), 300.0)
        url = re.findall(r"console  (http\S+)", said.read_text())[0]
        page.goto(url, wait_until="commit")
        page.wait_for_selector(".tile[data-status=LUMP]", timeout=120_000)
        save(page, "overview")
        for name, path in PAGES.items():
            page.goto(url + path, wait_until="commit")
            page.wait_for_timeout(2500)
            save(page, name)
        page.goto(f"{url}/alarms", wait_until="commit")
        page.click("#records a")
        page.wait_for_selector("#clip[data-ready]", timeout=60_000)
        page.evaluate(TO_THE_LUMP)
        page.wait_for_timeout(1500)
        save(page, "evidence")
    finally:
        demo.send_signal(signal.SIGINT)
        demo.wait(timeout=60)


PARTS = {"demo": demonstrate, "commission": commission}


def main() -> None:
    """Make them all, or those of the parts that are named."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("Debian package chromium is not installed")
    for part in sys.argv[1:] or PARTS:
        with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            PARTS[part](page, Path(folder))
            browser.close()


if __name__ == "__main__":
    main()
