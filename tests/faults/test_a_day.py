"""A day through the live path by a simulated clock: memory stays flat, and every alarm arrives.

Frames travel over a real bus into the inbox, the pipeline, the event log and the publishers, as in the
monitor: ten a second around each lump, and one in LUMPWATCH_DAY_STEP_S seconds (10) while nothing happens;
0.1 is a whole day of frames.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from prometheus_client import CollectorRegistry, generate_latest

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client, open_hub
from lumpwatch.service.core.alarm import AlarmClass
from lumpwatch.service.core.clock import Clocks
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.monitor.announcer import Announcer
from lumpwatch.service.storage.event_log_writer import EventWriter
from lumpwatch.service.telemetry import MonitorMetrics
from tests.bus.test_bus_support import client_config, free_endpoint, hub_config
from tests.faults.outside import Outside
from tests.faults.table import Record, Row
from tests.service_helpers import HEIGHT, WIDTH, picture, prior, site, site_tree

pytestmark = [pytest.mark.slow, pytest.mark.timeout(24 * 3600)]

STEP_S = float(os.environ.get("LUMPWATCH_DAY_STEP_S", "10"))
NEAR_S = 0.1
DAY_S, WARM_S, SAMPLE_S = 86_400.0, 4 * 3600.0, 900.0
LUMP_EVERY_S, DARK_S, LUMP_S = 1800.0, 2.0, 2.0
BLIND_EVERY_S, BLIND_S = 7200.0, 300.0
GROWTH_MIB = 8.0
"""What the process may grow in a day, by the slope after the first four hours."""
PAGE_MIB = os.sysconf("SC_PAGE_SIZE") / 2**20


def rss_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_MIB


class Clock:
    """The time of the simulated day, on both clocks."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def clocks(self) -> Clocks:
        return Clocks(self.now_s, 1.7e9 + self.now_s)


def moments() -> Iterator[tuple[float, bool | None]]:
    """When something comes in the course of a day: a picture with or without the lump, or none at all."""
    near = np.arange(0.0, 2 * DARK_S + LUMP_S, NEAR_S)
    times = np.concatenate([near, np.arange(near[-1] + STEP_S, LUMP_EVERY_S, STEP_S)])
    for begin in np.arange(0.0, DAY_S, LUMP_EVERY_S):
        for at in times:
            if (begin + at) % BLIND_EVERY_S >= BLIND_EVERY_S - BLIND_S:
                yield begin + at, None
            else:
                yield begin + at, bool(DARK_S <= at < DARK_S + LUMP_S)


@dataclass
class Life:
    """What the monitor consists of, and the camera before it."""

    clock: Clock
    camera: Bus
    bus: Bus
    events: EventWriter
    registry: CollectorRegistry
    announcer: Announcer
    pipeline: CameraPipeline

    def run(self) -> list[tuple[float, float]]:
        """Live the day; time and memory now and then."""
        key = Keys("test").frame("cam")
        frames, inbox = self.camera.frame_publisher(key), self.bus.frame_inbox(key)
        pictures = {bright: picture(bright=bright) for bright in (False, True)}
        begin, memory, sampled = self.clock.now_s, [], 0.0
        for number, (elapsed, bright) in enumerate(moments()):
            now = self.clock.now_s = begin + elapsed
            if bright is None:
                results = self.pipeline.poll(now)
            else:
                frame = Frame(number, now, now, 1.7e9 + now, WIDTH, HEIGHT, "gray8", pictures[bright])
                taken = None
                while taken is None:  # until the subscription is known, frames lead nowhere
                    frames.publish(frame)
                    taken = inbox.take(1.0)
                results = self.pipeline.process(taken, now)
            self.announcer.announce(results)
            self.announcer.confirm()
            if results and results[0].alarm.waits and not results[0].alarm.active:
                self.announcer.announce((self.pipeline.acknowledge("apron", "Ada", now),))
            if elapsed >= sampled:
                generate_latest(self.registry)
                memory.append((elapsed, rss_mib()))
                sampled += SAMPLE_S
        return memory


@pytest.fixture
def hub() -> Iterator[str]:
    endpoint = free_endpoint()
    with open_hub(hub_config(endpoint)):
        yield endpoint


def test_a_day_in_flat_memory(hub: str, tmp_path: Path, record: Record) -> None:
    tree = site_tree(particles=100)
    tree["cameras"][0] |= {"blind_after_s": 30.0}
    tree["cameras"][0]["sight"] |= {"within_s": 30.0}  # a frame in 10 s while nothing happens
    config = site(tree).cameras[0]
    clock, registry = Clock(), CollectorRegistry()
    metrics = MonitorMetrics(registry, "cam", ("apron",))
    events = EventWriter(tmp_path, "cam", metrics, lambda: clock.clocks().wall_s)
    with (
        open_client(client_config(hub)) as camera,
        open_client(client_config(hub)) as bus,
        open_client(client_config(hub)) as other,
    ):
        outside = Outside(other, states=False)
        announcer = Announcer(
            site="test",
            camera=config,
            bus=bus,
            events=events,
            metrics=metrics,
            clock="boot",
            clocks=clock.clocks,
        )
        pipeline = CameraPipeline(config, {"apron": prior()}, observer=metrics)
        life = Life(clock, camera, bus, events, registry, announcer, pipeline)
        began = time.monotonic()
        memory = np.array(life.run())
        took = time.monotonic() - began
        lost = outside.lost(tmp_path, "cam")
    events.close()
    lumps = [one for one in outside.records["cam"] if one["data"]["change"] == "raised"]
    of_class = [one["data"]["class"] for one in lumps]
    assert of_class.count(AlarmClass.BLIND.value) == round(DAY_S / BLIND_EVERY_S)
    shown = round(DAY_S / LUMP_EVERY_S)
    assert of_class.count(AlarmClass.LUMP.value) == shown
    later = memory[memory[:, 0] >= WARM_S]
    slope = np.polyfit(later[:, 0], later[:, 1], 1)[0] * DAY_S
    print(
        f"{took:.0f} s; {memory[0, 1]:.1f} MiB at first, {memory[-1, 1]:.1f} at last, {slope:+.2f} MiB a day"
    )
    assert slope < GROWTH_MIB
    record(
        Row(
            "a day of operation",
            f"24 simulated hours through bus, filter, event log and publishers: {shown} lumps, "
            f"{round(DAY_S / BLIND_EVERY_S)} outages of 5 minutes; a frame in {STEP_S:g} s while nothing happens",
            f"memory grows by {max(slope, 0.0):.1f} MiB a day (limit {GROWTH_MIB:g})",
            None, None, lost, "nothing to recover from", None, None,
        )
    )  # fmt: skip
