"""The image on a real engine: `lumpwatch deploy` against Podman's Docker-compatible socket."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import docker
import docker.errors
import pytest

from service.bus.keys import Keys
from service.bus.session import open_client
from service.cli.alarms import as_client
from service.config import load
from service.deployment.engine import DockerEngine, connect
from service.errors import LumpwatchError
from tests.integration.site import LUMPWATCH, AlarmFollower, free_port, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.system, pytest.mark.timeout(1500)]

ROOT = Path(__file__).parents[2]
IMAGE = os.environ.get("LUMPWATCH_TEST_IMAGE", "localhost/lumpwatch:latest")
BASE = "localhost/python:3.11-slim-bookworm"
READY_S = 240  # kernels are compiled at the first start, and the machine may be slow


@pytest.fixture(scope="module")
def socket(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    if shutil.which("podman") is None or os.geteuid() != 0:
        pytest.skip("needs podman, as root")
    place = tmp_path_factory.mktemp("engine") / "podman.sock"
    service = subprocess.Popen(
        ["podman", "system", "service", "--time=0", f"unix://{place}"], stderr=subprocess.DEVNULL
    )
    try:
        wait_for("engine", place.exists, 30)
        yield str(place)
    finally:
        service.terminate()
        service.wait(timeout=20)


@pytest.fixture(scope="module")
def engine(socket: str) -> DockerEngine:
    """With the image: built from the local base where it is missing."""
    engine = connect(socket)
    try:
        engine.image(IMAGE)
    except LumpwatchError:
        try:
            engine.image(BASE)
            engine.build(ROOT, IMAGE, {"BASE": BASE})
        except LumpwatchError as error:
            pytest.skip(f"no image: {error}")
    return engine


class Site:
    """A site's configuration, and `lumpwatch deploy` on it."""

    def __init__(self, folder: Path, socket: str) -> None:
        self.name = f"test-{os.getpid()}"
        self.config = folder / "site.yaml"
        self._socket = socket
        self._ports = free_port(), free_port()
        self.write()

    def write(self, url: str = "sim:feed?lumps_per_minute=12", raise_above: float = 0.9) -> None:
        roi = {"id": "apron", "polygon": [[0.15, 0.1], [0.85, 0.1], [0.85, 0.98], [0.15, 0.98]]}
        tree = {
            "site": self.name,
            "telemetry": {"listen": f"127.0.0.1:{self._ports[0]}"},
            "bus": {"listen": [f"tcp/127.0.0.1:{self._ports[1]}"]},
            "cameras": [
                {
                    "id": "crusher-1",
                    "source": {"url": url},
                    "rois": [roi | {"alarm": {"raise_above": raise_above, "latch": False}}],
                }
            ],
        }
        self.config.write_text(json.dumps(tree))

    def deploy(self, action: str, *more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*LUMPWATCH, "deploy", action, str(self.config), "--socket", self._socket, *more],
            capture_output=True,
            text=True,
            timeout=900,
        )

    def up(self, *more: str) -> subprocess.CompletedProcess[str]:
        return self.deploy("up", "--image", IMAGE, "--timeout", str(READY_S), *more)


@pytest.fixture
def site(tmp_path: Path, socket: str, engine: DockerEngine) -> Iterator[Site]:
    site = Site(tmp_path, socket)
    yield site
    client = docker.DockerClient(base_url=f"unix://{socket}", timeout=60)
    for container in client.containers.list(all=True):
        if container.name.startswith(f"lumpwatch-{site.name}"):
            container.remove(v=True, force=True)
    for volume in client.volumes.list():
        if volume.name.startswith(f"lumpwatch-{site.name}"):
            volume.remove()


class Beats:
    """When the heartbeats of the site came, as an outside subscriber hears them."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def __call__(self, key: str, payload: bytes) -> None:
        self.times.append(time.monotonic())

    def widest_s(self) -> float:
        return max(b - a for a, b in zip(self.times, self.times[1:], strict=False))


def test_the_life_of_a_container(tmp_path: Path, site: Site, engine: DockerEngine) -> None:
    first = site.up()
    assert first.returncode == 0, first.stdout + first.stderr
    again = site.up()
    assert again.returncode == 0, again.stderr
    assert "nothing to do" in again.stdout
    found = engine.found(f"lumpwatch-{site.name}")
    assert found is not None

    client = docker.DockerClient(base_url=f"unix://{site._socket}", timeout=60)
    attrs = client.containers.get(found.name).attrs
    assert attrs["HostConfig"]["ReadonlyRootfs"] is True
    assert attrs["HostConfig"]["ShmSize"] == 64 << 20
    assert attrs["Config"]["User"] == "10001:10001"
    status = Path(f"/proc/{attrs['State']['Pid']}/status").read_text()
    assert "CapEff:\t0000000000000000" in status
    assert "NoNewPrivs:\t1" in status

    # Alarms are read from outside; the daemon is killed, and the engine starts it again.
    with AlarmFollower(site.config, tmp_path / "alarms.log") as follower:
        wait_for("alarm from the container", follower.records, 120)
    os.kill(attrs["State"]["Pid"], signal.SIGKILL)
    wait_for("the engine restarts it", lambda: engine.health(found.name) == [], READY_S)

    beats = Beats()
    config = load(site.config)
    with open_client(as_client(config.bus)) as bus:
        bus.subscribe(Keys(config.site).heartbeats(), beats)
        wait_for("heartbeat", lambda: beats.times, 60)

        # A camera that is not there: valid, never ready, and back by itself.
        site.write(url="rtsp://127.0.0.1:9/nothing")
        bad = site.deploy("up", "--image", IMAGE, "--timeout", "40")
        assert bad.returncode == 1
        assert "went back to the container before, which is ready again" in bad.stderr
        now = engine.found(found.name)
        assert now is not None
        assert (now.digest, now.running) == (found.digest, True)
        heard = len(beats.times)
        wait_for("heartbeats again", lambda: len(beats.times) > heard + 3, 60)
        print(f"widest gap in the heartbeat: {beats.widest_s():.1f} s; {bad.stderr.strip()}")
        assert beats.widest_s() < 30.0  # what docs/deployment.md states

    # An upgrade, and back.
    site.write(raise_above=0.8)
    upgraded = site.up()
    assert upgraded.returncode == 0, upgraded.stdout + upgraded.stderr
    now = engine.found(found.name)
    assert now is not None
    assert now.digest != found.digest
    back = site.deploy("rollback", "--timeout", str(READY_S))
    assert back.returncode == 0, back.stderr
    print(upgraded.stdout, back.stdout)
    now = engine.found(found.name)
    assert now is not None
    assert now.digest == found.digest
    told = site.deploy("status")
    assert told.returncode == 0, told.stdout
    assert f"lumpwatch-{site.name}-previous"[:20] in told.stdout
    assert "alarm" in site.deploy("logs", "--tail", "200").stdout


def test_a_refused_configuration_and_a_missing_image(site: Site, engine: DockerEngine) -> None:
    missing = site.deploy("plan", "--image", "localhost/no-such-image:1")
    assert missing.returncode == 1
    assert "localhost/no-such-image:1: the engine does not have it and cannot pull it" in missing.stderr
    assert len(missing.stderr.splitlines()) == 1
    site.config.write_text(site.config.read_text().replace('"latch"', '"lach"'))
    refused = site.up()
    assert refused.returncode == 2
    assert "lach: unknown key" in refused.stderr
    assert engine.found(f"lumpwatch-{site.name}") is None
