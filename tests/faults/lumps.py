"""A daemon whose cameras are feeds of the test: lumps come and go as the test wants."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.storage.event_log import event_file
from lumpwatch.service.storage.event_log_reader import read_events
from lumpwatch.service.storage.prior_store import PriorStore
from tests.faults.outside import BLIND_AFTER_S, KEYS, ROI, Outside
from tests.integration.feed import Feed
from tests.integration.site import Daemon, wait_for
from tests.service_helpers import prior, site_tree

CAM = "cam"


@dataclass
class Lumps:
    """A daemon and its cameras, and one who looks on."""

    daemon: Daemon
    outside: Outside
    feeds: dict[str, Feed]
    store: Path

    def lump(self, of: str = CAM) -> tuple[float, float]:
        """One lump that comes and goes; the time of its appearance, and seconds until it was announced."""
        began = time.monotonic()
        self.feeds[of].bright = True
        arrived = self.outside.raised(of, began)["arrived_s"]
        self.feeds[of].bright = False
        self.outside.wait(of, "RETURNED", since_s=began)
        self.acknowledge(of)
        return began, arrived - began

    def acknowledge(self, of: str = CAM) -> None:
        assert self.outside.act(KEYS.command(of, ROI, "ack"), actor="Ada")["acknowledged"]

    def problems(self, reason: str, of: str = CAM) -> float:
        return self.daemon.metric("lumpwatch_event_log_problems_total", camera=of, reason=reason)

    def written(self) -> bool:
        """Whether the event log holds all that was announced."""
        sequence = self.outside.since(CAM, 0.0)[-1].sequence
        events = list(read_events(event_file(self.store, CAM)))
        return bool(events) and events[-1].sequence == sequence

    def kill_monitor(self) -> float:
        """When it was dead."""
        pid = self.daemon.worker("monitor", CAM)
        os.kill(pid, signal.SIGKILL)
        killed = time.monotonic()
        wait_for("a new monitor", lambda: self.daemon.worker("monitor", CAM) != pid, 20)
        return killed


def start(
    stack: ExitStack,
    folder: Path,
    names: tuple[str, ...],
    bus: str = 'listen: ["tcp/127.0.0.1:{port}"]',
    prepare: Callable[[Path], None] = lambda _: None,
    environment: dict[str, str] | None = None,
) -> tuple[Daemon, Outside, dict[str, Feed]]:
    """A daemon whose cameras are feeds of this test; `prepare` gets the store before it starts."""
    cameras = []
    for name in names:
        (one,) = site_tree(particles=100)["cameras"]
        one |= {"id": name, "blind_after_s": BLIND_AFTER_S}
        blind = {"on_delay_s": 0.5, "off_delay_s": 0.3, "window_s": 1.5}
        one["rois"][0]["alarm"] |= {"off_delay_s": 1.0, "blind": blind}
        cameras.append(f"  - {json.dumps(one)}\n")
    daemon = Daemon(folder, "".join(cameras), bus)
    daemon.roles = ("--only", "monitor")
    daemon.environment = environment or {}
    config = load_config(daemon.config)
    for name in names:
        PriorStore(config.store.path).save(prior(camera_id=name))
    prepare(config.store.path)
    stack.enter_context(daemon)
    client = stack.enter_context(open_client(as_client(config.bus)))
    feeds = {name: stack.enter_context(Feed(client, name)) for name in names}
    outside = Outside(stack.enter_context(open_client(as_client(config.bus))))
    return daemon, outside, feeds
