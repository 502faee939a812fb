"""A daemon behind TLS: who may do what with the commands that people use."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.integration.site import LUMPWATCH, Daemon, wait_for
from tests.test_bus_access import make

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

        target = ("--camera", "crusher-1", "--roi", "apron")
        shelve = ("shelve", *target, "--for", "60", "--reason", "test")
        refused = run("guest", daemon, *shelve, "--actor", "guest")
        assert refused.returncode == 1
        assert "allowed" in refused.stderr
        assert daemon.metric("lumpwatch_alarm_shelved") == 0

        shelved = run("anna", daemon, *shelve, "--actor", "anna")
        assert shelved.returncode == 0, shelved.stderr
        wait_for("shelved", lambda: daemon.metric("lumpwatch_alarm_shelved") == 1, 20)
