"""SIGKILL of every part between camera and PLC, as a Modbus master sees it."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Self

import pytest
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.gateway.values import Why
from lumpwatch.service.storage.prior_store import PriorStore
from tests.faults.outside import BLIND_AFTER_S, Outside
from tests.faults.pictures import camera, write_clip
from tests.faults.table import Record, Row
from tests.gateway.site import Gateway
from tests.integration.site import Daemon, free_port, wait_for
from tests.servers.process import RtspServer
from tests.service_helpers import prior

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

STANDS_S = 2.0
"""So long the counter must stand while a part is dead."""
BACK_S = 40.0
STARTED_S = 120.0
"""A daemon that starts anew, on a machine that does other things too."""


@dataclass(frozen=True, slots=True)
class Read:
    """What a master read; None: the read failed."""

    at_s: float
    registers: tuple[int, ...] | None

    @property
    def good(self) -> bool:
        return self.registers is not None and self.registers[1] == 192

    @property
    def counter(self) -> int | None:
        return None if self.registers is None else self.registers[3]

    @property
    def why(self) -> str:
        return "no connection" if self.registers is None else Why(self.registers[2]).name.lower()


class Master:
    """Reads a region thirty times a second, and remembers."""

    def __init__(self, port: int) -> None:
        self.reads: list[Read] = []
        self._port = port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        client = ModbusTcpClient("127.0.0.1", port=self._port, timeout=1, retries=0, reconnect_delay=0)
        while not self._stop.wait(0.03):
            found = None
            with contextlib.suppress(ModbusException, OSError):
                if client.connected or client.connect():
                    answer = client.read_input_registers(64, count=25)
                    found = None if answer.isError() else tuple(answer.registers)
            self.reads.append(Read(time.monotonic(), found))
            if found is None:
                client.close()
        client.close()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def first(self, what: str, since_s: float, condition: Callable[[Read], bool], within_s: float) -> Read:
        found: Read = wait_for(
            what, lambda: next((r for r in self.reads if r.at_s >= since_s and condition(r)), None), within_s
        )
        return found

    def last_beat(self, since_s: float, until_s: float) -> float:
        """When the counter was last seen to move in that time; `since_s` where it did not."""
        moved, before = since_s, None
        for one in self.reads:
            if since_s <= one.at_s <= until_s and one.counter is not None:
                moved = one.at_s if before not in (None, one.counter) else moved
                before = one.counter
        return moved


@dataclass
class Site:
    daemon: Daemon
    gateway: Gateway
    master: Master
    outside: Outside

    def fault(
        self, of: Callable[[], int], again: Callable[[], None] = lambda: None, back_s: float = BACK_S
    ) -> tuple[float, str, float]:
        """Kill a process; seconds until quality is not Good and the counter stands, why, and until all is back."""
        good = self.master.first("good", time.monotonic(), lambda r: r.good, 90)
        self.master.first("beating", good.at_s, lambda r: r.counter not in (None, good.counter), 10)
        process = of()
        began = time.monotonic()
        os.kill(process, signal.SIGKILL)
        bad = self.master.first("not good", began, lambda r: not r.good, 30)
        again()
        back = self.master.first("good again", bad.at_s, lambda r: r.good, back_s)
        before = [r.counter for r in self.master.reads if r.at_s < began and r.counter is not None][-1]
        # Not one beat while it was bad, whatever was read; a new gateway begins at 0.
        down = [
            r.counter for r in self.master.reads if bad.at_s <= r.at_s < back.at_s and r.counter is not None
        ]
        beats = self.master.last_beat(bad.at_s, back.at_s - 0.3)
        assert beats - bad.at_s < 0.5, (before, down)
        self.master.first("beating again", back.at_s, lambda r: r.counter not in (None, back.counter), 10)
        return max(bad.at_s, self.master.last_beat(began, bad.at_s)) - began, bad.why, back.at_s - bad.at_s


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("gateway")
    server = RtspServer(write_clip(folder / "clip.mp4"))
    daemon = Daemon(folder, camera("cam", server.url))
    port = free_port()
    with daemon.config.open("a") as file:
        file.write(f'gateway: {{modbus: {{listen: "127.0.0.1:{port}"}}}}\n')
    config = load_config(daemon.config)
    PriorStore(config.store.path).save(prior(camera_id="cam"))
    with (
        daemon,
        Gateway(daemon.config) as gateway,
        Master(port) as master,
        open_client(as_client(config.bus)) as bus,
    ):
        yield Site(daemon, gateway, master, Outside(bus))
    server.kill()


def row(
    site: Site,
    name: str,
    done: str,
    recovery: str,
    seen: tuple[float, str, float],
    limit_s: float,
    back_limit_s: float = BACK_S,
) -> Row:
    noticed_s, why, back_s = seen
    return Row(
        name, done, f"Modbus: quality Bad ({why}), heartbeat stands", noticed_s, limit_s,
        site.outside.lost(load_config(site.daemon.config).store.path, "cam"), recovery, back_s, back_limit_s,
    )  # fmt: skip


def test_the_camera_is_killed(site: Site, record: Record) -> None:
    seen = site.fault(lambda: site.daemon.worker("camera", "cam"))
    assert seen[1] == "blind"
    text = "the daemon starts it again; Good and beating"
    record(
        row(site, "gateway: camera killed", "SIGKILL of the camera process", text, seen, BLIND_AFTER_S + 1.5)
    )


def test_the_monitor_is_killed(site: Site, record: Record) -> None:
    seen = site.fault(lambda: site.daemon.worker("monitor", "cam"))
    text = "the daemon starts it again; Good and beating"
    record(row(site, "gateway: monitor killed", "SIGKILL of the monitor process", text, seen, 1.0))


def test_the_gateway_is_killed(site: Site, record: Record) -> None:
    seen = site.fault(lambda: site.gateway.process.pid, site.gateway.start)
    assert seen[1] == "no connection"
    text = "started again as an engine or systemd would; Good and beating"
    record(row(site, "gateway itself killed", "SIGKILL of the gateway", text, seen, 1.0))


def test_the_hub_is_killed(site: Site, record: Record) -> None:
    seen = site.fault(lambda: site.daemon.worker("hub"))
    assert seen[1] in ("no_bus", "process_gone")
    text = "the daemon starts it again; Good and beating"
    record(row(site, "gateway: hub killed", "SIGKILL of the hub's process", text, seen, 1.5))


def test_the_daemon_is_killed(site: Site, record: Record) -> None:
    def again() -> None:
        assert site.daemon.process is not None
        site.daemon.process.wait()
        site.daemon.start()

    def daemon() -> int:
        assert site.daemon.process is not None
        return site.daemon.process.pid

    seen = site.fault(daemon, again, STARTED_S)
    assert seen[1] in ("no_bus", "process_gone")
    text = "started again as an engine or systemd would; Good and beating"
    done = "SIGKILL of the daemon, whose hub ends with it"
    record(row(site, "gateway: daemon killed", done, text, seen, 1.5, STARTED_S))
