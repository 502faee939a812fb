"""What the plant's control system asks for: acknowledgements, and its signals, passed on to the bus.

A signal counts for `valid_s` after it was last written, so a control system that dies in maintenance does not keep
alarms suppressed: the suppression on the bus ends by itself. Orders are states and not a queue: whoever writes the
same thing a thousand times a second has it passed on as often as one who writes it once.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from lumpwatch.service.bus import Bus, BusClosed, Keys
from lumpwatch.service.config import PlantConfig
from lumpwatch.service.core import AlarmClass
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.gateway.register_map import ACKNOWLEDGES, FEEDER, MAINTENANCE

log = logging.getLogger(__name__)

Region = tuple[str, str]
"""Camera and ROI."""
Ask = Callable[[Region, str, dict[str, object]], str | None]
"""Give a command to a region: None when it was taken, else why not."""

_TIMEOUT_S = 2.0
_AGAIN_S = 1.0
_STOPPED, _MAINTENANCE, _FEEDER = "feeder-stopped", "maintenance", "feeder"
_FEED = "feed"
"""The command that tells what the plant knows of the feed."""


def by_bus(bus: Bus, site: str) -> Ask:
    """Orders as commands on the bus."""
    keys = Keys(site)

    def ask(region: Region, command: str, parameters: dict[str, object]) -> str | None:
        payload = json.dumps(parameters).encode()
        try:
            replies = bus.ask(keys.command(*region, command), {}, payload, timeout_s=_TIMEOUT_S)
        except BusClosed:
            return "the bus is closed"
        except LumpwatchError as error:
            return str(error)
        if not replies:
            return "nobody answers: does the monitor run, and may this gateway do that?"
        return replies[0].error

    return ask


@dataclass(slots=True)
class _Signal:
    """A plant signal as it was last written."""

    value: bool
    written_s: float


@dataclass(frozen=True, slots=True)
class _Order:
    """Something to be told to the bus; `until_s` is when it ends by itself."""

    region: Region
    command: str
    about: str
    """Signal or actor."""
    alarm_class: AlarmClass | None
    value: bool
    until_s: float


class Orders:
    """Takes orders from any thread, and passes them on in a thread of its own: `run`."""

    def __init__(
        self, ask: Ask, plant: PlantConfig, actor: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._ask = ask
        self._plant = plant
        self._actor = actor
        self._clock = clock
        self._wake = threading.Condition()
        self._waiting: dict[tuple[Region, AlarmClass], str] = {}
        self._signals: dict[tuple[Region, str], _Signal] = {}
        self._told: dict[tuple[Region, str, AlarmClass | None], _Order] = {}
        self._failed: dict[tuple[Region, str], float] = {}
        self.refused = 0
        """Orders that the bus did not take."""

    def acknowledge(self, region: Region, alarm_class: AlarmClass, actor: str | None = None) -> None:
        """Have an alarm acknowledged."""
        with self._wake:
            self._waiting[region, alarm_class] = actor or self._actor
            self._wake.notify_all()

    def signal(self, region: Region, name: str, value: bool) -> None:
        """The plant says, again or anew, how a signal is."""
        with self._wake:
            before = self._signals.get((region, name))
            self._signals[region, name] = _Signal(value, self._clock())
            if before is None or before.value is not value:
                self._wake.notify_all()

    def write(self, region: Region, coil: str, value: bool) -> None:
        """A coil was written."""
        if coil not in ACKNOWLEDGES:
            self.signal(region, coil, value)
        elif value:
            self.acknowledge(region, ACKNOWLEDGES[coil])

    def read(self, region: Region, coil: str) -> bool:
        """What a coil reads: an acknowledgement that waits, or a signal that is valid."""
        with self._wake:
            if coil in ACKNOWLEDGES:
                return (region, ACKNOWLEDGES[coil]) in self._waiting
            found = self._signals.get((region, coil))
            return found is not None and found.value and self._valid(found)

    def run(self, stop: threading.Event) -> None:
        """Pass on until `stop` is set."""
        while not stop.is_set():
            if not self.pass_on():
                with self._wake:
                    self._wake.wait(0.1)

    def pass_on(self) -> bool:
        """Pass on one order; whether there was one."""
        with self._wake:
            waits = next(iter(self._waiting.items()), None)
        if waits is not None:
            (region, alarm_class), actor = waits
            self._give(region, "ack", {"actor": actor, "class": alarm_class})
            with self._wake:
                self._waiting.pop((region, alarm_class), None)
            return True
        with self._wake:
            now = self._clock()
            order = next(self._due(now), None)
        if order is None:
            return False
        key = (order.region, order.about, order.alarm_class)
        taken = self._give(order.region, order.command, self._parameters(order, now))
        with self._wake:
            if not taken:
                self._failed[order.region, order.about] = now + _AGAIN_S
            elif order.until_s > now:
                self._told[key] = order
            else:
                self._told.pop(key, None)
        return True

    def _due(self, now: float) -> Iterator[_Order]:
        """What the bus does not know yet: changes first, then what must be renewed, then what is over."""
        wanted = {(o.region, o.about, o.alarm_class): o for o in self._wanted()}
        for key, order in wanted.items():
            told = self._told.get(key)
            renew_s = self._plant.valid_s / 3
            news = told is None or told.value is not order.value or order.until_s - told.until_s > renew_s
            if news and self._failed.get(key[:2], now) <= now:
                yield order
        for key, told in list(self._told.items()):
            if key in wanted:
                continue
            if told.until_s <= now:
                del self._told[key]  # it has ended by itself
            elif self._ended_by_plant(told) and self._failed.get(key[:2], now) <= now:
                yield _Order(told.region, told.command, told.about, told.alarm_class, told.value, now)

    def _wanted(self) -> Iterator[_Order]:
        for (region, name), signal in self._signals.items():
            if not self._valid(signal):
                continue
            until_s = signal.written_s + self._plant.valid_s
            if name == FEEDER:
                yield _Order(region, _FEED, _FEEDER, None, signal.value, until_s)
            if name == FEEDER and not signal.value:
                for alarm_class in self._plant.feeder_stopped:
                    yield _Order(region, "suppress", _STOPPED, alarm_class, True, until_s)
            if name == MAINTENANCE and signal.value:
                for alarm_class in self._plant.maintenance:
                    yield _Order(region, "suppress", _MAINTENANCE, alarm_class, True, until_s)

    def _ended_by_plant(self, told: _Order) -> bool:
        """Whether the plant took a signal back; one that it no longer writes runs out."""
        name = MAINTENANCE if told.about == _MAINTENANCE else FEEDER
        signal = self._signals.get((told.region, name))
        return signal is not None and self._valid(signal)

    def _valid(self, signal: _Signal) -> bool:
        return self._clock() - signal.written_s < self._plant.valid_s

    def _parameters(self, order: _Order, now: float) -> dict[str, object]:
        valid_s = round(max(0.0, order.until_s - now), 3)
        if order.command == _FEED:
            return {"signal": order.about, "valid_s": valid_s, "runs": order.value}
        return {"signal": order.about, "valid_s": valid_s, "class": order.alarm_class}

    def _give(self, region: Region, command: str, parameters: dict[str, object]) -> bool:
        problem = self._ask(region, command, parameters)
        if problem is not None:
            self.refused += 1
            log.warning("%s/%s: %s was not taken: %s", *region, command, problem)
        return problem is None
