"""The supervisor with processes and a clock steered by hand: who is started, killed, waited for and given up."""

from __future__ import annotations

import os
import struct
from typing import Any

import pytest

from lumpwatch.service.runtime.report_reader import MOST_BYTES
from lumpwatch.service.runtime.supervisor import (
    FIRST_PAUSE_S,
    LONGEST_PAUSE_S,
    MOST_UNDEAD,
    Supervisor,
    Task,
)
from lumpwatch.service.telemetry import RESTARTS_WITHIN_S, Relay, Report, Restarts
from tests.runtime.fakes import FakeProcess, FakeSystem, soon
from tests.workers import good

CAMERA, MONITOR = "camera:cam", "monitor:cam"


class Site:
    """Two supervised tasks on a fake system."""

    def __init__(self) -> None:
        self.system = FakeSystem()
        self.relay = Relay()
        self.restarts: list[tuple[str, str, str]] = []
        self.supervisor = Supervisor(
            [Task("cam", role, good, (), 10.0) for role in ("camera", "monitor")],
            self.relay,
            lambda *told: self.restarts.append(told),
            start=self.system.start,
            clock=self.system.clock,
        )
        self.supervisor.watch()

    def after(self, seconds: float, *reporting: str) -> None:
        """Watch every half second, with reports of some tasks."""
        for _ in range(round(seconds / 0.5)):
            self.system.clock.now_s += 0.5
            for name in reporting:
                self.hear(name)
            self.supervisor.watch()

    def hear(self, name: str) -> None:
        """A report of a task, until the supervisor has it."""
        self.system.report(name)
        soon(lambda: self.heard(name))

    def heard(self, name: str) -> bool:
        self.supervisor.watch()
        return (self.of(name) or never).beat_s == self.system.clock.now_s

    def of(self, name: str) -> Report | None:
        role, camera = name.split(":")
        return self.supervisor.reports()[role, camera]

    def processes(self, name: str) -> list[FakeProcess]:
        return self.system.processes[name]


never = Report(-1.0, "", "")


@pytest.fixture
def site() -> Site:
    return Site()


def test_all_are_started_once_and_heard(site: Site) -> None:
    site.after(3.0, CAMERA, MONITOR)
    assert [len(site.processes(name)) for name in (CAMERA, MONITOR)] == [1, 1]
    report = site.of(MONITOR)
    assert report is not None
    assert report.state == "running"
    assert site.restarts == []


def test_one_that_ends_is_started_again_after_a_pause_that_grows_to_a_limit(site: Site) -> None:
    pauses = []
    for _ in range(8):
        site.system.newest(CAMERA).end(3)
        site.supervisor.watch()
        begun, many = site.system.clock.now_s, len(site.processes(CAMERA))
        while len(site.processes(CAMERA)) == many:
            site.after(0.5)
        pauses.append(site.system.clock.now_s - begun)
    assert pauses == [FIRST_PAUSE_S, 1.0, 2.0, 4.0, 8.0, *[LONGEST_PAUSE_S] * 3]
    assert site.restarts == [("cam", "camera", "exited")] * 8
    assert all(process.closed for process in site.processes(CAMERA)[:-1])


def start_again(site: Site) -> Any:
    """The monitor ends and is started again; what the new one is told first, None: nothing yet."""
    many = len(site.processes(MONITOR))
    site.system.newest(MONITOR).end(3)
    while len(site.processes(MONITOR)) == many:
        site.after(0.5)
    line = site.system.newest(MONITOR).line
    return line.recv() if line.poll(0) else None


def test_a_worker_is_told_how_often_those_before_it_ended_of_late(site: Site) -> None:
    assert not site.system.newest(MONITOR).line.poll(0)
    assert [start_again(site) for _ in range(3)] == [Restarts(1), Restarts(2), Restarts(3)]
    assert not site.system.newest(CAMERA).line.poll(0)
    site.system.clock.now_s += RESTARTS_WITHIN_S
    assert start_again(site) == Restarts(1)


def test_one_that_another_task_replaces_did_not_end_by_itself(site: Site) -> None:
    site.supervisor.replace(Task("cam", "monitor", good, (), 10.0))
    assert site.system.newest(MONITOR).line.recv() == "stop"
    assert start_again(site) is None


def test_half_a_message_holds_up_nobody(site: Site) -> None:
    os.write(site.system.newest(CAMERA).line.fileno(), struct.pack("!i", 1000) + b"half")
    site.after(3.0, MONITOR)
    assert site.of(MONITOR) is not None
    assert site.of(CAMERA) is None


def test_a_message_beyond_the_limit_ends_the_line_and_the_worker_counts_as_stuck(site: Site) -> None:
    site.hear(CAMERA)
    os.write(site.system.newest(CAMERA).line.fileno(), struct.pack("!i", MOST_BYTES + 1))
    site.after(12.0, MONITOR)
    assert site.restarts == [("cam", "camera", "stuck")]


@pytest.mark.parametrize("message", [b"no pickle", b"\x80\x04K\x01."], ids=["unreadable", "a number"])
def test_what_is_no_report_is_passed_over(site: Site, message: bytes) -> None:
    site.system.newest(CAMERA).line.send_bytes(message)
    site.hear(CAMERA)
    assert site.restarts == []


def test_one_that_never_dies_is_replaced_and_does_not_stop_supervision(site: Site) -> None:
    site.system.newest(CAMERA).immortal = True
    site.hear(CAMERA)
    site.after(15.0, MONITOR)
    stuck, successor = site.processes(CAMERA)
    assert (stuck.kills, stuck.is_alive()) == (1, True)
    assert successor.is_alive()
    assert site.restarts == [("cam", "camera", "stuck")]
    assert len(site.processes(MONITOR)) == 1
    stuck.end(-9)
    site.supervisor.watch()
    assert stuck.closed


def test_no_more_than_so_many_undead_of_a_task(site: Site) -> None:
    site.system.newest(CAMERA).immortal = True
    site.system.immortal.add(CAMERA)
    site.after(600.0, MONITOR)
    assert len(site.processes(CAMERA)) == MOST_UNDEAD
    assert site.of(CAMERA) is None
    assert len(site.processes(MONITOR)) == 1
    site.processes(CAMERA)[0].end(-9)
    site.after(1.0, MONITOR)
    assert len(site.processes(CAMERA)) == MOST_UNDEAD + 1


def test_gauges_of_the_silent_are_not_shown_and_those_of_the_gone_neither(site: Site) -> None:
    def level() -> float | None:
        return next((s.value for f in site.relay.collect() for s in f.samples if s.name == "level"), None)

    site.hear(CAMERA)
    assert level() == 0.5
    site.after(4.0)
    assert level() is None
    site.hear(CAMERA)
    assert level() == 0.5
    site.system.newest(CAMERA).end(0)
    site.supervisor.watch()
    assert level() is None


def test_what_one_says_last_is_heard(site: Site) -> None:
    site.system.report(CAMERA, state="stopped")
    site.system.newest(CAMERA).end(0)
    assert site.supervisor.stop() == ()
    report = site.of(CAMERA)
    assert report is not None
    assert report.state == "stopped"


def test_after_a_pause_of_the_daemon_itself_workers_are_heard_before_they_are_judged(site: Site) -> None:
    site.hear(CAMERA)
    site.system.clock.now_s += 30.0
    site.supervisor.watch()
    assert site.restarts == []
    site.after(2.0)
    assert site.restarts == [("cam", "camera", "stuck")]


def test_stopping_asks_then_kills_then_gives_up(site: Site) -> None:
    site.system.newest(MONITOR).immortal = True
    begun = site.system.clock.now_s
    assert site.supervisor.stop(within_s=2.0) == (MONITOR,)
    assert site.system.clock.now_s - begun <= 5.0
    assert [site.system.newest(name).kills for name in (CAMERA, MONITOR)] == [1, 1]
    assert site.system.newest(MONITOR).line.recv() == "stop"
