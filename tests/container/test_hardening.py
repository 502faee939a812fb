"""What the container may and may not, tried from inside and out; how it stops; too little shared memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.deployment.bundling import USER
from lumpwatch.service.deployment.engine import DockerEngine
from tests.container.engine import IMAGE, Site

pytestmark = [pytest.mark.slow, pytest.mark.system, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def up(tmp_path_factory: pytest.TempPathFactory, socket: str, engine: DockerEngine) -> Iterator[Site]:
    site = Site(tmp_path_factory.mktemp("hardened"), socket, "test-hardened")
    try:
        done = site.up()
        assert done.returncode == 0, done.stdout + done.stderr
        yield site
    finally:
        site.remove()


def test_the_engine_was_asked_for_little(up: Site) -> None:
    host = up.attrs["HostConfig"]
    assert host["ReadonlyRootfs"] is True
    assert host["ShmSize"] == 64 << 20
    assert host["Memory"] == 1536 << 20
    assert host["PidsLimit"] == 1024
    assert host["Privileged"] is False
    assert up.attrs["Config"]["User"] == f"{USER}:{USER}"


def test_the_kernel_gives_it_little(up: Site) -> None:
    """The state of process 1 as the host's kernel has it."""
    lines = Path(f"/proc/{up.attrs['State']['Pid']}/status").read_text().splitlines()
    status = {name: value.split() for name, _, value in (line.partition(":") for line in lines)}
    for kind in ("CapEff", "CapPrm", "CapBnd", "CapInh", "CapAmb"):
        assert int(status[kind][0], 16) == 0, kind
    assert status["NoNewPrivs"] == ["1"]
    assert set(status["Uid"]) == set(status["Gid"]) == {str(USER)}
    assert status["NSpid"][-1] == "1"  # the daemon itself: signals reach it
    assert b"lumpwatch" in Path(f"/proc/{up.attrs['State']['Pid']}/cmdline").read_bytes()


@pytest.mark.parametrize("place", ["/", "/opt/lumpwatch", "/etc/lumpwatch", "/usr/local"])
def test_nothing_can_be_written_where_programs_lie(up: Site, place: str) -> None:
    code = f"""
try: open({place + "/x"!r}, "w")
except OSError as error: print(error.strerror)
else: print("written")"""
    assert up.python(code) in ("Read-only file system", "Permission denied")
    rw = f"import os; print(os.statvfs({place!r}).f_flag & os.ST_RDONLY)"
    assert up.python(rw) == "1"


@pytest.mark.parametrize("place", ["/tmp", "/dev/shm", "/etc/lumpwatch/var"])
def test_its_own_places_are_writable(up: Site, place: str) -> None:
    assert up.python(f"open({place + '/x'!r}, 'w').write('x'); print(open({place + '/x'!r}).read())") == "x"


def test_the_image_holds_no_installer_and_no_compiler(up: Site) -> None:
    code = """
import importlib.util, shutil
print([m for m in ("pip", "setuptools", "wheel") if importlib.util.find_spec(m)],
      [p for p in ("gcc", "cc", "make", "curl", "wget", "git") if shutil.which(p)])"""
    assert up.python(code) == "[] []"


def test_the_image_says_what_it_is(engine: DockerEngine, up: Site) -> None:
    config = up.client.images.get(IMAGE).attrs["Config"]
    labels = {name.removeprefix("org.opencontainers.image."): text for name, text in config["Labels"].items()}
    assert labels["title"] == "lumpwatch"
    assert labels["licenses"] == "Apache-2.0"
    assert labels["version"] == up.python(
        "from importlib.metadata import version; print(version('lumpwatch'))"
    )
    assert config["StopSignal"] in ("SIGTERM", "15")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (
            {"shm_size": "16m"},
            "/dev/shm has 16 MiB, 1 cameras need 36; start the container with --shm-size=36m",
        ),
        ({"tmpfs": {"/dev/shm": "size=64m,mode=0755"}}, f"/dev/shm cannot be written by user {USER}"),
    ],
    ids=["too little", "closed"],
)
def test_unfit_shared_memory_is_said_at_the_start(up: Site, given: dict[str, Any], said: str) -> None:
    run = up.client.containers.create(
        IMAGE,
        ["run", "/etc/lumpwatch/site.yaml"],
        read_only=True,
        volumes={mount["Name"]: {"bind": mount["Destination"], "mode": "ro"} for mount in up.attrs["Mounts"]},
        **given,
    )
    try:
        run.start()
        assert run.wait(timeout=60)["StatusCode"] == 2
        (line,) = run.logs().decode().strip().splitlines()
    finally:
        run.remove(v=True, force=True)
    assert said in line


def test_the_stop_signal_ends_it_in_order(up: Site) -> None:
    """The last of this file: it stops the container, and starts it again."""
    container = up.client.containers.get(up.container)
    began = time.monotonic()
    container.stop(timeout=15)
    took = time.monotonic() - began
    state = up.attrs["State"]
    assert (state["ExitCode"], state["OOMKilled"]) == (0, False)  # 137: killed at the end of its time
    assert took < 12.0
    assert up.page("/livez")[0] == 0
    again = up.up()
    assert again.returncode == 0, again.stderr
    assert "start (the container is exited)" in again.stdout
