"""The daemon's watch, its health and what it starts, without a process or a bus."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from lumpwatch.service.capture import run_camera
from lumpwatch.service.monitor import run_monitor
from lumpwatch.service.runtime.daemon import MONITOR_STUCK_S, DaemonHealth, tasks_of, watch
from lumpwatch.service.telemetry import Report
from tests.runtime.fakes import FakeClock, FakeWorkers, soon
from tests.service_helpers import site, site_tree


def tree() -> dict[str, Any]:
    """One camera whose regions are to decide within 2 s."""
    made = site_tree()
    made["cameras"][0]["blind_after_s"] = 2.0
    return made


class Health:
    """The health of a daemon with one region, and its parts."""

    def __init__(self) -> None:
        self.clock, self.workers = FakeClock(), FakeWorkers()
        self.of = DaemonHealth(site(tree()), self.workers, self.clock)

    def decided(self, ago_s: float) -> None:
        now = self.clock.now_s
        self.workers.said["monitor", "cam"] = Report(now, "", "running", {"apron": now - ago_s})


@pytest.fixture
def health() -> Health:
    return Health()


def test_ready_while_every_region_has_decided_lately(health: Health) -> None:
    assert len(health.of.ready()) == 1
    health.decided(1.9)
    assert health.of.ready() == []
    health.decided(2.1)
    (problem,) = health.of.ready()
    assert problem.startswith("cam/apron:")


def test_a_monitor_that_was_not_heard_is_not_ready(health: Health) -> None:
    health.workers.said["monitor", "cam"] = None
    assert len(health.of.ready()) == 1
    health.workers.said["monitor", "cam"] = Report(health.clock.now_s, "", "starting")
    assert len(health.of.ready()) == 1


def test_started_stays_so_once_all_have_decided(health: Health) -> None:
    assert health.of.started()
    health.decided(0.1)
    assert health.of.started() == []
    health.decided(60.0)
    assert health.of.started() == []
    assert health.of.ready()


def test_live_while_the_workers_are_watched(health: Health) -> None:
    assert health.of.live() == []
    health.clock.now_s += 6.0
    assert len(health.of.live()) == 1
    health.of.watched()
    assert health.of.live() == []


def test_the_watch_turns_until_it_is_told_to_stop(health: Health) -> None:
    stop = threading.Event()
    health.clock.now_s += 6.0
    turning = threading.Thread(target=watch, args=(health.workers, health.of, stop))
    turning.start()
    soon(lambda: health.workers.watches >= 2)
    stop.set()
    turning.join(timeout=10.0)
    assert not turning.is_alive()
    assert health.of.live() == []


def test_a_camera_has_a_process_that_reads_and_one_that_filters() -> None:
    config = site(tree())
    source = config.cameras[0].source
    monitor, camera = tasks_of(config, config.cameras[0])
    assert (monitor.name, monitor.target, monitor.stuck_after_s) == (
        "monitor:cam",
        run_monitor,
        MONITOR_STUCK_S,
    )
    assert (camera.name, camera.target) == ("camera:cam", run_camera)
    # Longer than a connection that uses up both of its time-outs.
    assert camera.stuck_after_s > source.open_timeout_s + source.read_timeout_s
