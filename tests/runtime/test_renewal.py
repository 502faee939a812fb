"""Certificates renewed while the daemon runs: taken when complete and fit, by a real hub and real clients."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from lumpwatch.service.bus import open_client, open_hub, reachable, with_ports
from lumpwatch.service.config import BusConfig, TlsConfig
from lumpwatch.service.runtime.renewal import EVERY_S, CertificateWatch
from tests.integration.site import wait_for

SCRIPT = Path(__file__).parents[2] / "deploy/security/certificates.sh"
FILES = ("ca.pem", "lumpwatch.pem", "lumpwatch.key")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two authorities with a certificate each, in `old` and `new`."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    folder = tmp_path_factory.mktemp("certificates")
    for name in ("old", "new"):
        subprocess.run(
            [SCRIPT, folder / name, "lumpwatch", "localhost", "127.0.0.1"], check=True, capture_output=True
        )
    return folder


@pytest.fixture
def tls(made: Path, tmp_path: Path) -> TlsConfig:
    """Those in use."""
    put(made / "old", tmp_path)
    ca, certificate, key = (tmp_path / name for name in FILES)
    return TlsConfig(ca=ca, certificate=certificate, key=key)


def put(source: Path, target: Path, *names: str) -> None:
    for name in names or FILES:
        shutil.copyfile(source / name, target / name)


class Watched:
    """A watch whose time passes by looks."""

    def __init__(self, tls: TlsConfig | None) -> None:
        self.now = 0.0
        self.watch = CertificateWatch(tls, lambda: self.now)

    def looks(self, times: int) -> int:
        """How often it was renewed in so many looks."""
        found = 0
        for _ in range(times):
            self.now += EVERY_S
            found += self.watch.renewed()
        return found


def test_a_renewed_pair_is_taken_once_it_is_complete(made: Path, tls: TlsConfig, tmp_path: Path) -> None:
    watched = Watched(tls)
    assert watched.looks(3) == 0
    put(made / "new", tmp_path)
    assert not watched.watch.renewed()  # not looked at yet
    assert [watched.looks(1) for _ in range(4)] == [0, 1, 0, 0]
    put(made / "old", tmp_path)
    assert watched.looks(3) == 1


def test_what_does_not_fit_is_said_and_not_taken(
    made: Path, tls: TlsConfig, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    watched = Watched(tls)
    put(made / "new", tmp_path, "lumpwatch.pem")
    assert watched.looks(4) == 0
    assert caplog.text.count("lumpwatch.key is not the key of") == 1
    tls.certificate.write_text("nonsense")
    assert watched.looks(3) == 0
    assert "a file cannot be read" in caplog.text
    tls.certificate.unlink()
    assert watched.looks(3) == 0
    put(made / "new", tmp_path)
    assert watched.looks(3) == 1


def test_a_bus_without_certificates_is_left_alone() -> None:
    assert Watched(None).looks(3) == 0


@pytest.fixture
def config(tls: TlsConfig) -> BusConfig:
    return BusConfig(mode="router", listen=with_ports(("tls/127.0.0.1:0",)), tls=tls)


def test_who_had_joined_joins_a_hub_of_another_authority(
    made: Path, config: BusConfig, tmp_path: Path
) -> None:
    """What the daemon relies on: clients read their files anew whenever they connect."""
    outside = config.model_copy(update={"mode": "client", "connect": reachable(config.listen), "listen": ()})
    heard: list[bytes] = []
    hub = open_hub(config)
    with open_client(outside) as reader, open_client(outside) as writer:
        reader.subscribe("a/b", lambda _, payload: heard.append(payload))
        publisher = writer.publisher("a/b")

        def sent() -> bool:
            publisher.put(b"now")
            return bool(heard)

        wait_for("heard before", sent, 30)
        put(made / "new", tmp_path)
        hub.close()
        heard.clear()
        hub = open_hub(config)
        wait_for("heard after", sent, 20)
        hub.close()
