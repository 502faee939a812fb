"""What the tests of the gateway share: messages of a region, told by hand, and a plant that tells them on a bus."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import threading
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from lumpwatch.service.bus import BusClosed, Handler, Keys, open_hub
from lumpwatch.service.config import BusConfig, SiteConfig, parse_config
from lumpwatch.service.core import AlarmClass, AlarmState, BlindReason, Decision
from lumpwatch.service.gateway.register_map import Point, RegisterMap
from lumpwatch.service.protocol import (
    AlarmData,
    AlarmEvent,
    FeedRecord,
    Heartbeat,
    Level,
    RoiBeat,
    StateMessage,
)
from lumpwatch.service.protocol.messages import ObjectRecord, SizeRecord, Timing
from tests.bus.test_bus_support import eventually, free_endpoint
from tests.integration.site import LUMPWATCH

CAMERA, ROI = "cam", "apron"
REGION = (CAMERA, ROI)
NOW = datetime(2026, 1, 1, tzinfo=UTC)
CONFIG = """\
site: pit
bus: {{mode: router, listen: ["{endpoint}"]}}
store: {{path: var}}
gateway: {gateway}
cameras:
  - id: cam
    source: {{url: "sim:feed"}}
    rois:
      - id: apron
        polygon: [[0.2, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]
        calibration:
          width: {{far: [[0.3, 0.2], [0.7, 0.2]], near: [[0.2, 0.8], [0.8, 0.8]], width_mm: 1200, view_deg: 60}}
          lip: [[0.2, 0.9], [0.8, 0.9]]
          limit_mm: 700
"""


def config(gateway: str = "{}", endpoint: str = "tcp/127.0.0.1:7447") -> SiteConfig:
    return parse_config(CONFIG.format(endpoint=endpoint, gateway=gateway))


def lump(longest_mm: float | None = 812.0, lip_s: float | None = 3.1, *, counts: bool = True) -> ObjectRecord:
    size = SizeRecord(longest_mm=longest_mm, speed_m_s=0.4, distance_m=1.2, lip_s=lip_s)
    return ObjectRecord(
        x=1, y=1, w=5, h=5, existence=0.97, model="belt", id=1, spread_x=1, spread_y=1, size=size, counts=counts
    )  # fmt: skip


def state(
    decision: Decision = Decision.CLEAR,
    *,
    frame: int = 1,
    reason: BlindReason | None = None,
    objects: tuple[ObjectRecord, ...] = (),
    alarms: dict[AlarmClass, AlarmState] | None = None,
    sequence: int = 0,
    age_s: float = 0.1,
    feed: FeedRecord | None = None,
) -> StateMessage:
    stands = dict.fromkeys(AlarmClass, AlarmState.NORMAL) | (alarms or {})
    return StateMessage(
        frame=frame, time_s=1.0, camera=CAMERA, roi=ROI, state=decision, existence=0.97 if objects else 0.02,
        objects=objects, site="pit", alarm=stands[AlarmClass.LUMP].value, alarms=stands, reason=reason, prior=3,
        trained=True, sequence=sequence, timing=Timing(captured=NOW, decided=datetime.now(UTC), age_s=age_s),
        feed=feed,
    )  # fmt: skip


def level(*, lump: bool = False, blind: bool = False, system: bool = False, blocked: bool = False) -> Level:
    return Level(
        lump=1 if lump else 0, blind=1 if blind else 0, system=1 if system else 0, alarm="NORMAL",
        blind_alarm="NORMAL", sequence=0, valid_s=3.0, blocked=1 if blocked else 0,
    )  # fmt: skip


def beat(seq: int = 1, *, valid: bool = True, ago_s: float | None = 0.05) -> Heartbeat:
    region = RoiBeat(state=Decision.CLEAR, decided_ago_s=ago_s, valid=valid)
    return Heartbeat(
        site="pit", camera=CAMERA, seq=seq, time=NOW, valid_s=3.0, valid=valid, rois={ROI: region}
    )


def alarm(stands: str, sequence: int, alarm_class: AlarmClass = AlarmClass.LUMP) -> AlarmEvent:
    data = AlarmData.model_validate(
        {
            "site": "pit", "camera": CAMERA, "roi": ROI, "class": alarm_class, "sequence": sequence,
            "change": "raised", "state": stands, "previous": "NORMAL", "frame": 1, "time_s": 1.0, "existence": 0.9,
        }
    )  # fmt: skip
    return AlarmEvent(
        id=f"{sequence:06}", source="/lumpwatch/pit/cam/apron", type="io.lumpwatch.alarm.raised.v1",
        subject="cam/apron", time=datetime.now(UTC), data=data,
    )  # fmt: skip


class Plant:
    """A hub on which one region is told of ten times a second, and which does what it is asked."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.keys = Keys("pit")
        self.decision = Decision.CLEAR
        self.reason: BlindReason | None = None
        self.objects: tuple[ObjectRecord, ...] = ()
        self.alarms: dict[AlarmClass, AlarmState] = {}
        self.deeds: list[tuple[str, dict[str, Any]]] = []
        self.beating = True
        self._sequence = 0
        self._ended = threading.Event()
        self.open()
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()

    def open(self) -> None:
        self.hub = open_hub(BusConfig(listen=(self.endpoint,), shared_memory=False))
        for role, name in (("daemon", "pit"), ("monitor", CAMERA)):
            self.hub.alive(self.keys.alive(role, name))
        self._states = self.hub.publisher(self.keys.state(*REGION))
        self._levels = self.hub.publisher(self.keys.level(*REGION))
        self._beats = self.hub.publisher(self.keys.heartbeat(CAMERA))
        self._records = self.hub.alarm_publisher(self.keys.alarm(*REGION))
        for name in ("ack", "suppress", "shelve", "unshelve", "feed"):
            self.hub.serve(self.keys.command(*REGION, name), self._doing(name))

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.hub.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def raise_alarm(self, stands: AlarmState = AlarmState.UNACKNOWLEDGED) -> None:
        self._sequence += 1
        self.alarms = {AlarmClass.LUMP: stands}
        self._records.put(alarm(stands, self._sequence).line())

    def _doing(self, name: str) -> Handler:
        return lambda _, payload: self._do(name, payload)

    def _do(self, name: str, payload: bytes | None) -> bytes:
        self.deeds.append((name, json.loads(payload or b"{}")))
        if name == "ack":
            self.raise_alarm(AlarmState.ACKNOWLEDGED)
        return b"{}"

    def _tell(self) -> None:
        frame = 0
        while not self._ended.wait(0.1):
            if not self.beating:
                continue
            frame += 1
            told = state(
                self.decision, frame=frame, reason=self.reason, objects=self.objects, alarms=self.alarms,
                sequence=self._sequence,
            )  # fmt: skip
            blind = self.decision is Decision.BLIND
            with contextlib.suppress(BusClosed):  # until it is opened again
                self._states.put(told.line())
                self._levels.put(level(lump=self.decision is Decision.LUMP, blind=blind).line())
                self._beats.put(beat(frame).line())


class Gateway:
    """`lumpwatch gateway` as a process."""

    def __init__(self, file: Path, serves: str = "modbus") -> None:
        self.file = file
        self._log = file.with_suffix(".log")
        self._serves = serves

    def start(self) -> None:
        with self._log.open("wb") as out:
            self.process = subprocess.Popen([*LUMPWATCH, "gateway", str(self.file)], stdout=out, stderr=out)
        try:
            eventually(
                lambda: re.search(rf"{self._serves} on (\S+)", self.log) or self.process.poll() is not None,
                60.0,
            )
        except AssertionError:
            self.process.kill()
            raise
        found = re.search(rf"{self._serves} on (\S+)", self.log)
        assert found is not None, self.log
        self.address = found[1].rstrip('"}')

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def port(self) -> int:
        return int(self.address.rpartition(":")[2])

    @property
    def memory_kib(self) -> int:
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.findall(r"VmRSS:\s+(\d+)", text)[0])

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(timeout=20)
            except subprocess.TimeoutExpired:
                self.process.kill()
                raise
        print(self.log)


def points(of: SiteConfig) -> dict[str, Point]:
    """The map by name; input registers and coils."""
    return {point.name: point for point in RegisterMap(of).points if point.table != "holding"}
