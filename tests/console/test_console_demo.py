"""What a person who has read nothing does with the demo, in Debian's Chromium."""

from __future__ import annotations

import re
import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.bus.test_bus_support import eventually
from tests.console.chromium import needs_chromium
from tests.integration.site import LUMPWATCH

if TYPE_CHECKING:
    from playwright.sync_api import Browser


@pytest.mark.slow
@needs_chromium
def test_the_lump_comes_is_acknowledged_looked_at_and_another_region_is_drawn(
    browser: Browser, tmp_path: Path
) -> None:
    said = tmp_path / "demo.log"
    with said.open("wb") as out:
        demo = subprocess.Popen([*LUMPWATCH, "demo"], stdout=out, stderr=out)
    try:
        eventually(lambda: re.search(r"console  (http\S+)", said.read_text()), 90.0)
        url = re.findall(r"console  (http\S+)", said.read_text())[0]
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url, wait_until="commit")
        page.wait_for_selector(".tile[data-status=LUMP]", timeout=120_000)
        page.wait_for_timeout(
            800
        )  # the alarm of the start may have stood in its place: who sees another one looks first
        page.keyboard.press("a")
        page.wait_for_selector("#strip", state="hidden")
        page.goto(f"{url}/alarms", wait_until="commit")
        page.click("#records a")
        page.wait_for_selector("#clip[data-ready]", timeout=60_000)
        assert page.evaluate("document.getElementById('clip').duration") > 3.0
        page.keyboard.press("t")
        page.wait_for_selector("#verdict:text-is('true')")
        page.goto(f"{url}/regions/crusher-1/apron", wait_until="commit")
        page.wait_for_selector("#stage[data-ready]")
        page.focus("#stage")
        page.keyboard.press("Alt+n")
        page.keyboard.press("Shift+ArrowRight")
        page.wait_for_selector("#save:not([disabled])")
        page.click("#save")
        page.goto(url, wait_until="commit")
        page.wait_for_selector(".tile[data-status=SILENT], .tile[data-status=BLIND]", timeout=30_000)
        page.wait_for_selector(".tile[data-status=CLEAR], .tile[data-status=LUMP]", timeout=60_000)
        page.close()
    finally:
        demo.send_signal(signal.SIGINT)
        demo.wait(timeout=60)
    assert demo.returncode == 0
