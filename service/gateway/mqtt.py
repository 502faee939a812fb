"""MQTT: retained states, alarms as CloudEvents, and a last will.

A retained state outlives the gateway, so it says how long it is valid, and `status` turns to offline by the last will.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime
from typing import Any

from lumpwatch.service.config import MqttConfig
from lumpwatch.service.gateway.broker import Broker
from lumpwatch.service.gateway.orders import Orders
from lumpwatch.service.gateway.register_map import REGION_COILS
from lumpwatch.service.gateway.values import RegionValues, SiteValues

log = logging.getLogger(__name__)

VALID_S = 3.0
"""A reader trusts no state for longer than this after it came."""
EVERY_S, LEAST_S = 1.0, 0.2
"""A state is sent so often without news, and not more often with."""


class MqttServer:
    """Publishes to one broker."""

    def __init__(
        self, config: MqttConfig, site: str, orders: Orders, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._root = f"{config.topic}/{site}"
        self._orders = orders
        self._clock = clock
        self._lock = threading.Lock()
        self._sent: dict[str, tuple[float, dict[str, Any]]] = {}
        self._regions: frozenset[tuple[str, str]] = frozenset()
        self._status = f"{self._root}/status"
        self._broker = Broker(
            config,
            f"lumpwatch-{site}",
            will=lambda: (self._status, _status(online=False), True),
            on_connect=self._connected,
            on_message=self._command,
            subscribe=(f"{self._root}/+/+/set/+",) if config.commands else (),
        )
        self.address = config.broker
        """Where it publishes."""

    async def start(self) -> None:
        """Connect; a broker that is not there is waited for. Raises GatewayError."""
        self._broker.start()

    async def close(self) -> None:
        """Say offline, and leave."""
        self._broker.close((self._status, _status(online=False), True))

    def set(self, values: SiteValues) -> None:
        """Send what has changed."""
        self._regions = frozenset((region.camera, region.roi) for region in values.regions)
        if not self._broker.connected:
            return
        now = self._clock()
        for region in values.regions:
            content = plain(region)
            with self._lock:
                sent = self._sent.get(region.name)
                if sent is not None and not self._due(sent, content, now):
                    continue
                self._sent[region.name] = now, content
            text = json.dumps({**content, "time": datetime.now(UTC).isoformat(), "valid_s": VALID_S})
            self._broker.publish(f"{self._root}/{region.name}/state", text.encode(), retain=True)

    def alarm(self, camera: str, roi: str, payload: bytes) -> None:
        """Send an alarm record, at least once: the same `id` is the same record."""
        self._broker.publish(f"{self._root}/{camera}/{roi}/alarm", payload, qos=1)

    def _due(self, sent: tuple[float, dict[str, Any]], content: dict[str, Any], now: float) -> bool:
        at_s, before = sent
        quiet = {**content, "heartbeat": 0} == {**before, "heartbeat": 0}
        urgent = any(content[name] != before[name] for name in ("decision", "quality", "alarms", "lump"))
        return urgent or now - at_s >= (EVERY_S if quiet else LEAST_S)

    def _connected(self) -> None:
        with self._lock:
            self._sent.clear()  # a broker that was away may have forgotten all
        self._broker.publish(self._status, _status(online=True), qos=1, retain=True)

    def _command(self, topic: str, payload: bytes) -> None:
        """`…/CAMERA/ROI/set/COIL` with 0 or 1."""
        camera, roi, _, coil = topic.removeprefix(f"{self._root}/").split("/")
        known = coil in {one.name for one in REGION_COILS} and (camera, roi) in self._regions
        if not known or payload not in (b"0", b"1"):
            log.warning("mqtt: %s: expected a coil of the map, and 0 or 1", topic)
            return
        self._orders.write((camera, roi), coil, payload == b"1")


def _status(*, online: bool) -> bytes:
    return json.dumps({"online": online}).encode()


def plain(region: RegionValues) -> dict[str, Any]:
    """A region as JSON has it; null: not available."""
    return {
        "quality": region.quality.name,
        "why": region.why.name.lower(),
        "heartbeat": region.heartbeat,
        "clear": region.clear,
        "decision": region.decision,
        "blind_reason": region.blind_reason,
        "alarms": {str(name): str(state) for name, state in region.alarms.items()} or None,
        "lump": region.lump,
        "blocked": region.blocked,
        "existence": region.existence,
        "count": region.count,
        "largest_mm": region.largest_mm,
        "lip_s": None if region.lip_s is None else round(region.lip_s, 1),
        "speed_mm_s": region.speed_mm_s,
        "limit_mm": region.limit_mm,
        "prior": region.prior,
        "sequence": region.sequence,
        "feed": region.feed.state,
        "feed_speed_mm_s": region.feed.speed_mm_s,
        "load": region.feed.load,
        "visible_p80_mm": region.feed.visible_p80_mm,
        "mouth_standing": region.mouth.standing,
        "mouth_stood_s": region.mouth.stood_s,
    }
