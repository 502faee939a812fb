"""Twenty viewers of a daemon: `make viewers`, or of one that runs already:

    python -m tests.console.load CONSOLE_URL BUS_ENDPOINT SECONDS [SITE CAMERA…]

`make viewers SECONDS=600 CAMERAS=4` starts a daemon of so many simulated cameras and its console by itself.
Two of them are Chromium with the live page; for the others an HTTP client follows the stream and asks for ten pictures
a second as a page does, one of them reading slowly. Printed are the age of decisions and of alarm records when they
come over the bus, without viewers (a minute at most) and with them, and what the console takes meanwhile.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.config import BusConfig
from lumpwatch.service.simulator import FeedSimulator, FeedSpec
from tests.bus.test_bus_support import free_endpoint
from tests.console.chromium import chromium
from tests.integration.site import LUMPWATCH, wait_for
from tests.memory import pss_kib

VIEWERS, BROWSERS = 20, 2
BASELINE_S, SAMPLE_S = 60.0, 15.0
SLOW_S = 1.5


@dataclass
class Heard:
    """What came over the bus: ages in seconds."""

    decisions: list[float] = field(default_factory=list)
    alarms: list[float] = field(default_factory=list)

    def on_state(self, _: str, payload: bytes) -> None:
        timing = json.loads(payload)["timing"]
        if timing and timing["age_s"] is not None:
            self.decisions.append(float(timing["age_s"]))

    def on_alarm(self, _: str, payload: bytes) -> None:
        raised = datetime.fromisoformat(json.loads(payload)["time"])
        self.alarms.append((datetime.now(UTC) - raised).total_seconds())


@dataclass
class Viewer:
    """One viewer: pictures that it got, and frames that went by meanwhile."""

    got: int = 0
    passed: int = 0

    def follow(self, host: str, ends_s: float) -> None:
        connection = http.client.HTTPConnection(host, timeout=10)
        connection.request("GET", "/api/v1/stream")
        answer = connection.getresponse()
        while time.monotonic() < ends_s and answer.readline():
            pass
        connection.close()

    def look(self, host: str, camera: str, ends_s: float, every_s: float) -> None:
        threading.Thread(target=self.follow, args=(host, ends_s), daemon=True).start()
        connection = http.client.HTTPConnection(host, timeout=10)
        after = -1
        while time.monotonic() < ends_s:
            began = time.monotonic()
            connection.request("GET", f"/api/v1/cameras/{camera}/picture?after={after}")
            answer = connection.getresponse()
            answer.read()
            if answer.status == 200:
                frame = json.loads(answer.headers["X-Lumpwatch-Frame"])["frame"]
                self.passed += frame - after if after >= 0 else 1
                self.got += 1
                after = frame
            time.sleep(max(0.0, every_s - (time.monotonic() - began)))


def process(pid: int) -> tuple[float, float]:
    """Processor seconds so far, and MiB of memory (its proportional share of what it shares)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / 100, pss_kib(pid) / 1024


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


def told(ages: list[float]) -> str:
    """Percentiles of ages."""
    if not ages:
        return "none"
    found = sorted(ages)
    median, late = (1000 * found[int(share * (len(found) - 1))] for share in (0.5, 0.99))
    return f"{len(found)}, median {median:.0f} ms, 99 % {late:.0f} ms, largest {1000 * found[-1]:.0f} ms"


def watch(pid: int, endpoint: str, site: str, seconds: float) -> None:
    """Measure for so long, and print."""
    heard, memory = Heard(), []
    with open_client(BusConfig(mode="client", connect=(endpoint,))) as bus:
        bus.subscribe(Keys(site).states(), heard.on_state)
        bus.subscribe(Keys(site).alarms(), heard.on_alarm)
        used_s, _ = process(pid)
        began = time.monotonic()
        while (left := began + seconds - time.monotonic()) > 0:
            memory.append(process(pid)[1])
            time.sleep(min(SAMPLE_S, left))
        now_s, last = process(pid)
    print(f"  decisions: {told(heard.decisions)}\n  alarm records: {told(heard.alarms)}")
    print(
        f"  console: {100 * (now_s - used_s) / seconds:.1f} % of a core; memory {memory[0]:.0f} MiB at the beginning, "
        f"{memory[len(memory) // 2]:.0f} in the middle, {last:.0f} at the end, at most {max(*memory, last):.0f}",
        flush=True,
    )


@contextlib.contextmanager
def plant(count: int) -> Iterator[tuple[str, str, list[str]]]:
    """A daemon of so many simulated cameras and its console: address, bus, cameras; all decide by then."""
    cameras, endpoint = [f"crusher-{k + 1}" for k in range(count)], free_endpoint()
    polygon = [[round(float(v), 4) for v in point] for point in FeedSimulator(FeedSpec()).polygon]
    with tempfile.TemporaryDirectory(prefix="lumpwatch-viewers-") as folder:
        config = Path(folder) / "site.yaml"
        head = (
            f'site: demo\nbus: {{listen: ["{endpoint}"]}}\nstore: {{path: var}}\n'
            'telemetry: {listen: "127.0.0.1:0"}\nconsole: {listen: "127.0.0.1:0", anonymous: viewer}\ncameras:\n'
        )
        config.write_text(
            head
            + "".join(
                f'  - {{id: {camera}, source: {{url: "sim:feed?lumps_per_minute=4", seed: {k + 1}}}, '
                f"rois: [{{id: apron, polygon: {polygon}}}]}}\n"
                for k, camera in enumerate(cameras)
            )
        )
        said = Path(folder) / "said.log"
        with said.open("wb") as out:
            processes = [
                subprocess.Popen([*LUMPWATCH, command, str(config)], stdout=out, stderr=out)
                for command in ("run", "console")
            ]
        try:
            wait_for("console", lambda: re.search(r"console on (http\S+)", said.read_text()), 120)
            (url,) = re.findall(r"console on (http\S+)", said.read_text())
            seen: set[str] = set()
            with open_client(BusConfig(mode="client", connect=(endpoint,))) as bus:
                bus.subscribe(Keys("demo").states(), lambda key, _: seen.add(key))
                wait_for("a decision of each camera", lambda: len(seen) == count, 240)
            yield url, endpoint, cameras
        finally:
            for process_ in processes:
                process_.send_signal(signal.SIGTERM)
            for process_ in processes:
                process_.wait(timeout=30)


def main() -> None:
    """Measure."""
    if len(sys.argv) > 3:
        site, *cameras = sys.argv[4:] if len(sys.argv) > 5 else ("demo", "crusher-1")
        measure(sys.argv[1], sys.argv[2], float(sys.argv[3]), site, cameras)
        return
    with plant(int(sys.argv[2])) as (url, endpoint, cameras):
        print(f"{len(cameras)} simulated cameras")
        measure(url, endpoint, float(sys.argv[1]), "demo", cameras)


def measure(url: str, endpoint: str, seconds: float, site: str, cameras: list[str]) -> None:
    """Without viewers and with them."""
    host = url.partition("://")[2]
    pid = listener(int(host.rpartition(":")[2]))
    print("without viewers", flush=True)
    watch(pid, endpoint, site, min(seconds, BASELINE_S))
    viewers = [Viewer() for _ in range(VIEWERS - BROWSERS)]
    ends_s = time.monotonic() + seconds
    threads = [
        threading.Thread(
            target=one.look, args=(host, cameras[i % len(cameras)], ends_s, 0.1 if i else SLOW_S)
        )
        for i, one in enumerate(viewers)
    ]
    print(f"{len(viewers)} clients and {BROWSERS} browsers, {seconds:.0f} s", flush=True)
    with chromium() as browser:
        for i in range(BROWSERS):
            browser.new_page().goto(f"{url}/cameras/{cameras[i % len(cameras)]}", wait_until="commit")
        for thread in threads:
            thread.start()
        watch(pid, endpoint, site, seconds - 1.0)
    for thread in threads:
        thread.join()
    kept = sorted(one.got / max(one.passed, 1) for one in viewers)
    print(
        f"  clients: {sum(one.got for one in viewers) / seconds:.0f} pictures/s together; of the frames that went by "
        f"the slowest got {100 * kept[0]:.0f} %, the median {100 * kept[len(kept) // 2]:.0f} %"
    )


if __name__ == "__main__":
    main()
