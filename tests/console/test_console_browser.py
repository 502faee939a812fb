"""What a person sees and does, in Debian's Chromium."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lumpwatch.service.config import load_config
from tests.bus.test_bus_support import eventually
from tests.console.chromium import needs_chromium
from tests.console.plant import Console, Plant

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

AXE = Path(__file__).with_name("axe.min.js")
TEXT = "<img src=x onerror=\"document.title='taken'\"><script>document.title='taken'</script>"
VALID_S = 2.0

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def console(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    with Console(
        plant, tmp_path_factory.mktemp("console"), '{listen: "127.0.0.1:0", anonymous: engineer}'
    ) as console:
        yield console


@pytest.fixture
def page(browser: Browser, console: Console, plant: Plant) -> Iterator[Page]:
    plant.state, plant.reason, plant.more = "CLEAR", None, {}
    plant.alarms.update(blocked="NORMAL", lump="NORMAL", blind="NORMAL", system="NORMAL")
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    wrong: list[str] = []
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if "Content Security" in said.text else None)
    page.goto(console.url, wait_until="commit")
    page.wait_for_selector(".tile[data-status=CLEAR]")
    yield page
    page.close()
    assert not wrong


def status(page: Page, expected: str, within_s: float = 5.0) -> None:
    page.wait_for_selector(f".tile[data-status={expected}]", timeout=1000 * within_s)


def test_an_operator_sees_a_lump_hears_it_and_acknowledges_by_keyboard(page: Page, plant: Plant) -> None:
    plant.deeds.clear()
    page.click("#sound")
    page.keyboard.press("?")
    page.wait_for_selector("#keys[open]")
    plant.state = "LUMP"
    plant.raise_alarm()
    status(page, "LUMP")
    page.wait_for_selector("#keys", state="hidden")  # or its keys would not reach the alarm
    assert "812 mm" in page.inner_text(".tile .detail")
    assert "3.1 s" in page.inner_text(".tile .detail")
    page.wait_for_selector("#sound[data-sounding=lump]")
    assert "LUMP cam / apron" in page.inner_text("#said")
    page.keyboard.press("a")
    eventually(lambda: list(plant.deeds), 30.0)
    assert plant.deeds[0] == ("ack", {"class": "lump", "actor": "console"})
    page.wait_for_selector("#strip", state="hidden")
    page.wait_for_selector("#sound[data-sounding='']")
    page.keyboard.press("l")
    page.wait_for_selector("h1:text-is('Alarms')")
    page.keyboard.press("ArrowDown")  # a browser may want a key again
    page.wait_for_selector("#sound[aria-pressed=true]:text-is('Sound on')")
    page.keyboard.press("n")
    page.wait_for_selector("#sound[aria-pressed=false]:text-is('Sound off')")
    page.reload(wait_until="commit")
    page.keyboard.press("ArrowDown")
    page.wait_for_selector("#sound[aria-pressed=false]:text-is('Sound off')")


def test_a_server_that_hangs_makes_the_page_silent_and_it_catches_up(page: Page, console: Console) -> None:
    console.freeze()
    try:
        status(page, "SILENT", VALID_S + 1.0)
        assert "no news for" in page.inner_text(".tile .detail")
        page.wait_for_selector("#link.gone")
        before = page.url
        page.keyboard.press("l")  # a browser's own error page would be silent, and stay
        page.wait_for_selector("#toast:text('this page stays')")
        page.click("nav a:text('Health')")
        assert page.url == before
    finally:
        console.resume()
    status(page, "CLEAR", 10.0)


def test_a_monitor_that_is_gone_makes_the_page_silent(page: Page, plant: Plant, browser: Browser) -> None:
    alarms = browser.new_page()
    alarms.goto(page.url + "alarms", wait_until="commit")
    alarms.wait_for_selector("#none:text('Every alarm is NORMAL')")
    page.goto(page.url + "cameras/cam", wait_until="commit")
    page.wait_for_selector("#view[data-decided=apron]")
    plant.beating.clear()
    try:
        alarms.wait_for_selector("#none:text('SILENT: what the alarms of cam / apron do is not known')")
        page.wait_for_selector(".view.silent", timeout=1000 * (VALID_S + 1.0))
        page.wait_for_selector(".region[data-status=SILENT]")
        page.wait_for_selector(".alarms-of:not(:has-text('NORMAL'))")
        assert page.inner_text(".veil").startswith("SILENT: no news for")
    finally:
        plant.beating.set()
    page.wait_for_selector(".region[data-status=CLEAR]", timeout=10_000)
    page.wait_for_selector(".view:not(.silent)")
    alarms.wait_for_selector("#none:text('Every alarm is NORMAL')")
    alarms.close()


PRESS_WHEN_IT_CHANGES = """
() => { new MutationObserver((_, watch) => {
  watch.disconnect();
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "a", bubbles: true }));
}).observe(document.querySelector("#strip .what"), { childList: true, characterData: true, subtree: true }); }
"""

ACKNOWLEDGE = "alarm => import('/static/common.js').then(({ command }) => command(alarm, 'ack'))"


def test_who_answers_one_alarm_does_not_answer_the_next_by_it(page: Page, plant: Plant) -> None:
    """Somebody else acknowledges, and another alarm takes the place while the finger is on its way."""
    plant.raise_alarm()
    page.wait_for_selector("#strip .what:text('LUMP')")
    plant.deeds.clear()
    page.evaluate(PRESS_WHEN_IT_CHANGES)
    plant.alarms["lump"] = "ACKNOWLEDGED"
    plant.state, plant.reason = "BLIND", "dusty"
    plant.raise_alarm("blind", reason="dusty")
    page.wait_for_selector("#strip .what:text('BLIND')")
    page.wait_for_selector("#toast:text('has just taken this place')")
    assert not plant.deeds
    page.wait_for_timeout(800)
    page.keyboard.press("a")
    eventually(lambda: list(plant.deeds), 30.0)
    assert plant.deeds[0] == ("ack", {"class": "blind", "actor": "console"})


def test_of_two_who_acknowledge_the_second_learns_who_was_quicker(page: Page, plant: Plant) -> None:
    """And a console that was started anew, which knows no session of before, is acted on all the same."""
    plant.raise_alarm()
    page.goto(page.url + "alarms", wait_until="commit")
    page.wait_for_selector("#alarms tbody tr.lump")
    plant.alarms["lump"] = "ACKNOWLEDGED"
    plant.record("lump", "acknowledged", actor="otto")
    page.wait_for_selector("#alarms tbody td:text('by otto')")
    page.context.clear_cookies()
    page.evaluate(ACKNOWLEDGE, {"camera": "cam", "roi": "apron", "class": "lump"})
    page.wait_for_selector("#toast:text('nothing to do: it is ACKNOWLEDGED, acknowledged by otto')")


def test_a_script_that_fails_is_covered(browser: Browser, console: Console) -> None:
    page = browser.new_page()
    page.goto(console.url, wait_until="commit")
    page.wait_for_selector(".tile[data-status=CLEAR]")
    passed = "document.getElementById('stopped').getAnimations()[0].currentTime"
    page.wait_for_function(f"() => {passed} > 500")
    page.wait_for_function(f"() => {passed} < 500")  # it is put back every second while all is well
    page.evaluate(
        "import('/static/common.js').then(({ feed }) => feed.listeners.push(() => { throw Error(); }))"
    )
    page.wait_for_function(f"() => {passed} > 2200")  # covers at 6000, by itself
    page.close()


def test_what_else_an_operator_must_know_stands_on_the_tile(page: Page, plant: Plant) -> None:
    assert page.inner_text(".tile .untaught") == "untrained: finds fewer lumps"
    plant.more = {"trained": True, "feed": {"state": "stopped", "load": 0.4, "agrees": False}}
    page.wait_for_selector(".tile .detail:text('feed stopped, load 40 %, the plant says otherwise')")
    assert page.inner_text(".tile .untaught") == ""
    plant.more = {"blockage": {"standing": 0.9, "stood_s": 12.4, "reason": "standing"}}
    plant.state = "BLOCKED"
    plant.raise_alarm("blocked", reason="standing")
    page.wait_for_selector(".tile[data-status=BLOCKED] .detail:text('material stands in the mouth for 12 s')")
    page.wait_for_selector("#strip.blocked:has-text('BLOCKED cam / apron, material stands in the mouth')")


def test_blind_says_why_and_sounds_otherwise(page: Page, plant: Plant) -> None:
    page.click("#sound")
    plant.state, plant.reason = "BLIND", "dusty"
    plant.raise_alarm("blind", reason="dusty")
    status(page, "BLIND")
    assert page.inner_text(".tile .detail") == "dust"
    page.wait_for_selector("#sound[data-sounding=blind]")


def test_shelving_asks_why_and_stays_in_sight(page: Page, plant: Plant) -> None:
    plant.deeds.clear()
    plant.raise_alarm()
    page.goto(page.url + "alarms", wait_until="commit")
    page.wait_for_selector("#alarms tbody tr.lump")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("s")
    page.fill("#shelve input[name=reason]", TEXT)
    page.keyboard.press("Enter")
    eventually(lambda: list(plant.deeds), 30.0)
    name, given = plant.deeds[0]
    assert (name, given["reason"], given["for_s"]) == ("shelve", TEXT, 900.0)
    page.wait_for_selector("#held tbody tr.lump")
    page.select_option("select[name=class]", "blind")
    assert page.is_visible("#held tbody tr.lump"), "a filter hides what is shelved"
    assert TEXT in page.inner_text("#held tbody"), "text from outside is shown as it is"
    assert "taken" not in page.title()
    assert not page.query_selector_all("#main img, #main script")


def test_an_engineer_draws_another_region_and_sees_what_it_changes(page: Page, console: Console) -> None:
    page.goto(page.url + "regions/cam/apron", wait_until="commit")
    page.wait_for_selector("#stage[data-ready]")
    box = page.locator("#stage").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 0.1 * box["height"])
    page.mouse.down()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 0.2 * box["height"])
    page.mouse.up()
    page.wait_for_selector("#save:not([disabled])")
    assert "# drawn by hand" in page.inner_text("#diff .in")
    page.click("#save")
    page.wait_for_selector("#toast:not([hidden])")
    corner = load_config(console.config).camera("cam").roi("apron").polygon[0]
    assert corner == pytest.approx((0.3, 0.2), abs=0.01)


@pytest.mark.parametrize(
    "path",
    [
        "",
        "cameras/cam",
        "alarms",
        "events",
        "shift",
        "trends",
        "health",
        "regions/cam/apron",
        "evidence/cam/apron/000000000000001-000001",
    ],
)
def test_axe_finds_no_violation(page: Page, plant: Plant, path: str) -> None:
    plant.state = "LUMP"
    plant.raise_alarm()
    page.goto(page.url + path, wait_until="commit")
    page.wait_for_selector("#strip:not([hidden])")
    assert violations(page) == []
    for width, height in ((800, 1280), (1024, 768), (1920, 1080)):
        page.set_viewport_size({"width": width, "height": height})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (width, height)


def violations(page: Page) -> list[tuple[str, Any]]:
    """What axe-core finds, contrast of 4.5 : 1 included."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run()")
    return [(one["id"], [node["html"] for node in one["nodes"]]) for one in found["violations"]]
