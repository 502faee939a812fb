"""Who may do what, against a real console on a real bus."""

from __future__ import annotations

import contextlib
import http.client
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from lumpwatch.service.config import UserRole
from lumpwatch.service.console import UserFile
from lumpwatch.service.storage import EventWriter, Span
from tests.bus.test_bus_support import eventually
from tests.console.plant import Client, Console, Plant
from tests.storage.test_event_log import Counting

ACK = "/api/v1/cameras/cam/rois/apron/commands/ack"
PASSWORD = "correct horse"
PARTS = {
    "camera": "cam", "roi": "apron", "name": "ack", "clip": "20260101T000000-000000", "job": "x", "id": "1",
    "file": "x", "number": "1", "version": "1",
}  # fmt: skip


@pytest.fixture(scope="module")
def console(plant: Plant, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Console]:
    folder = tmp_path_factory.mktemp("console")
    users = UserFile(folder / "users.json")
    for name, role in (("vera", UserRole.VIEWER), ("otto", UserRole.OPERATOR), ("emma", UserRole.ENGINEER)):
        users.put(name, PASSWORD, role)
    proxy = '{trusted: ["127.0.0.2"]}'
    with Console(plant, folder, f'{{listen: "127.0.0.1:0", users: users.json, proxy: {proxy}}}') as console:
        yield console


def logged_in(console: Console, name: str) -> Client:
    client = Client(console.url)
    assert client.log_in(name, PASSWORD) == 303
    return client


def test_nobody_gets_in_without_a_login(console: Console) -> None:
    client = Client(console.url)
    for path in ("/", "/alarms", "/cameras/cam"):
        status, headers, _ = client.ask("GET", path)
        assert (status, headers["location"]) == (303, "/login")
    for path in ("/api/v1/state", "/api/v1/stream", "/api/v1/cameras/cam/picture"):
        assert client.ask("GET", path)[0] == 401
    assert client.ask("GET", "/", X_Forwarded_User="emma")[0] == 303, "a header of an unknown proxy counts"


def test_pages_carry_a_policy_and_a_cookie_that_scripts_cannot_read(console: Console) -> None:
    _, headers, _ = Client(console.url).ask("GET", "/login")
    policy = headers["content-security-policy"]
    assert "script-src 'self'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert {"HttpOnly", "SameSite=Strict"} <= {part.strip() for part in headers["set-cookie"].split(";")}
    assert headers["x-content-type-options"] == "nosniff"


def test_an_operator_acknowledges_over_the_bus_by_name(console: Console, plant: Plant) -> None:
    plant.deeds.clear()
    status, reply = logged_in(console, "otto").post(ACK, {"class": "lump", "actor": "someone else"})
    assert (status, reply["alarm"]) == (200, "ACKNOWLEDGED")
    assert plant.deeds.pop() == ("ack", {"class": "lump", "actor": "otto"})


def test_a_viewer_cannot_act(console: Console, plant: Plant) -> None:
    plant.deeds.clear()
    client = logged_in(console, "vera")
    for name in ("ack", "reset", "shelve", "service", "verdict", "proof"):
        status, reply = client.post(ACK.replace("ack", name), {"class": "lump"})
        assert status == 403, name
        assert "viewer" in reply["error"]
    assert not plant.deeds


def test_only_an_engineer_changes_a_region(console: Console) -> None:
    before = console.config.read_text()
    for name in ("vera", "otto"):
        client = logged_in(console, name)
        region = "/api/v1/cameras/cam/rois/apron/region"
        base = json.loads(client.ask("GET", region)[2])["base"]
        given = {"base": base, "size": [160, 120], "polygon": [[0, 0], [1, 0], [1, 1]]}
        assert client.post(region, given)[0] == 403
        assert client.post(f"{region}/preview", given)[0] == 403
        assert client.ask("GET", "/regions/cam/apron")[0] == 403
    assert console.config.read_text() == before


def test_whatever_changes_something_is_refused_to_who_may_not(console: Console, plant: Plant) -> None:
    """Every way to change something that the API describes: none can be forgotten here."""
    plant.deeds.clear()
    document = json.loads(logged_in(console, "vera").ask("GET", "/api/v1/openapi.json")[2])
    ways = [
        (method.upper(), re.sub(r"\{(\w+)\}", lambda part: PARTS[part[1]], path))
        for path, methods in document["paths"].items()
        for method in methods
        if method != "get"
    ]
    assert len(ways) >= 14
    for name in ("vera", "otto"):
        client = logged_in(console, name)
        for method, path in ways:
            if name == "otto" and "/commands/" in path:
                continue
            status, _, text = client.ask(method, path, "{}", X_CSRF_Token=client.csrf)
            assert (status, "needs the role" in text) == (403, True), (name, method, path)
            assert client.ask(method, path, "{}")[0] == 403, "without a token"
    assert not plant.deeds
    assert not list((console.config.parent / "var" / "console").glob("*/*"))


def test_what_operators_look_at_loads_no_numerics(console: Console) -> None:
    """Numba and SciPy more than double the console's memory, and it starts twice as slowly with them."""
    now_s = time.time()
    writer = EventWriter(console.config.parent / "var", "cam", Counting(), time.time)
    assert writer.add([Span(now_s - 60.0, now_s, "apron", 60.0, {})], wait=True)
    writer.close()
    otto = logged_in(console, "otto")
    for page in ("/", "/cameras/cam", "/alarms", "/events", "/trends", "/health"):
        assert otto.ask("GET", page)[0] == 200
    assert "unknown, minutes" in otto.ask("GET", "/shift?when=current")[2]
    otto.ask("GET", "/api/v1/cameras/cam/rois/apron/evidence/000000000000001-000001")
    mapped = Path(f"/proc/{console.process.pid}/maps").read_text()
    assert "zenoh" in mapped
    assert not [name for name in ("/llvmlite/", "/numba/", "/scipy/") if name in mapped]


def test_pages_of_engineers_are_neither_shown_nor_named_to_others(console: Console) -> None:
    pages = ("/regions/cam/apron", "/clips", "/training/cam/apron")
    emma = logged_in(console, "emma")
    for name in ("vera", "otto"):
        client = logged_in(console, name)
        _, _, overview = client.ask("GET", "/")
        for page in pages:
            assert client.ask("GET", page)[0] == 403
            assert emma.ask("GET", page)[0] == 200
            assert f'href="{page}"' not in overview
    for missing in ("/clips/20260101T000000-000000", "/clips/..%2f..", "/jobs/x", "/training/cam/moon"):
        assert emma.ask("GET", missing)[0] == 404


def test_every_page_comes(console: Console) -> None:
    emma = logged_in(console, "emma")
    overview = emma.ask("GET", "/")[2]
    pages = re.findall(r'<a href="(/[^"]*)"', overview)
    assert len(pages) >= 9
    for page in pages:
        assert emma.ask("GET", page)[0] == 200, page


def test_an_upload_is_bounded_and_must_be_a_video(console: Console) -> None:
    client = logged_in(console, "emma")
    token = {"X_CSRF_Token": client.csrf}
    for name, body, expected in (
        ("x.mp4", b"no video", 422),
        ("x.html", b"<script>", 422),
        ("", b"x", 422),
    ):
        assert client.ask("POST", f"/api/v1/clips?camera=cam&name={name}", body, **token)[0] == expected
    assert client.ask("POST", "/api/v1/clips?camera=moon&name=x.mp4", b"x", **token)[0] == 404
    with contextlib.closing(http.client.HTTPConnection(client.host, timeout=20)) as connection:
        headers = {"Cookie": client.cookie, "X-CSRF-Token": client.csrf, "Content-Length": str(1 << 40)}
        connection.putrequest("POST", "/api/v1/clips?camera=cam&name=x.mp4")
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        assert connection.getresponse().status == 413, "a file that has no room is read to its end"
    assert json.loads(client.ask("GET", "/api/v1/clips")[2])["clips"] == []


def test_signals_of_the_plant_are_no_deeds_of_people(console: Console) -> None:
    client = logged_in(console, "emma")
    for name in ("suppress", "evidence", "prior", "nonsense"):
        assert client.post(ACK.replace("ack", name), {})[0] == 404


def test_forged_requests_are_refused(console: Console, plant: Plant) -> None:
    plant.deeds.clear()
    client = logged_in(console, "otto")
    body = json.dumps({"class": "lump"})
    assert client.ask("POST", ACK, body)[0] == 403, "without a token"
    assert client.ask("POST", ACK, body, X_CSRF_Token="x" * 43)[0] == 403
    other = {"Origin": "http://evil.example", "X-CSRF-Token": client.csrf}
    assert client.ask("POST", ACK, body, **other)[0] == 403
    assert client.ask("GET", "/", Host="evil.example")[0] == 421, "a name that was bound to this address"
    assert not plant.deeds


@pytest.mark.parametrize(
    ("body", "status"),
    [
        ("{", 400),
        ("[]", 400),
        ('{"class": "moon"}', 422),
        ('{"class": "lump", "x": 1}', 422),
        ("x" * 2_000_000, 400),
    ],
)
def test_bad_requests_are_named(console: Console, body: str, status: int) -> None:
    client = logged_in(console, "otto")
    found, _, text = client.ask("POST", ACK, body, X_CSRF_Token=client.csrf)
    assert (found, bool(json.loads(text)["error"])) == (status, True)


def test_logins_are_throttled_and_the_right_password_does_not_help_at_once(console: Console) -> None:
    client = Client(console.url)
    found = [client.log_in("mallory", "wrong password") for _ in range(6)]
    assert found == [401] * 5 + [429]
    assert client.log_in("mallory", PASSWORD) == 429
    eventually(lambda: Client(console.url).log_in("otto", PASSWORD) == 303, 30.0)


def test_who_is_removed_is_out_at_once(console: Console) -> None:
    users = UserFile(console.config.parent / "users.json")
    users.put("gone", PASSWORD, UserRole.OPERATOR)
    client = logged_in(console, "gone")
    assert client.ask("GET", "/api/v1/me")[0] == 200
    users.remove("gone")
    assert client.ask("GET", "/api/v1/me")[0] == 401


def test_logging_out_ends_the_session(console: Console) -> None:
    client = logged_in(console, "otto")
    kept = client.cookie
    assert client.ask("POST", "/logout", X_CSRF_Token=client.csrf)[0] == 204
    assert client.ask("GET", "/api/v1/me", Cookie=kept)[0] == 401


def test_pictures_come_with_what_was_decided_of_that_frame(console: Console) -> None:
    client = logged_in(console, "vera")
    found: list[tuple[int, dict[str, str]]] = []

    def decided() -> bool:
        status, headers, _ = client.ask("GET", "/api/v1/cameras/cam/picture")
        found.append((status, headers))
        return status == 200 and bool(json.loads(headers["x-lumpwatch-frame"])["states"])

    eventually(decided, 30.0)
    about = json.loads(found[-1][1]["x-lumpwatch-frame"])
    assert about["size"] == [160, 120]
    assert about["states"]["apron"]["state"] in ("CLEAR", "LUMP")
    assert client.ask("GET", "/api/v1/cameras/moon/picture")[0] == 404


def test_the_api_describes_itself(console: Console) -> None:
    document = json.loads(logged_in(console, "vera").ask("GET", "/api/v1/openapi.json")[2])
    assert document["openapi"].startswith("3.1")
    paths = document["paths"]
    assert set(paths["/api/v1/cameras/{camera}/rois/{roi}/region"]) == {"get", "post"}
    assert all(one["summary"] for path in paths.values() for one in path.values())
    client = logged_in(console, "vera")
    for path, methods in paths.items():
        if "get" in methods and "{" not in path and not path.endswith("stream"):
            assert client.ask("GET", path)[0] in (200, 422), path


def test_files_of_the_package_are_all_that_is_served(console: Console, tmp_path: Path) -> None:
    client = logged_in(console, "emma")
    for path in (
        "/static/../server.py",
        "/static/%2e%2e/server.py",
        "/static/..%2fserver.py",
        "/static//etc/passwd",
    ):
        assert client.ask("GET", path)[0] == 404
