"""A bus with what a daemon would say, told by hand, and `lumpwatch console` as a process on it."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import subprocess
import threading
import time
from collections import deque
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

import numpy as np

from lumpwatch.service.bus import Handler, Keys, open_hub
from lumpwatch.service.config import BusConfig
from lumpwatch.service.core import Frame
from tests.bus.test_bus_support import eventually, free_endpoint
from tests.integration.site import LUMPWATCH

SITE = "pit"
REGION = ("cam", "apron")
CONFIG = """\
# The site of the tests.
site: pit
bus: {{mode: router, listen: ["{endpoint}"]}}
store: {{path: var}}
console: {console}
cameras:
  - id: cam   # looks at the apron
    source: {{url: "sim:feed"}}
    rois:
      - id: apron
        polygon: [[0.2, 0.1], [0.8, 0.1], [0.8, 0.9], [0.2, 0.9]]  # drawn by hand
        alarm: {{latch: true}}
"""


class Plant:
    """The hub, and states and heartbeats of one region ten times a second until told otherwise."""

    def __init__(self) -> None:
        self.endpoint = free_endpoint()
        self.hub = open_hub(BusConfig(listen=(self.endpoint,), shared_memory=False))
        self.keys = Keys(SITE)
        self.state = "CLEAR"
        self.reason: str | None = None
        self.more: dict[str, Any] = {}
        """What else the states tell."""
        self.alarms = {"lump": "NORMAL", "blind": "NORMAL", "system": "NORMAL"}
        self.beating = threading.Event()
        self.beating.set()
        self.deeds: deque[tuple[str, dict[str, Any]]] = deque()
        self._ended = threading.Event()
        self._states = self.hub.publisher(self.keys.state(*REGION))
        self._beats = self.hub.publisher(self.keys.heartbeat(REGION[0]))
        self._records = self.hub.alarm_publisher(self.keys.alarm(*REGION))
        self._frames = self.hub.frame_publisher(self.keys.frame("cam"), self.keys.jpeg("cam"))
        self._sequence = 0
        for name in ("ack", "shelve", "verdict", "service", "reset"):
            self.hub.serve(self.keys.command(*REGION, name), self._doing(name))
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.hub.close()

    def raise_alarm(self, alarm_class: str = "lump", **more: Any) -> None:
        """The record of an alarm, and the state that goes with it."""
        self.alarms[alarm_class] = "UNACKNOWLEDGED"
        self.record(alarm_class, "raised", **more)

    def record(self, alarm_class: str, change: str, **more: Any) -> None:
        self._sequence += 1
        data = {
            "site": SITE, "camera": "cam", "roi": "apron", "class": alarm_class, "sequence": self._sequence,
            "change": change, "state": self.alarms[alarm_class], "previous": "NORMAL", "frame": 1, "time_s": 1.0,
            "existence": 0.97, **more,
        }  # fmt: skip
        event = {
            "id": f"{int(1000 * time.time()):015}-{self._sequence:06}", "source": "/lumpwatch/pit/cam/apron",
            "type": f"io.lumpwatch.alarm.{change}.v1", "subject": "cam/apron",
            "time": datetime.now(UTC).isoformat(), "data": data,
        }  # fmt: skip
        self._records.put(json.dumps(event).encode())

    def _doing(self, name: str) -> Handler:
        return lambda _, payload: self._do(name, payload)

    def _do(self, name: str, payload: bytes | None) -> bytes:
        given = json.loads(payload or b"{}")
        self.deeds.append((name, given))
        if name == "verdict":
            return json.dumps(
                {"verdict": given["verdict"], "sequence": 1, "alarm": "1", "written": True}
            ).encode()
        if name == "ack" and self.alarms[given["class"]] == "ACKNOWLEDGED":
            told = {
                "class": given["class"],
                "changes": [],
                "alarm": "ACKNOWLEDGED",
                "active": True,
                "sequence": 1,
            }
            return json.dumps(told).encode()
        stands = {"ack": "ACKNOWLEDGED", "shelve": "SHELVED", "reset": "NORMAL"}.get(name, "OUT_OF_SERVICE")
        change = {"ack": "acknowledged", "shelve": "shelved", "reset": "reset"}.get(name, "out_of_service")
        self.alarms[given["class"]] = stands
        self.record(given["class"], change, actor=given["actor"], reason=given.get("reason"))
        reply = {"class": given["class"], "changes": [change], "alarm": stands, "active": True, "sequence": 1}
        return json.dumps(reply).encode()

    def _tell(self) -> None:
        frame = 0
        rng = np.random.default_rng(1)
        picture = rng.integers(60, 120, (120, 160), dtype=np.uint8)
        while not self._ended.wait(0.1):
            if not self.beating.is_set():
                continue
            frame += 1
            now, wall = time.monotonic(), datetime.now(UTC).isoformat()
            self._frames.publish(Frame(frame, now, now, time.time(), 160, 120, "gray8", picture))
            box = {
                "x": 40.0, "y": 30.0, "w": 50.0, "h": 40.0, "existence": 0.97, "model": "belt", "id": 1,
                "spread_x": 1.0, "spread_y": 1.0,
                "size": {"longest_mm": 812.0, "speed_m_s": 0.4, "distance_m": 1.2, "lip_s": 3.1},
            }  # fmt: skip
            lump = self.state == "LUMP"
            self._states.put(
                json.dumps(
                    {
                        "frame": frame, "time_s": now, "camera": "cam", "roi": "apron", "state": self.state,
                        "existence": 0.97 if lump else 0.02, "objects": [box] if lump else [], "site": SITE,
                        "alarm": self.alarms["lump"], "alarms": self.alarms, "reason": self.reason,
                        "timing": {"captured": wall, "decided": wall, "age_s": 0.05}, **self.more,
                    }
                ).encode()
            )  # fmt: skip
            region = {"state": self.state, "decided_ago_s": 0.05, "valid": True}
            beat = {
                "site": SITE, "camera": "cam", "seq": frame, "time": wall, "valid_s": 2.0, "valid": True,
                "rois": {"apron": region},
            }  # fmt: skip
            self._beats.put(json.dumps(beat).encode())


class Console:
    """`lumpwatch console` on a plant."""

    def __init__(self, plant: Plant, folder: Path, console: str) -> None:
        self.config = folder / "site.yaml"
        self.config.write_text(CONFIG.format(endpoint=plant.endpoint, console=console))
        self._log = folder / "console.log"

    def __enter__(self) -> Self:
        with self._log.open("ab") as log:
            self.process = subprocess.Popen([*LUMPWATCH, "console", str(self.config)], stdout=log, stderr=log)
        try:
            eventually(lambda: re.search(r"console on (\S+)", self._log.read_text()), 90.0)
        except BaseException:
            self.process.kill()
            raise
        found = re.findall(r"console on (\S+)", self._log.read_text())
        self.url = str(found[-1])
        return self

    def __exit__(self, *_: object) -> None:
        self.resume()
        self.process.terminate()
        self.process.wait(timeout=20)

    def freeze(self) -> None:
        os.kill(self.process.pid, signal.SIGSTOP)

    def resume(self) -> None:
        os.kill(self.process.pid, signal.SIGCONT)


class Client:
    """A browser without a window: keeps its cookie."""

    def __init__(self, url: str) -> None:
        self.host = url.partition("://")[2]
        self.cookie = ""
        self.csrf = ""

    def ask(
        self, method: str, path: str, body: bytes | str | None = None, **headers: str
    ) -> tuple[int, dict[str, str], str]:
        """Status, headers in small letters, and text."""
        connection = http.client.HTTPConnection(self.host, timeout=20)
        try:
            given = {name.replace("_", "-"): value for name, value in headers.items()}
            if self.cookie:
                given.setdefault("Cookie", self.cookie)
            connection.request(method, path, body, given)
            answer = connection.getresponse()
            found = {name.lower(): value for name, value in answer.getheaders()}
            text = answer.read().decode("utf-8", "replace")
        finally:
            connection.close()
        if "set-cookie" in found:
            self.cookie = found["set-cookie"].partition(";")[0]
        if match := re.search(r'data-csrf="([^"]*)"', text):
            self.csrf = match[1]
        return answer.status, found, text

    def log_in(self, name: str, password: str) -> int:
        self.ask("GET", "/login")
        status, _, _ = self.ask("POST", "/login", f"csrf={self.csrf}&name={name}&password={password}")
        if status == 303:
            self.ask("GET", "/")
        return status

    def post(self, path: str, content: dict[str, Any]) -> tuple[int, Any]:
        status, _, text = self.ask("POST", path, json.dumps(content), X_CSRF_Token=self.csrf)
        return status, json.loads(text)
