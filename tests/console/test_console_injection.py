"""Markup in every text field, on every page where it comes out again."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import pytest

from lumpwatch.service.console.work import Deeds, Library
from lumpwatch.service.console.work.jobs import Job
from tests.console.chromium import needs_chromium
from tests.console.plant import Client, Console, Plant

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = needs_chromium

ATTACKS = (
    "<img src=x onerror=\"document.title='taken'\">",
    "<script>document.title='taken'</script>",
    '"><svg onload="document.title=\'taken\'">',
    "' autofocus onfocus='document.title=\"taken\"",
    "javascript:document.title='taken'",
    "{{ 7 * 7 }}",
)
ATTACK = " ".join(ATTACKS)
EVIDENCE = "000000000000001-000001"
FIELDS = "main input:not([type=file], [type=number], [type=range], [type=checkbox]), main textarea"


@pytest.fixture(scope="module")
def console(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    folder = tmp_path_factory.mktemp("console")
    work = folder / "var" / "console"
    job = Job(
        id="20260101T000000000000-0000", kind="train", order={"camera": "cam", "roi": "apron"}, about=ATTACK,
        by=ATTACK, asked=datetime(2026, 1, 1, tzinfo=UTC), state="failed", said=ATTACK,
    )  # fmt: skip
    (work / "jobs" / job.id).mkdir(parents=True)
    (work / "jobs" / job.id / "job.json").write_text(job.model_dump_json())
    (work / "jobs" / job.id / "log.txt").write_text(ATTACK)
    (work / "jobs" / job.id / "report.html").write_text(f"<p>{ATTACK}</p>")
    Deeds(work / "deeds.jsonl").note(ATTACK, ATTACK, "cam", "apron")
    with Console(plant, folder, '{listen: "127.0.0.1:0", anonymous: engineer}') as console:
        yield console


@pytest.fixture(scope="module")
def page(browser: Browser, console: Console, plant: Plant) -> Iterator[Page]:
    page = browser.new_page()
    plant.record("lump", "acknowledged", actor=ATTACK[:120], reason=ATTACK[:400])
    plant.record("blind", "shelved", actor=ATTACK[:120], reason=ATTACK[:400])
    yield page
    page.close()


def harmless(page: Page) -> None:
    # Handlers and scripts that would run do so while the page loads, or right after their nodes are there.
    page.wait_for_load_state("load")
    page.wait_for_timeout(60)
    assert page.title() != "taken"
    found = page.evaluate(
        "[...document.querySelectorAll('*')].flatMap(n => [...n.attributes]"
        ".filter(a => a.name.startsWith('on') || /^javascript:/.test(a.value) && a.name !== 'value')"
        ".map(a => n.outerHTML))"
    )
    assert found == []
    assert not page.query_selector_all("main script, main img[src=x], main svg[onload]")


@pytest.mark.parametrize(
    ("path", "shown"),
    [
        ("alarms", "#records"),
        ("training/cam/apron", "#jobs"),
        ("training/cam/apron", "#deeds"),
        ("jobs/20260101T000000000000-0000", "#log"),
        ("jobs/20260101T000000000000-0000", "#why"),
        ("jobs/20260101T000000000000-0000", "h1"),
    ],
)
def test_text_that_others_wrote_is_shown_as_it_is(
    page: Page, console: Console, path: str, shown: str
) -> None:
    page.goto(f"{console.url}/{path}", wait_until="commit")
    page.wait_for_function(
        "([where, text]) => document.querySelector(where)?.textContent.includes(text)",
        arg=[shown, ATTACKS[0]],
    )
    harmless(page)


@pytest.mark.parametrize(
    "path",
    [
        "events?since={}", "events?actor={}", "events?camera={}", "events?class={}", "shift?when={}", "trends?hours={}",
        "cameras/{}", "regions/cam/{}", "clips/{}", "jobs/{}", "training/{}/apron", "evidence/cam/apron/{}",
        "evidence/cam/{}/1", "{}",
    ],
)  # fmt: skip
def test_addresses_are_text(page: Page, console: Console, path: str) -> None:
    for attack in ATTACKS[:4]:
        page.goto(f"{console.url}/{path.format(quote(attack, safe=''))}", wait_until="commit")
        harmless(page)


def test_every_field_of_every_page_takes_markup_as_text(page: Page, console: Console, plant: Plant) -> None:
    plant.raise_alarm()
    filled = 0
    for path in (
        "events",
        "shift",
        "trends",
        "alarms",
        "regions/cam/apron",
        "clips",
        f"evidence/cam/apron/{EVIDENCE}",
    ):
        page.goto(f"{console.url}/{path}", wait_until="load")
        fields = page.locator(FIELDS)
        for i in range(fields.count()):
            page.goto(f"{console.url}/{path}", wait_until="load")
            field = page.locator(FIELDS).nth(i)
            field.fill(ATTACK[: int(field.get_attribute("maxlength") or 500)])
            field.press("Enter")
            harmless(page)
            filled += 1
    assert filled == 4  # since, by, when, note
    page.goto(f"{console.url}/alarms", wait_until="load")
    page.wait_for_selector("#alarms tbody tr")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("s")
    page.fill("#shelve input[name=reason]", ATTACK[:400])
    page.keyboard.press("Enter")
    wait = "text => document.querySelector('#held').textContent.includes(text)"
    page.wait_for_function(wait, arg=ATTACKS[0])
    harmless(page)


def test_a_report_with_markup_in_it_runs_nothing_and_is_no_part_of_the_site(
    page: Page, console: Console
) -> None:
    address = f"{console.url}/api/v1/jobs/20260101T000000000000-0000/files/report.html"
    status, headers, _ = Client(console.url).ask("GET", address.partition(console.url)[2])
    assert status == 200
    assert "sandbox" in headers["content-security-policy"]
    assert "script-src" not in headers["content-security-policy"]
    page.goto(address, wait_until="commit")
    page.wait_for_timeout(300)
    assert page.title() != "taken"


def test_answers_of_the_api_are_never_taken_for_pages(console: Console) -> None:
    client = Client(console.url)
    client.ask("GET", "/")
    for path in (
        "/api/v1/jobs",
        "/api/v1/alarms",
        f"/api/v1/trends?hours={quote(ATTACK)}",
        f"/api/v1/jobs/{quote(ATTACK, safe='')}",
    ):
        _, headers, _ = client.ask("GET", f"/api/v1/{path}")
        assert headers["content-type"].startswith(("application/json", "text/plain"))
        assert headers["x-content-type-options"] == "nosniff"
    status, told = client.post("/api/v1/jobs", {"kind": ATTACK})
    assert (status, told["error"].startswith("kind: ")) == (422, True)


def test_the_library_shows_nothing_of_other_folders(console: Console) -> None:
    client = Client(console.url)
    for path in ("..", "..%2f..", "%2e%2e", ".arriving-0"):
        for rest in ("", "/frames/1.jpg", "/labels.txt"):
            assert client.ask("GET", f"/api/v1/clips/{path}{rest}")[0] in (404, 422)
    assert client.ask("GET", "/api/v1/jobs/20260101T000000000000-0000/files/job.json")[0] == 404
    assert Library(Path(console.config.parent) / "var" / "console" / "clips", 1).clips() == []
