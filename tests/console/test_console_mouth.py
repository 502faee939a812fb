"""A mouth that bridges, through a real daemon: what a subscriber of the bus, a PLC, and an operator are told of it."""

from __future__ import annotations

import re
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from pymodbus.client import ModbusTcpClient

from lumpwatch.service.bus import Bus, Keys, open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmClass
from lumpwatch.service.protocol import AlarmData, AlarmEvent
from tests.console.chromium import needs_chromium
from tests.gateway.site import points
from tests.integration.site import LUMPWATCH, Daemon, free_port, wait_for

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# It bridges from the fourth second of the feed on, for six, and again at 19.5 s and 36.8 s: who is late sees the next.
CAMERA = """\
  - id: crusher-1
    source: {url: "sim:feed?seed=34&fps=10&width=320&height=240&mouth_level=0.4&bridge_every_s=12&bridge_duration_s=6"}
    rois:
      - id: mouth
        watch: mouth
        polygon: [[0.11, 0.77], [0.89, 0.77], [0.89, 0.95], [0.11, 0.95]]
        mouth: {learn_s: 1.0}
        alarm: {blocked: {on_delay_s: 2.0, off_delay_s: 0.5}}
"""


class Told:
    """The site's processes, and what a subscriber of the bus and a PLC read of the mouth."""

    def __init__(self, daemon: Daemon, bus: Bus, port: int) -> None:
        config = load_config(daemon.config)
        self.address = {
            name.rpartition("/")[2]: point.address
            for name, point in points(config).items()
            if name.startswith("crusher-1/mouth/")
        }
        self.plc = ModbusTcpClient("127.0.0.1", port=port, timeout=5)
        self.records: list[AlarmData] = []
        bus.subscribe_alarms(Keys("test").alarms(), self._on_alarm)

    def _on_alarm(self, key: str, payload: bytes) -> None:
        data = AlarmEvent.model_validate_json(payload).data
        if data.alarm_class is AlarmClass.BLOCKED:
            self.records.append(data)

    def record(self, change: str) -> AlarmData:
        """The first of that kind."""

        def found() -> AlarmData | None:
            return next((one for one in self.records if one.change == change), None)

        told: AlarmData = wait_for(f"{change} on the bus", found, 60)
        return told

    def registers(self, **wanted: int) -> dict[str, int]:
        """All of the mouth's, of one request, once they are as wanted."""

        def look() -> dict[str, int] | None:
            if not self.plc.connected and not self.plc.connect():
                return None
            answer = self.plc.read_input_registers(64, count=27)
            if answer.isError():
                return None
            read = {
                name: answer.registers[at - 64] for name, at in self.address.items() if 64 <= at < 64 + 27
            }
            return read if wanted.items() <= read.items() else None

        found: dict[str, int] = wait_for(f"registers {wanted}", look, 60)
        return found


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[Told, str]]:
    """What is told, and the console's address."""
    port = free_port()
    daemon = Daemon(tmp_path, CAMERA)
    with daemon.config.open("a") as file:
        file.write(f'gateway: {{modbus: {{listen: "127.0.0.1:{port}"}}}}\n')
        file.write('console: {listen: "127.0.0.1:0", anonymous: operator}\n')
    said = tmp_path / "console.log"
    with daemon, said.open("wb") as out:
        beside = [
            subprocess.Popen([*LUMPWATCH, command, str(daemon.config)], stdout=out, stderr=out)
            for command in ("gateway", "console")
        ]
        try:
            with open_client(as_client(load_config(daemon.config).bus)) as bus:
                told = Told(daemon, bus, port)
                found = wait_for("console", lambda: re.search(r"console on (http\S+)", said.read_text()), 60)
                yield told, found[1]
                told.plc.close()
        finally:
            for process in beside:
                process.send_signal(signal.SIGTERM)
            for process in beside:
                process.wait(timeout=30)


@pytest.mark.slow
@needs_chromium
def test_bus_plc_and_browser_are_told_and_the_plc_acknowledges(
    site: tuple[Told, str], browser: Browser
) -> None:
    told, console = site
    page = browser.new_page()
    page.goto(console, wait_until="commit")

    raised = told.record("raised")
    assert (raised.camera, raised.roi, raised.reason) == ("crusher-1", "mouth", "standing")
    read = told.registers(blocked_alarm=2, decision=4, quality=192)
    assert read["state"] & (1 << 11)
    assert not read["state"] & 1
    assert read["mouth_standing"] > 250
    assert read["mouth_stood"] >= 20
    assert read["count"] == 65535  # a mouth has no lumps
    page.wait_for_selector(".tile[data-status=BLOCKED] .detail:has-text('material stands in the mouth for')")
    page.wait_for_selector("#strip.blocked:has-text('BLOCKED crusher-1 / mouth')")

    assert not told.plc.write_coil(told.address["ack_blocked"], True).isError()
    assert told.record("acknowledged").actor == "plc"
    page.wait_for_selector("#strip", state="hidden")

    # Decision, alarm and its condition come one after the other; CLEAR needs all three.
    wait_for("CLEAR", lambda: told.registers(decision=1, blocked_alarm=1)["state"] & 1, 60)
    page.wait_for_selector(".tile[data-status=CLEAR]")
    page.close()
