"""Twenty viewers of a daemon: `python -m tests.console.load CONSOLE_URL BUS_ENDPOINT SECONDS [SITE CAMERA…]`.

Prints the age of decisions on the bus without and with viewers, each of whom follows the stream and asks for ten
pictures a second as a page does, and what the console takes of processor and memory meanwhile.
"""

from __future__ import annotations

import http.client
import json
import sys
import threading
import time
from pathlib import Path

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.config import BusConfig

VIEWERS = 20


def ages(endpoint: str, site: str, seconds: float) -> list[float]:
    """Seconds from capture to decision, of all frames in so many seconds, sorted."""
    found: list[float] = []
    with open_client(BusConfig(mode="client", connect=(endpoint,))) as bus:
        bus.subscribe(
            Keys(site).states(),
            lambda _, payload: found.append(
                float((json.loads(payload)["timing"] or {"age_s": 0.0})["age_s"])
            ),
        )
        time.sleep(seconds)
    return sorted(found)


def view(host: str, camera: str, ends_s: float, counts: list[int]) -> None:
    """One viewer: the stream in one thread, pictures in this one."""

    def stream() -> None:
        connection = http.client.HTTPConnection(host, timeout=10)
        connection.request("GET", "/api/v1/stream")
        answer = connection.getresponse()
        while time.monotonic() < ends_s and answer.readline():
            pass
        connection.close()

    threading.Thread(target=stream, daemon=True).start()
    connection = http.client.HTTPConnection(host, timeout=10)
    after = -1
    while time.monotonic() < ends_s:
        began = time.monotonic()
        connection.request("GET", f"/api/v1/cameras/{camera}/picture?after={after}")
        answer = connection.getresponse()
        answer.read()
        if answer.status == 200:
            after = json.loads(answer.headers["X-Lumpwatch-Frame"])["frame"]
            counts[0] += 1
        time.sleep(max(0.0, 0.1 - (time.monotonic() - began)))


def process(pid: int) -> tuple[float, float]:
    """Processor seconds so far and MiB of memory."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100, int(fields[21]) * 4096 / (1 << 20)


def listener(port: int) -> int:
    """The process that listens on a port of loopback."""
    wanted = f"0100007F:{port:04X}"
    inode = next(
        line.split()[9]
        for line in Path("/proc/net/tcp").read_text().splitlines()[1:]
        if line.split()[1] == wanted and line.split()[3] == "0A"
    )
    for entry in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if entry.readlink().name == f"socket:[{inode}]":
                return int(entry.parts[2])
        except OSError:
            continue
    raise SystemExit(f"nobody listens on port {port}")


def main() -> None:
    """Measure."""
    url, endpoint, seconds = sys.argv[1], sys.argv[2], float(sys.argv[3])
    site, *cameras = sys.argv[4:] if len(sys.argv) > 5 else ("demo", "crusher-1")
    host = url.partition("://")[2]
    pid = listener(int(host.rpartition(":")[2]))
    for viewers in (0, VIEWERS):
        ends_s, counts = time.monotonic() + seconds, [0]
        threads = [
            threading.Thread(target=view, args=(host, cameras[i % len(cameras)], ends_s, counts))
            for i in range(viewers)
        ]
        for thread in threads:
            thread.start()
        used_s, before = process(pid)
        found = ages(endpoint, site, seconds - 0.5)
        now_s, after = process(pid)
        for thread in threads:
            thread.join()
        print(
            f"{viewers:2} viewers: {len(found)} decisions, median {1000 * found[len(found) // 2]:.0f} ms, "
            f"p99 {1000 * found[int(0.99 * (len(found) - 1))]:.0f} ms; console {100 * (now_s - used_s) / seconds:.1f} "
            f"% of a core, memory {before:.0f} to {after:.0f} MiB; {counts[0] / seconds:.0f} pictures/s"
        )


if __name__ == "__main__":
    main()
