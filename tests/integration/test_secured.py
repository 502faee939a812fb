"""A daemon behind TLS: who may do what with the commands that people use."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.config.bus import TlsConfig
from tests.bus.test_bus_access import make
from tests.integration.site import LUMPWATCH, Daemon, wait_for

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl is not installed"),
]

CAMERA = """\
  - id: crusher-1
    source: {url: "sim:feed?lumps_per_minute=30&width=320&height=240"}
    rois:
      - id: apron
        polygon: [[0.1, 0.05], [0.9, 0.05], [0.9, 0.98], [0.1, 0.98]]
        detector: {working_size_px: 160}
        alarm: {re_alarm_s: 5}
"""
BUS = (
    'listen: ["tls/127.0.0.1:{port}"], access: {operators: [anna]}, '
    "tls: {ca: certs/ca.pem, certificate: '${CERTIFICATE}', key: '${KEY}'}"
)


def as_(name: str, folder: Path) -> dict[str, str]:
    return {
        **os.environ,
        "CERTIFICATE": str(folder / f"certs/{name}.pem"),
        "KEY": str(folder / f"certs/{name}.key"),
    }


def run(name: str, daemon: Daemon, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*LUMPWATCH, arguments[0], str(daemon.config), *arguments[1:]],
        capture_output=True,
        text=True,
        timeout=60,
        env=as_(name, daemon.folder),
    )


def test_a_secured_daemon_obeys_its_operators_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    certificates = tmp_path / "certs"
    make(certificates, "lumpwatch", "localhost")
    make(certificates, "anna")
    make(certificates, "guest")
    for name, value in as_("lumpwatch", tmp_path).items():
        monkeypatch.setenv(name, value)
    with Daemon(tmp_path, CAMERA, BUS) as daemon:
        wait_for("ready", lambda: daemon.ready, 60)
        seen = run("guest", daemon, "alarms", "--count", "1", "--json")
        assert seen.returncode == 0, seen.stderr
        assert '"change":"raised"' in seen.stdout.replace(" ", "")

        # The alarm that waits: not for the guest to acknowledge, nor to forge another.
        target = ("--camera", "crusher-1", "--roi", "apron")
        alarm = Keys("test").alarm("crusher-1", "apron")
        acknowledged = ("lumpwatch_alarm_changes_total", {"class": "lump", "change": "acknowledged"})
        denied = run("guest", daemon, "ack", *target, "--actor", "guest")
        assert denied.returncode == 1
        assert "allowed" in denied.stderr
        bus = load_config(daemon.config).bus
        tls = TlsConfig(
            ca=certificates / "ca.pem", certificate=certificates / "guest.pem", key=certificates / "guest.key"
        )
        heard: list[bytes] = []
        with open_client(as_client(bus)) as reader:
            reader.subscribe_alarms(alarm, lambda _, payload: heard.append(payload))
            wait_for("the alarms so far", lambda: heard, 20)
            with open_client(as_client(bus.model_copy(update={"tls": tls}))) as forger:
                for _ in range(5):
                    forger.alarm_publisher(alarm).put(b"forged")
            before = len(heard)
            wait_for("a real one after it", lambda: len(heard) > before, 60)
        assert b"forged" not in heard
        assert daemon.metric(acknowledged[0], **acknowledged[1]) == 0
        obeyed = run("anna", daemon, "ack", *target, "--actor", "anna")
        assert obeyed.returncode == 0, obeyed.stderr
        wait_for("acknowledged", lambda: daemon.metric(acknowledged[0], **acknowledged[1]) >= 1, 20)

        shelve = ("shelve", *target, "--for", "60s", "--reason", "test")
        refused = run("guest", daemon, *shelve, "--actor", "guest")
        assert refused.returncode == 1
        assert "allowed" in refused.stderr
        assert daemon.metric("lumpwatch_alarm_shelved") == 0

        shelved = run("anna", daemon, *shelve, "--actor", "anna")
        assert shelved.returncode == 0, shelved.stderr
        wait_for("shelved", lambda: daemon.metric("lumpwatch_alarm_shelved") == 1, 20)
