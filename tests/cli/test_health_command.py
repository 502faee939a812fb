"""`lumpwatch health` against a real telemetry server, and the check of shared memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import SHARED_MEMORY_MIB
from lumpwatch.service.cli import main
from lumpwatch.service.cli.health import telemetry_address
from lumpwatch.service.config import load_config
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.runtime.preflight import check_shared_memory
from lumpwatch.service.telemetry.http import TelemetryServer
from tests.integration.site import free_port
from tests.service_helpers import site, site_tree


class Judge:
    """A daemon's health, set by hand."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def live(self) -> list[str]:
        return []

    def ready(self) -> list[str]:
        return self.problems

    def started(self) -> list[str]:
        return []


@pytest.fixture
def judge() -> Judge:
    return Judge()


@pytest.fixture
def config(tmp_path: Path, judge: Judge) -> Iterator[Path]:
    port = free_port()
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(site_tree() | {"telemetry": {"listen": f"0.0.0.0:{port}"}}))
    with TelemetryServer(("127.0.0.1", port), CollectorRegistry(), judge):
        yield file


def test_ready_is_exit_code_0(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["health", str(config)]) == 0
    assert capsys.readouterr().out == "ready\n"


def test_what_is_wrong_is_printed(config: Path, judge: Judge, capsys: pytest.CaptureFixture[str]) -> None:
    judge.problems = ["cam/apron: last decided 7.0 s ago", "cam/lip: has not decided yet"]
    assert main(["health", str(config)]) == 1
    assert capsys.readouterr().out.splitlines() == judge.problems
    assert main(["health", str(config), "--of", "live"]) == 0


def test_health_for_a_program(config: Path, judge: Judge, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["health", str(config), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"of": "ready", "good": True, "problems": []}
    judge.problems = ["cam/lip: has not decided yet"]
    assert main(["health", str(config), "--json"]) == 1
    assert json.loads(capsys.readouterr().out) == {"of": "ready", "good": False, "problems": judge.problems}


def test_nobody_there_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "site.yaml"
    file.write_text(json.dumps(site_tree() | {"telemetry": {"listen": f"127.0.0.1:{free_port()}"}}))
    assert main(["health", str(file)]) == 1
    assert "no answer" in capsys.readouterr().err


def test_another_server_is_not_taken_for_the_daemon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Other(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"hello")

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Other)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        file = tmp_path / "site.yaml"
        file.write_text(
            json.dumps(site_tree() | {"telemetry": {"listen": f"127.0.0.1:{server.server_port}"}})
        )
        assert main(["health", str(file)]) == 1
        assert "not the answer" in capsys.readouterr().err
    finally:
        server.shutdown()
        server.server_close()


def test_shared_memory_of_somebody_else_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By what the kernel answers; to root, who runs the tests in CI, everything is open."""
    config = site(site_tree())
    monkeypatch.setattr(os, "access", lambda place, mode: place != tmp_path)
    with pytest.raises(ConfigError, match=f"{tmp_path} .*user {os.getuid()}"):
        check_shared_memory(config, tmp_path)
    without = config.model_copy(update={"bus": config.bus.model_copy(update={"shared_memory": False})})
    check_shared_memory(without, tmp_path)


def test_too_little_shared_memory_is_said_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def has(mib: int) -> None:
        found = os.statvfs("/")
        sized = os.statvfs_result((found[0], 4096, mib * 256, *found[3:]))
        monkeypatch.setattr(os, "statvfs", lambda _: sized)

    config = site(site_tree())
    has(SHARED_MEMORY_MIB)
    check_shared_memory(config, tmp_path)
    has(SHARED_MEMORY_MIB - 1)
    with pytest.raises(ConfigError, match=f"--shm-size={SHARED_MEMORY_MIB}m"):
        check_shared_memory(config, tmp_path)
    without = config.model_copy(update={"bus": config.bus.model_copy(update={"shared_memory": False})})
    check_shared_memory(without, tmp_path)
    check_shared_memory(config, tmp_path / "missing")


def test_it_takes_no_more_than_it_needs(config: Path) -> None:
    """It runs every few seconds beside the filter."""
    script = (
        "import sys; from lumpwatch.service.cli import main; code = main(['health', sys.argv[1]]); "
        "print({'numpy', 'cv2', 'pydantic', 'rich'} & sys.modules.keys()); sys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(config)], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "ready\nset()\n"


@pytest.mark.parametrize(
    ("telemetry", "address"),
    [
        (None, ("127.0.0.1", 9464)),
        ({}, ("127.0.0.1", 9464)),
        ({"listen": "0.0.0.0:1234"}, ("0.0.0.0", 1234)),
        ({"listen": "[::1]:1234"}, ("::1", 1234)),
        ({"listen": "${WHERE}:1234"}, ("10.0.0.7", 1234)),
    ],
)
def test_the_address_is_that_of_the_configuration(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    telemetry: dict[str, str] | None,
    address: tuple[str, int],
) -> None:
    monkeypatch.setenv("WHERE", "10.0.0.7")
    file = tmp_path / "site.yaml"
    tree = site_tree() | ({} if telemetry is None else {"telemetry": telemetry})
    file.write_text(json.dumps(tree))
    assert telemetry_address(file) == address
    assert load_config(file).telemetry.address == address


def test_a_file_that_says_nothing_sensible_is_named(tmp_path: Path) -> None:
    for text in ("- 1\n", "telemetry: {listen: here}\n", "{"):
        file = tmp_path / "site.yaml"
        file.write_text(text)
        with pytest.raises(ConfigError, match=r"site\.yaml"):
            telemetry_address(file)
    with pytest.raises(ConfigError, match=r"none\.yaml"):
        telemetry_address(tmp_path / "none.yaml")
