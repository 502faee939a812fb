"""Podman behind a socket that speaks Docker's API, the image under test, and `lumpwatch deploy` on a site."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import docker

from lumpwatch.service.deployment.engine import DockerEngine, connect
from tests.integration.site import LUMPWATCH, free_port, wait_for

ROOT = Path(__file__).parents[2]
BASE = os.environ.get("LUMPWATCH_TEST_BASE", "localhost/python:3.11-slim-bookworm")
IMAGE = "localhost/lumpwatch:test"
BARE = "localhost/lumpwatch:test-bare"
READY_S = 240.0
"""Kernels are compiled at the first start, and the machine may be slow."""
_LIMIT = 10_000
PLACE = [[0.15, 0.1], [0.85, 0.1], [0.85, 0.98], [0.15, 0.98]]


def missing() -> str | None:
    """What keeps the tests from running here."""
    if os.geteuid() != 0:
        return "needs root, for podman"
    if shutil.which("podman") is None:
        return "podman is not installed (Debian packages podman, buildah, runc, catatonit)"
    if subprocess.run(["podman", "image", "exists", BASE], capture_output=True).returncode:
        return f"{BASE}: no such image here to build from; `make container` makes one"
    return None


@contextmanager
def podman(folder: Path) -> Iterator[str]:
    """The socket of an engine that works without systemd, and where limits cannot be raised."""
    limits = []
    for name, kind in (("nofile", resource.RLIMIT_NOFILE), ("nproc", resource.RLIMIT_NPROC)):
        hard = resource.getrlimit(kind)[1]
        most = _LIMIT if hard == resource.RLIM_INFINITY else min(hard, _LIMIT)
        limits.append(f'"{name}={most}:{most}"')
    config = folder / "containers.conf"
    config.write_text(
        f"[containers]\ndefault_ulimits = [{', '.join(limits)}]\n"
        '[engine]\ncgroup_manager = "cgroupfs"\nevents_logger = "file"\n'
        # crun does not start where both versions of cgroups are mounted.
        + ('runtime = "runc"\n' if shutil.which("runc") else "")
    )
    place = folder / "podman.sock"
    service = subprocess.Popen(
        ["podman", "system", "service", "--time=0", f"unix://{place}"],
        stderr=subprocess.DEVNULL,
        env=os.environ | {"CONTAINERS_CONF": str(config)},
    )
    try:
        wait_for("engine", place.exists, 30)
        yield str(place)
    finally:
        service.terminate()
        service.wait(timeout=20)


def build(socket: str) -> DockerEngine:
    """The engine, with the image of this source; what has not changed comes from its cache."""
    engine = connect(socket)
    engine.build(ROOT, IMAGE, {"BASE": BASE})
    return engine


def build_bare(engine: DockerEngine, folder: Path) -> None:
    """Another image: the same without any shell."""
    (folder / "Dockerfile").write_text(
        f"FROM {IMAGE}\nUSER 0\n"
        'RUN ["python3", "-c", "import os; [os.remove(f) for f in '
        "('/bin/sh', '/bin/dash', '/bin/bash', '/bin/rbash') if os.path.lexists(f)]\"]\n"
        "USER 10001:10001\n"
    )
    engine.build(folder, BARE, {})


class Site:
    """A site's configuration, `lumpwatch deploy` on it, and a look at its container from outside."""

    def __init__(self, folder: Path, socket: str, name: str) -> None:
        self.name = name
        self.container = f"lumpwatch-{name}"
        self.config = folder / "site.yaml"
        self.client = docker.DockerClient(base_url=f"unix://{socket}", timeout=60)
        self.environment: dict[str, str] = {}
        self._socket = socket
        self._ports = free_port(), free_port()
        self.write()

    def write(
        self, url: str = "sim:feed?lumps_per_minute=12", raise_above: float = 0.9, regions: int = 1
    ) -> None:
        rois = [
            {
                "id": "apron" if not i else f"apron-{i}",
                "polygon": PLACE,
                "alarm": {"raise_above": raise_above, "latch": False},
            }
            for i in range(regions)
        ]
        tree = {
            "site": self.name,
            "telemetry": {"listen": f"127.0.0.1:{self._ports[0]}"},
            "bus": {"listen": [f"tcp/127.0.0.1:{self._ports[1]}"]},
            "cameras": [{"id": "crusher-1", "source": {"url": url}, "rois": rois}],
        }
        self.config.write_text(json.dumps(tree))

    def deploy(self, action: str, *more: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*LUMPWATCH, "deploy", action, str(self.config), "--socket", self._socket, *more],
            capture_output=True,
            text=True,
            timeout=900,
            env=os.environ | self.environment,
        )

    def up(self, image: str = IMAGE, timeout_s: float = READY_S) -> subprocess.CompletedProcess[str]:
        return self.deploy("up", "--image", image, "--timeout", f"{timeout_s:g}")

    def page(self, path: str) -> tuple[int, str]:
        """Status and text of a page of the daemon's; status 0 while nobody listens."""
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self._ports[0]}{path}", timeout=10) as answer:
                return answer.status, answer.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except OSError:
            return 0, ""

    @property
    def attrs(self) -> dict[str, Any]:
        """What `inspect` says of the container in use."""
        found: dict[str, Any] = self.client.containers.get(self.container).attrs
        return found

    def python(self, code: str) -> str:
        """What a program prints that runs inside; fails where the program does."""
        container = self.client.containers.get(self.container)
        status, output = container.exec_run(["python3", "-c", code])
        assert status == 0, output.decode()
        return str(output.decode().strip())

    def remove(self) -> None:
        for container in self.client.containers.list(all=True):
            if container.name.startswith(self.container):
                container.remove(v=True, force=True)
        for volume in self.client.volumes.list():
            if volume.name.startswith(self.container):
                volume.remove()
        self.client.close()


class Beats:
    """When the heartbeats of the site came, as an outside subscriber hears them."""

    def __init__(self) -> None:
        self.times: list[float] = []

    def __call__(self, key: str, payload: bytes) -> None:
        self.times.append(time.monotonic())

    def gaps_s(self) -> list[float]:
        """The widest first."""
        return sorted((b - a for a, b in zip(self.times, self.times[1:], strict=False)), reverse=True)
