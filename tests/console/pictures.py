"""Makes the pictures of docs/console.md: `make pictures`, with Debian's chromium, of the demo."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from tests.bus.test_bus_support import eventually
from tests.integration.site import LUMPWATCH

IMAGES = Path(__file__).parents[2] / "docs" / "images"
PAGES = {
    "live": "/cameras/crusher-1",
    "alarms": "/alarms",
    "events": "/events",
    "shift": "/shift",
    "health": "/health",
    "regions": "/regions/crusher-1/apron",
}


def save(page: Page, name: str) -> None:
    """As JPEG: most of a page is a picture."""
    page.screenshot(path=IMAGES / f"console_{name}.jpg", type="jpeg", quality=70)


def main() -> None:
    """Make them all."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("Debian package chromium is not installed")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        said = Path(folder) / "demo.log"
        with said.open("wb") as out:
            demo = subprocess.Popen([*LUMPWATCH, "demo"], stdout=out, stderr=out)
        try:
            eventually(lambda: re.search(r"console  (http\S+)", said.read_text()))
            url = re.findall(r"console  (http\S+)", said.read_text())[0]
            page = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"]).new_page(
                viewport={"width": 1280, "height": 800}
            )
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
            page.wait_for_timeout(4000)
            save(page, "evidence")
        finally:
            demo.send_signal(signal.SIGINT)
            demo.wait(timeout=60)


if __name__ == "__main__":
    main()
