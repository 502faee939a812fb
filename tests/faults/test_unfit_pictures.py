"""Faults of the picture while the stream goes on: through the bus, the quality checks and the blind alarm."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import pytest

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.storage.prior_store import PriorStore
from lumpwatch.service.storage.reference_store import ReferenceStore
from tests import belt_scene
from tests.belt_scene import FPS, HEIGHT, REFERENCE, WIDTH, Fault, belt
from tests.faults.outside import BLIND_AFTER_S, KEYS, NOTICED_S, PATIENCE_S, Outside, Seen
from tests.faults.table import Record, Row
from tests.integration.site import Daemon, wait_for
from tests.service_helpers import frame, prior, site_tree

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

CAM = "cam"
QUALITY = belt_scene.CONFIG.quality
RECOVERED_S = 15.0
CASES: dict[str, tuple[str, Fault]] = {
    "frozen": ("the same picture again and again, but for its clock; the stream goes on", belt_scene.frozen),
    "dark": ("a sixteenth of the light", belt_scene.dark),
    "glare": ("white all over, with a little noise", lambda p, k: 250 + p % 3),
    "dusty": ("a bright veil of 88 %", belt_scene.dusty),
    "hidden": ("a plate before most of the region", belt_scene.plate),
    "blurred": ("out of focus, sigma 2.5 px", belt_scene.blurred),
    "moved": ("the camera turned by 7 % of the picture", belt_scene.turned),
}


class LiveFeed:
    """The camera of a running belt; it shows a fault while there is one."""

    def __init__(self, bus: Bus) -> None:
        self.fault: Fault | None = None
        self._publisher = bus.frame_publisher(KEYS.frame(CAM))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        k = 0
        while not self._stop.wait(1.0 / FPS):
            k += 1
            shown, fault = belt(200 + k % 600), self.fault
            now = time.monotonic()
            data = shown if fault is None else fault(shown, k)
            one = frame(k, time_s=now, received_s=now, data=data, size=(WIDTH, HEIGHT))
            self._publisher.publish(one, "raw", None)


@dataclass
class Site:
    """A daemon, and what is seen of it."""

    daemon: Daemon
    outside: Outside
    feed: LiveFeed
    store: Path

    def said(self, reason: str, since_s: float) -> Seen:
        """The first time that this was the reason."""

        def there() -> Seen | None:
            return next((one for one in self.outside.since(CAM, since_s) if one.reason == reason), None)

        found: Seen = wait_for(f"BLIND ({reason})", there, PATIENCE_S)
        return found


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("pictures")
    (camera,) = site_tree(particles=50)["cameras"]
    camera |= {"quality": {}, "blind_after_s": BLIND_AFTER_S}
    camera["rois"][0]["alarm"] |= {"blind": {"on_delay_s": 0.5, "off_delay_s": 0.3}}
    daemon = Daemon(folder, f"  - {json.dumps(camera)}\n")
    daemon.roles = ("--only", "monitor")
    config = load_config(daemon.config)
    PriorStore(config.store.path).save(prior())
    ReferenceStore(config.store.path).save(REFERENCE)
    with ExitStack() as stack:
        stack.enter_context(daemon)
        client = stack.enter_context(open_client(as_client(config.bus)))
        feed = stack.enter_context(LiveFeed(client))
        outside = Outside(stack.enter_context(open_client(as_client(config.bus))))
        outside.sees(CAM, 0.0)
        yield Site(daemon, outside, feed, config.store.path)
        assert daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()


@pytest.mark.parametrize("reason", CASES)
def test_the_picture_is_not_fit(site: Site, record: Record, reason: str) -> None:
    done, fault = CASES[reason]
    outside = site.outside
    time.sleep(QUALITY.moved.window_s)  # whole windows of fit pictures
    outside.wait(CAM, "CLEAR", since_s=time.monotonic())
    began = time.monotonic()
    site.feed.fault = fault
    limit_s = QUALITY.found_within_s(getattr(QUALITY, reason)) + NOTICED_S
    noticed_s = site.said(reason, began).at_s - began
    wait_for(
        "blind alarm",
        lambda: site.daemon.metric("lumpwatch_alarm_active", camera=CAM, **{"class": "blind"}) == 1,
        20,
    )
    time.sleep(3.0)
    over = time.monotonic()
    outside.never_clear(CAM, began, over, limit_s)
    assert outside.since(CAM, began)[-1].state == "BLIND"
    site.feed.fault = None
    back = outside.wait(CAM, "CLEAR", since_s=over)
    record(
        Row(
            f"picture {reason}", done, f"BLIND ({reason}), an alarm of class blind", noticed_s, limit_s,
            outside.lost(site.store, CAM), "sees again when the picture is fit", back.at_s - over, RECOVERED_S,
        )
    )  # fmt: skip


FLAP_S = 2.5
FLAPS = 3


def test_the_picture_is_fit_by_turns(site: Site, record: Record) -> None:
    """Whatever flaps ends in an alarm that stands, though no spell of it is long."""
    outside = site.outside
    outside.wait(CAM, "CLEAR", since_s=time.monotonic())
    began = time.monotonic()
    spell = round(FLAP_S * FPS)
    site.feed.fault = lambda p, k: belt_scene.dark(p, k) if k // spell % 2 else p

    def active() -> bool:
        return site.daemon.metric("lumpwatch_alarm_active", camera=CAM, **{"class": "blind"}) == 1

    wait_for("blind alarm", active, 30)
    noticed_s = time.monotonic() - began
    end = began + 2 * FLAP_S * FLAPS
    while time.monotonic() < end:
        assert active(), "the alarm went while the picture flapped"
        time.sleep(0.2)
    over = time.monotonic()
    site.feed.fault = None
    back = outside.wait(CAM, "CLEAR", since_s=over)
    record(
        Row(
            "picture flaps", f"a sixteenth of the light for {FLAP_S} s, good for {FLAP_S} s, {FLAPS} times",
            "an alarm of class blind that stands all the time", noticed_s, 2 * FLAP_S + 6.4,
            outside.lost(site.store, CAM), "sees again when the picture is fit", back.at_s - over, RECOVERED_S,
        )
    )  # fmt: skip
