"""The figures of docs/deployment.md, measured anew: `make figures`, as root.

Everything is seen from outside: the engine's account of the container, the kernel's of its processes,
the daemon's pages, and heartbeats on the bus.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from tests.container.engine import BASE, IMAGE, READY_S, Beats, Site, build, missing, podman
from tests.integration.site import wait_for
from tests.memory import pss_kib

SETTLE_S = 60.0
QUIET, BUSY = "sim:feed?lumps_per_minute=0", "sim:feed?lumps_per_minute=12"


def processes(site: Site) -> list[int]:
    """Those in the container, as the host numbers them."""
    found, first = [], Path(f"/proc/{site.attrs['State']['Pid']}/ns/pid").readlink()
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and (entry / "ns/pid").readlink() == first:
                found.append(int(entry.name))
        except OSError:
            continue
    return found


def memory(site: Site) -> str:
    """Sum of PSS over the processes, and what the control group is charged."""
    pss = 0
    for pid in processes(site):
        pss += pss_kib(pid)
    usage = site.client.containers.get(site.container).stats(stream=False)["memory_stats"]["usage"]
    return (
        f"{pss / 1024:.0f} MiB PSS in {len(processes(site))} processes, {usage / 2**20:.0f} MiB control group"
    )


def until_ready(site: Site) -> float:
    """Start the stopped container; seconds until /readyz says yes."""
    began = time.monotonic()
    site.client.containers.get(site.container).start()
    wait_for("ready", lambda: site.page("/readyz")[0] == 200, READY_S)
    return time.monotonic() - began


def up(site: Site) -> float:
    """Seconds that `deploy up` takes."""
    began = time.monotonic()
    done = site.up()
    assert done.returncode == 0, done.stdout + done.stderr
    return time.monotonic() - began


def gaps(site: Site) -> tuple[list[float], str]:
    """Roll out a camera that does not exist: the two widest gaps in the heartbeat, and what was said."""
    beats = Beats()
    config = load_config(site.config)
    with open_client(as_client(config.bus)) as bus:
        bus.subscribe(Keys(config.site).heartbeats(), beats)
        wait_for("heartbeat", lambda: beats.times, 60)
        site.write(url="rtsp://127.0.0.1:9/nothing")
        bad = site.up(timeout_s=30)
        assert bad.returncode == 1
        heard = len(beats.times)
        wait_for("heartbeats again", lambda: len(beats.times) > heard + 3, 60)
    return beats.gaps_s()[:2], bad.stderr.strip().rpartition("; ")[2]


def measure(site: Site) -> None:
    sizes = {name: site.client.images.get(name).attrs["Size"] / 1e9 for name in (IMAGE, BASE)}
    print(f"image {sizes[IMAGE]:.2f} GB, of it the base {sizes[BASE]:.2f} GB")
    site.write(url=QUIET)
    print(f"first `deploy up`, nothing compiled yet: {up(site):.1f} s")
    time.sleep(SETTLE_S)
    print(f"idle (no lump), one region, kernels compiled in this run: {memory(site)}")
    site.client.containers.get(site.container).stop(timeout=15)
    print(f"start to ready, kernels in the store: {until_ready(site):.1f} s")
    time.sleep(SETTLE_S)
    print(f"idle (no lump), one region: {memory(site)}")
    site.write(url=BUSY, regions=4)
    print(f"`deploy up` of four regions: {up(site):.1f} s")
    time.sleep(SETTLE_S)
    print(f"12 lumps a minute, four regions: {memory(site)}")
    site.write(url=BUSY)
    up(site)
    widest, said = gaps(site)
    print(f"bad configuration, --timeout 30s: gaps {widest[0]:.1f} and {widest[1]:.1f} s; {said}")


def main() -> None:
    """Print the figures, one a line."""
    if reason := missing():
        raise SystemExit(reason)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    with tempfile.TemporaryDirectory() as folder, podman(Path(folder)) as socket:
        build(socket)
        site = Site(Path(folder), socket, "figures")
        try:
            measure(site)
        finally:
            site.remove()
    print(f"load {os.getloadavg()[0]:.1f} after")


if __name__ == "__main__":
    main()
