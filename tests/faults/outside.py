"""What someone outside sees: a client of the bus that remembers every state and every alarm record."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.keys import Keys, parse
from lumpwatch.service.storage.event_log import event_file
from lumpwatch.service.storage.event_log_reader import read_events
from tests.integration.site import wait_for

KEYS = Keys("test")
ROI = "apron"
BLIND_AFTER_S = 1.0
NOTICED_S = 3.0
"""The limit of most rows: `blind_after_s` and room for a busy machine."""
PATIENCE_S = 240.0


@dataclass(frozen=True, slots=True)
class Seen:
    """A state that arrived."""

    at_s: float
    """Monotonic time of the arrival."""
    state: str
    reason: str | None
    alarm: str
    sequence: int
    frame: int


class Outside:
    """States and alarm records by camera, since it joined."""

    def __init__(self, bus: Bus, *, states: bool = True) -> None:
        """Without `states` it remembers the alarm records only."""
        self.bus = bus
        self.states: dict[str, list[Seen]] = {}
        self.records: dict[str, list[dict[str, Any]]] = {}
        self.missed: list[int] = []
        if states:
            bus.subscribe(KEYS.states(), self._state)
        bus.subscribe_alarms(KEYS.alarms(), self._alarm, self.missed.append)

    def _state(self, key: str, payload: bytes) -> None:
        one = json.loads(payload)
        kept = (one[name] for name in ("state", "reason", "alarm", "sequence", "frame"))
        seen = Seen(time.monotonic(), *kept)
        self.states.setdefault(one["camera"], []).append(seen)

    def _alarm(self, key: str, payload: bytes) -> None:
        one = json.loads(payload) | {"arrived_s": time.monotonic()}
        self.records.setdefault(parse(key).camera or "", []).append(one)

    def since(self, camera: str, when_s: float) -> list[Seen]:
        """The states that arrived since then."""
        return [one for one in list(self.states.get(camera, ())) if one.at_s >= when_s]

    def wait(self, camera: str, *states: str, since_s: float, within_s: float = PATIENCE_S) -> Seen:
        """The first arrival of one of these states (or alarm states) since then."""

        def there() -> Seen | None:
            arrived = self.since(camera, since_s)
            return next((one for one in arrived if one.state in states or one.alarm in states), None)

        found: Seen = wait_for(f"{camera} {' or '.join(states)}", there, within_s)
        return found

    def sees(self, camera: str, since_s: float) -> Seen:
        """The first decision on a picture since then."""
        return self.wait(camera, "CLEAR", "LUMP", since_s=since_s)

    def raised(self, camera: str, since_s: float) -> dict[str, Any]:
        """The first lump alarm that arrived since then."""

        def there() -> dict[str, Any] | None:
            for one in list(self.records.get(camera, ())):
                data = one["data"]
                if one["arrived_s"] >= since_s and (data["class"], data["change"]) == ("lump", "raised"):
                    return one
            return None

        found: dict[str, Any] = wait_for(f"a lump before {camera} is announced", there, PATIENCE_S)
        return found

    def never_clear(self, camera: str, from_s: float, to_s: float, limit_s: float = NOTICED_S) -> None:
        """In this time, after the limit, nobody was told that the region is clear."""
        told = [one for one in self.since(camera, from_s + limit_s) if one.at_s < to_s]
        assert not any(one.state == "CLEAR" for one in told)

    def lost(self, store: Path, camera: str, first: int = 1) -> int:
        """How many alarms of the event log did not arrive; those that did came once and in order."""

        def missing() -> set[str]:
            logged = {one.id for one in read_events(event_file(store, camera)) if one.sequence >= first}
            return logged - {one["id"] for one in self.records.get(camera, ())}

        end = time.monotonic() + 10.0
        while (left := missing()) and time.monotonic() < end:
            time.sleep(0.1)
        sequences = [one["data"]["sequence"] for one in self.records.get(camera, ())]
        assert sequences == sorted(set(sequences))
        assert self.missed == []
        return len(left)

    def act(self, key: str, **parameters: str) -> dict[str, Any]:
        """Ask the monitor for something; its answer. One that only starts may not be there yet to be asked."""
        reply = wait_for(
            key, lambda: next(iter(self.bus.ask(key, parameters, timeout_s=20.0)), None), PATIENCE_S
        )
        assert reply.payload is not None, reply.error
        answer: dict[str, Any] = json.loads(reply.payload)
        return answer
