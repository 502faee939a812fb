"""HTTPS, and a reverse proxy that says who the user is."""

from __future__ import annotations

import http.client
import json
import ssl
import subprocess
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from lumpwatch.service.config import UserRole
from lumpwatch.service.console import UserFile
from tests.bus.test_bus_support import eventually
from tests.console.chromium import needs_chromium
from tests.console.plant import Client, Console, Plant
from tests.console.reverse_proxy import FROM, ReverseProxy

if TYPE_CHECKING:
    from playwright.sync_api import Browser

PASSWORD = "correct horse"
ACK = "/api/v1/cameras/cam/rois/apron/commands/ack"


@pytest.fixture(scope="module")
def secure(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    folder = tmp_path_factory.mktemp("https")
    subject = ("-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-days", "2")
    key = (
        "-newkey",
        "ec",
        "-pkeyopt",
        "ec_paramgen_curve:prime256v1",
        "-nodes",
        "-keyout",
        str(folder / "c.key"),
    )
    subprocess.run(
        ["openssl", "req", "-x509", *key, "-out", str(folder / "c.pem"), *subject],
        check=True,
        capture_output=True,
    )
    UserFile(folder / "users.json").put("otto", PASSWORD, UserRole.OPERATOR)
    tls = '{listen: "127.0.0.1:0", users: users.json, tls: {certificate: c.pem, key: c.key}}'
    with Console(plant, folder, tls) as console:
        yield console


def test_by_https_the_cookie_never_travels_in_the_open(secure: Console) -> None:
    assert secure.url.startswith("https://")
    host = secure.url.partition("://")[2]
    trusted = ssl.create_default_context(cafile=str(secure.config.parent / "c.pem"))
    connection = http.client.HTTPSConnection(host, timeout=20, context=trusted)
    connection.request("GET", "/login")
    answer = connection.getresponse()
    answer.read()
    connection.close()
    cookie = answer.headers["Set-Cookie"]
    assert cookie.startswith("__Host-lumpwatch=")
    assert {"Secure", "HttpOnly", "SameSite=Strict", "Path=/"} <= {part.strip() for part in cookie.split(";")}
    assert answer.headers["Strict-Transport-Security"].startswith("max-age=")
    with pytest.raises((http.client.HTTPException, ConnectionError)):
        Client(f"http://{host}").ask("GET", "/login")


@needs_chromium
def test_an_operator_logs_in_by_https_and_acknowledges(
    browser: Browser, secure: Console, plant: Plant
) -> None:
    plant.deeds.clear()
    plant.state = "LUMP"
    page = browser.new_context(ignore_https_errors=True).new_page()
    page.goto(secure.url, wait_until="commit")
    page.fill("[name=name]", "otto")
    page.fill("[name=password]", "wrong")
    page.click("button.primary")
    page.wait_for_selector("[role=alert]")
    page.fill("[name=name]", "otto")
    page.fill("[name=password]", PASSWORD)
    page.click("button.primary")
    page.wait_for_selector(".tile[data-status=LUMP]")
    plant.raise_alarm()
    page.wait_for_selector("#strip:not([hidden])")
    page.keyboard.press("a")
    eventually(lambda: list(plant.deeds), 30.0)
    assert plant.deeds[0] == ("ack", {"class": "lump", "actor": "otto"})
    users = UserFile(secure.config.parent / "users.json")
    users.remove("otto")
    page.wait_for_selector("#link.gone:has-text('log in again')")
    page.wait_for_selector(".tile[data-status=SILENT]")
    users.put("otto", PASSWORD, UserRole.OPERATOR)
    page.wait_for_selector(".tile[data-status=LUMP]")
    page.click("#logout")
    page.wait_for_selector("form.login")
    page.context.close()


@pytest.fixture(scope="module")
def behind(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    groups = f'{{trusted: ["{FROM}"], operators: [control-room], engineers: [vision]}}'
    with Console(
        plant, tmp_path_factory.mktemp("proxy"), f'{{listen: "127.0.0.1:0", proxy: {groups}}}'
    ) as console:
        yield console


@pytest.mark.parametrize(
    ("groups", "role"),
    [
        ("", "viewer"),
        ("other, control-rooms", "viewer"),
        ("x, control-room", "operator"),
        ("control-room,vision", "engineer"),
    ],
)
def test_the_groups_of_the_proxy_become_roles(behind: Console, plant: Plant, groups: str, role: str) -> None:
    plant.deeds.clear()
    target = behind.url.partition("://")[2]
    with ReverseProxy(target, "Änne O'Neill".encode().decode("latin-1"), groups) as proxy:
        client = Client(proxy.url)
        assert client.ask("GET", "/")[0] == 200
        told = json.loads(client.ask("GET", "/api/v1/me", X_Forwarded_User="root")[2])
        assert (told["role"], told["user"] != "root") == (role, True)
        status, _ = client.post(ACK, {"class": "lump"})
        assert status == (403 if role == "viewer" else 200)
        assert client.ask("GET", "/clips")[0] == (200 if role == "engineer" else 403)
    assert len(plant.deeds) == (role != "viewer")


def test_headers_of_others_than_the_proxy_count_for_nothing(behind: Console) -> None:
    client = Client(behind.url)
    forged = {"X_Forwarded_User": "root", "X_Forwarded_Groups": "vision"}
    assert client.ask("GET", "/api/v1/state", **forged)[0] == 401
    assert client.ask("GET", "/", **forged)[1]["location"] == "/login"
    assert client.ask("GET", "/login", **forged)[0] == 404, "there are no users of its own to log in"


@needs_chromium
def test_behind_a_proxy_the_page_is_live_and_acts_by_name(
    browser: Browser, behind: Console, plant: Plant
) -> None:
    plant.deeds.clear()
    plant.state = "LUMP"
    name = '<b onclick="x">Otto</b>'
    with ReverseProxy(behind.url.partition("://")[2], name, "control-room") as proxy:
        page = browser.new_page()
        page.goto(proxy.url, wait_until="commit")
        page.wait_for_selector(".tile[data-status=LUMP]")
        assert name in page.inner_text(".who")
        assert not page.query_selector_all(".who b, #logout")
        plant.raise_alarm()
        page.wait_for_selector("#strip:not([hidden])")
        page.keyboard.press("a")
        eventually(lambda: list(plant.deeds), 30.0)
        assert plant.deeds[0] == ("ack", {"class": "lump", "actor": name})
        page.close()
