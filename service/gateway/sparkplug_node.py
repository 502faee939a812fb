"""An edge node of Sparkplug B: birth with all metrics, data by exception, death as the last will, rebirth on request.

`bdSeq` of a birth is that of the will that the same connection left; it rises from connection to connection. `seq` is 0
in a birth and rises by one from message to message, from 255 to 0.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from lumpwatch.service.config import MqttConfig, SparkplugConfig
from lumpwatch.service.gateway.broker import Broker
from lumpwatch.service.gateway.orders import Orders
from lumpwatch.service.gateway.register_map import REGION_COILS, RegisterMap
from lumpwatch.service.gateway.sparkplug import BOOLEAN, DOUBLE, UINT64, Metric, decode, encode
from lumpwatch.service.gateway.values import SiteValues

log = logging.getLogger(__name__)

LEAST_S = 0.1
"""Data are not sent more often."""
_REBIRTH = "Node Control/Rebirth"
_BDSEQ = "bdSeq"


class SparkplugNode:
    """One edge node."""

    def __init__(
        self,
        mqtt: MqttConfig,
        config: SparkplugConfig,
        site: str,
        register_map: RegisterMap,
        orders: Orders,
        clock: Callable[[], float] = time.monotonic,
        wall: Callable[[], float] = time.time,
    ) -> None:
        node = config.node or site
        self._group, self._node = config.group, node
        self._map = register_map
        self._orders = orders
        self._commands = mqtt.commands
        self._clock = clock
        self._wall = wall
        self._lock = threading.Lock()
        self._bdseq = -1
        self._seq = 0
        self._born = False
        self._values: SiteValues | None = None
        self._sent: dict[str, float | None] = {}
        self._sent_s = float("-inf")
        self._coils = {
            f"{camera}/{roi}/{coil.name}": ((camera, roi), coil.name)
            for camera, roi in register_map.regions
            for coil in REGION_COILS
        }
        self._aliases: dict[str, int] = {}
        self._broker = Broker(
            mqtt,
            f"lumpwatch-{site}-sparkplug",
            will=self._will,
            on_connect=self._birth,
            on_message=self._command,
            subscribe=(self._topic("NCMD"),),
        )
        self.address = f"{mqtt.broker} as {config.group}/{node}"
        """Where it publishes, and as whom."""

    async def start(self) -> None:
        """Connect; a broker that is not there is waited for. Raises GatewayError."""
        self._broker.start()

    async def close(self) -> None:
        """Die, and leave."""
        topic, payload, _ = self._death()
        self._broker.close((topic, payload, False))

    def set(self, values: SiteValues) -> None:
        """Send what has changed since the last message."""
        with self._lock:
            self._values = values
            now = self._clock()
            if not self._born or not self._broker.connected or now - self._sent_s < LEAST_S:
                return
            news = [
                Metric(value, DOUBLE if fraction else UINT64, alias=self._aliases[name])
                for name, value, fraction in self._map.numbers(values)
                if self._sent.get(name, -1.0) != value
            ]
            if not news:
                return
            self._sent_s = now
            self._sent = {name: value for name, value, _ in self._map.numbers(values)}
            self._seq = (self._seq + 1) % 256
            self._broker.publish(self._topic("NDATA"), encode(news, self._now_ms(), self._seq))

    def alarm(self, camera: str, roi: str, payload: bytes) -> None:
        """Alarms are metrics here: their states, and the sequence of the last record."""

    def _topic(self, kind: str) -> str:
        return f"spBv1.0/{self._group}/{kind}/{self._node}"

    def _will(self) -> tuple[str, bytes, bool]:
        with self._lock:
            self._born = False
            self._bdseq = (self._bdseq + 1) % 256
        return self._death()

    def _death(self) -> tuple[str, bytes, bool]:
        return self._topic("NDEATH"), encode([self._bdseq_metric()], self._now_ms()), False

    def _bdseq_metric(self) -> Metric:
        return Metric(self._bdseq, UINT64, _BDSEQ)

    def _birth(self) -> None:
        """All metrics with their names; also when a host asks for it."""
        with self._lock:
            values = self._values
            if values is None:
                return
            known = list(self._map.numbers(values))
            self._aliases = {name: i + 1 for i, (name, _, _) in enumerate(known)}
            metrics = [self._bdseq_metric(), Metric(False, BOOLEAN, _REBIRTH)]
            metrics += [
                Metric(value, DOUBLE if fraction else UINT64, name, self._aliases[name])
                for name, value, fraction in known
            ]
            if self._commands:
                metrics += [
                    Metric(self._orders.read(*place), BOOLEAN, name) for name, place in self._coils.items()
                ]
            self._seq, self._born = 0, True
            self._sent = {name: value for name, value, _ in known}
            self._broker.publish(self._topic("NBIRTH"), encode(metrics, self._now_ms(), 0))

    def _command(self, topic: str, payload: bytes) -> None:
        try:
            metrics = decode(payload)
        except ValueError:
            log.warning("sparkplug: %s: not a payload of Sparkplug B", topic)
            return
        for metric in metrics:
            if metric.name == _REBIRTH and metric.value is True:
                self._birth()
            elif self._commands and metric.name in self._coils and isinstance(metric.value, bool):
                self._orders.write(*self._coils[metric.name], metric.value)

    def _now_ms(self) -> int:
        return round(1000 * self._wall())
