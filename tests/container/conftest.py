from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from lumpwatch.service.deployment.engine import DockerEngine
from tests.container.engine import Site, build, missing, podman


@pytest.fixture(scope="session")
def socket(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    if reason := missing():
        pytest.skip(reason)
    with podman(tmp_path_factory.mktemp("engine")) as socket:
        yield socket


@pytest.fixture(scope="session")
def engine(socket: str) -> DockerEngine:
    return build(socket)


@pytest.fixture
def site(tmp_path: Path, socket: str, engine: DockerEngine) -> Iterator[Site]:
    site = Site(tmp_path, socket, f"test-{os.getpid()}")
    yield site
    site.remove()
