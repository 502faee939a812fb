"""What a monitor stands on, by hand: a bus, a clock, the line to the daemon, evidence and proof tests."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry

from lumpwatch.service.bus import Handle, Message, Service
from lumpwatch.service.core import Clocks, Frame, RoiResult, Trouble, utc
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.evidence import Trigger
from lumpwatch.service.monitor.monitor import Monitor
from lumpwatch.service.protocol import Outcome, ProofResult
from lumpwatch.service.storage import EventWriter, PriorStore
from lumpwatch.service.telemetry import MonitorMetrics
from tests.service_helpers import site, site_tree

BEGIN_S = 1000.0
WALL_S = 1.7e9


class FakeClock:
    """Both clocks, set by the test."""

    def __init__(self) -> None:
        self.now_s = BEGIN_S

    def __call__(self) -> Clocks:
        return Clocks(self.now_s, WALL_S + self.now_s)


class FakeInbox:
    """Plays a script: at each turn a step that may give a frame; after the last one the link says stop."""

    def __init__(self, daemon: FakeLink) -> None:
        self.skipped = 0
        self.malformed: dict[str, int] = {}
        self.same_clock = True
        self.foreign = 0
        self.script: list[Callable[[], Frame | None]] = []
        self._link = daemon

    def take(self, timeout_s: float) -> Frame | None:
        if not self.script:
            self._link.stop.set()
            return None
        return self.script.pop(0)()


class FakePublisher:
    """Remembers what was put."""

    name = "5a" * 8

    def __init__(self, sent: list[tuple[str, Any]], key: str) -> None:
        self._sent = sent
        self._key = key

    def put(self, payload: bytes, number: int | None = None, publisher: str | None = None) -> None:
        self._sent.append((self._key.rpartition("/")[2], json.loads(payload)))

    def close(self) -> None:
        """Nothing."""


class FakeBus:
    """One session without a network."""

    def __init__(self, daemon: FakeLink) -> None:
        self.connected = self.flushed = True
        self.sent: list[tuple[str, Any]] = []
        self.services: dict[str, Service] = {}
        self.queryables: list[str] = []
        self.subscriptions: dict[str, Callable[[str, bytes], None]] = {}
        self.tokens: list[str] = []
        self.others: dict[str, Callable[[str], None]] = {}
        self.inbox = FakeInbox(daemon)

    def frame_inbox(self, key: str) -> FakeInbox:
        return self.inbox

    def publisher(self, key: str) -> FakePublisher:
        return FakePublisher(self.sent, key)

    def alarm_publisher(self, key: str, kept: Sequence[Message] = ()) -> FakePublisher:
        return self.publisher(key)

    def serve_all(self, prefix: str, services: Mapping[str, Service]) -> Handle:
        self.queryables.append(prefix)
        self.services |= {f"{prefix}/{name}": one for name, one in services.items()}
        return Handle()

    def subscribe(self, selector: str, callback: Callable[[str, bytes], None]) -> Handle:
        self.subscriptions[selector] = callback
        return Handle()

    def subscribe_others(self, key: str, name: str, callback: Callable[[str], None]) -> Handle:
        self.others[key] = callback
        return Handle()

    def alive(self, key: str) -> Handle:
        self.tokens.append(key)
        return Handle()

    def ask(self, key: str, **parameters: str) -> Any:
        """The answer to a query, as JSON; raises what the handler raises."""
        return json.loads(self.services[key].handler(parameters, None))

    def ask_json(self, key: str, payload: bytes) -> Any:
        return json.loads(self.services[key].handler({}, payload))

    def of(self, kind: str) -> list[Any]:
        return [what for name, what in self.sent if name == kind]


class FakeLink:
    """The worker's end of the line to the daemon."""

    def __init__(self) -> None:
        self.stop = threading.Event()
        self.state = "starting"
        self.decided: dict[str, float] = {}
        self.beats = 0
        self.restarts = 0

    def beat(self) -> None:
        self.beats += 1


class FakeEvidence:
    """Wants evidence of everything, keeps the triggers."""

    def __init__(self) -> None:
        self.triggers: list[Trigger] = []
        self.restarts = 0

    def before(self, frame: Frame, pipeline: object) -> None:
        """Nothing."""

    def after(self, frame: Frame, now_s: float, results: tuple[RoiResult, ...]) -> None:
        """Nothing."""

    def wants(self, trigger: Trigger) -> bool:
        return True

    def begin(self, trigger: Trigger) -> bool:
        self.triggers.append(trigger)
        return True

    def tick(self, now_s: float) -> None:
        """Nothing."""

    def restart(self) -> None:
        self.restarts += 1

    def handler(self, roi: str) -> Callable[[object], bytes]:
        return lambda asked: json.dumps([roi]).encode()


class FakeProofs:
    """Proof tests that pass, unless one is said to run already."""

    def __init__(self) -> None:
        self.found: dict[Trouble, bool] = {}
        self.looked = 0
        self.running = False

    def troubles(self, roi: str) -> dict[Trouble, bool]:
        return self.found

    def poll(self) -> None:
        self.looked += 1

    def test(self, roi: str, actor: str) -> ProofResult:
        if self.running:
            raise LumpwatchError("another proof test of this camera is running")
        return ProofResult(
            site="pit", camera="cam", roi=roi, time=utc(WALL_S), outcome=Outcome.PASSED, actor=actor
        )


class World:
    """A monitor of the small camera and all that it stands on."""

    def __init__(self, store: Path, priors: PriorStore | None = None, **alarm: Any) -> None:
        """`alarm` are keys of the ROI's alarm."""
        tree = site_tree()
        tree["store"] = {"path": str(store), "poll_s": 0.01}
        tree["cameras"][0]["rois"][0]["alarm"] |= alarm
        self.config = site(tree)
        self.registry = CollectorRegistry()
        self.clock, self.daemon, self.evidence, self.proofs = (
            FakeClock(),
            FakeLink(),
            FakeEvidence(),
            FakeProofs(),
        )
        self.bus = FakeBus(self.daemon)
        self.metrics = MonitorMetrics(self.registry, "cam", ("apron",))
        self.events = EventWriter(store, "cam", self.metrics, lambda: self.clock().wall_s)
        bus: Any = self.bus
        daemon: Any = self.daemon
        evidence: Any = self.evidence
        self.monitor = Monitor(
            config=self.config,
            camera_id="cam",
            bus=bus,
            daemon=daemon,
            metrics=self.metrics,
            events=self.events,
            evidence=evidence,
            make_proofs=lambda _: self.proofs,
            clock="boot",
            clocks=self.clock,
            priors=priors,
        )

    def run(self, *steps: Callable[[], Frame | None]) -> None:
        """Turn the main loop once for each step."""
        self.bus.inbox.script = list(steps)
        self.daemon.stop.clear()
        self.monitor.run()

    def metric(self, name: str, **labels: str) -> float:
        found = self.registry.get_sample_value(
            f"lumpwatch_{name}", {"camera": "cam", "roi": "apron"} | labels
        )
        return found or 0.0
