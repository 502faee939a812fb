"""The supervisor with real worker processes: starts again, kills the stuck, stops in bounded time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

from lumpwatch.service.runtime.supervisor import Supervisor, Task
from lumpwatch.service.telemetry.daemon_connection import Report
from lumpwatch.service.telemetry.relay import Relay
from tests import workers

PATIENCE_S = 60.0


class Site:
    """A supervisor with one worker, and what it said."""

    def __init__(self, target: Callable[..., None], *arguments: str, stuck_after_s: float = 30.0) -> None:
        self.relay = Relay()
        self.restarts: list[tuple[str, str, str]] = []
        task = Task("cam", "monitor", target, arguments, stuck_after_s)
        self.supervisor = Supervisor([task], self.relay, lambda *told: self.restarts.append(told))

    def until(self, condition: Callable[[], object]) -> None:
        """Watch, as the daemon does, until the condition holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, "what was waited for did not come"
            self.supervisor.watch()
            time.sleep(0.02)

    @property
    def report(self) -> Report | None:
        return self.supervisor.reports()["monitor", "cam"]

    def state(self) -> str | None:
        return self.report.state if self.report else None

    def total(self, sample: str) -> float | None:
        """Value of a sample as Prometheus would scrape it."""
        found = [s.value for family in self.relay.collect() for s in family.samples if s.name == sample]
        assert len(found) <= 1
        return found[0] if found else None


def children() -> list[int]:
    return [child.pid for child in multiprocessing.active_children() if child.pid]


@pytest.fixture
def started() -> Iterator[list[Site]]:
    """Sites that are stopped at the end whatever happens; no process is left over."""
    sites: list[Site] = []
    yield sites
    for one in sites:
        one.supervisor.stop(within_s=0.0)
    assert children() == []


@pytest.mark.slow
def test_a_worker_runs_reports_and_stops(started: list[Site]) -> None:
    site = Site(workers.good)
    started.append(site)
    assert site.supervisor.reports() == {("monitor", "cam"): None}
    site.until(lambda: site.state() == "running")
    assert site.total("worked_total") == 3.0
    assert site.total("level") == 0.5
    assert site.report is not None
    assert list(site.report.decided) == ["apron"]
    beat = site.report.beat_s
    site.until(lambda: site.report and site.report.beat_s > beat)
    site.supervisor.stop(within_s=PATIENCE_S)
    assert site.restarts == []
    assert children() == []


@pytest.mark.slow
def test_what_a_worker_says_last_is_heard(started: list[Site]) -> None:
    site = Site(workers.good)
    started.append(site)
    site.until(lambda: site.state() == "running")
    site.supervisor.stop(within_s=PATIENCE_S)
    assert site.state() == "stopped"
    assert site.total("stopped_total") == 1.0


@pytest.mark.slow
def test_a_worker_that_ends_is_started_again_and_its_counters_go_on(
    started: list[Site], tmp_path: Path
) -> None:
    end = tmp_path / "end"
    site = Site(workers.passing, str(end))
    started.append(site)
    site.until(lambda: site.total("worked_total") == 3.0)
    end.touch()
    site.until(lambda: site.restarts)
    assert site.restarts == [("cam", "monitor", "exited")]
    assert site.total("level") is None
    assert site.report is None
    site.until(lambda: site.state() == "running")
    assert site.total("worked_total") == 6.0
    assert site.total("level") == 0.5
    assert site.restarts == [("cam", "monitor", "exited")]


@pytest.mark.slow
def test_pauses_between_starts_grow(started: list[Site]) -> None:
    site = Site(workers.failing)
    started.append(site)
    ends: list[float] = []

    def three() -> bool:
        if len(site.restarts) > len(ends):
            ends.append(time.monotonic())
        return len(ends) == 3

    site.until(three)
    assert site.restarts == [("cam", "monitor", "exited")] * 3
    assert ends[1] - ends[0] >= 0.5
    assert ends[2] - ends[1] >= 1.0


@pytest.mark.slow
def test_a_killed_worker_is_started_again(started: list[Site]) -> None:
    site = Site(workers.good)
    started.append(site)
    site.until(lambda: site.state() == "running")
    (victim,) = children()
    os.kill(victim, signal.SIGKILL)
    site.until(lambda: site.restarts)
    site.until(lambda: site.state() == "running")
    assert site.restarts == [("cam", "monitor", "exited")]
    assert site.total("worked_total") == 6.0
    assert children() != [victim]


@pytest.mark.slow
def test_a_worker_that_hangs_is_killed_and_started_again(started: list[Site], tmp_path: Path) -> None:
    site = Site(workers.hanging, str(tmp_path / "once"), stuck_after_s=1.0)
    started.append(site)
    site.until(lambda: site.report)
    (victim,) = children()
    site.until(lambda: site.restarts)
    assert site.restarts == [("cam", "monitor", "stuck")]
    site.until(lambda: victim not in children())
    site.until(lambda: site.state() == "running")
    assert site.total("worked_total") == 6.0


@pytest.mark.slow
def test_the_gauges_of_a_worker_that_is_silent_are_not_shown(started: list[Site]) -> None:
    site = Site(workers.good)
    started.append(site)
    site.until(lambda: site.total("level") == 0.5)
    (victim,) = children()
    os.kill(victim, signal.SIGSTOP)
    site.until(lambda: site.total("level") is None)
    assert site.total("worked_total") == 3.0
    assert site.restarts == []
    os.kill(victim, signal.SIGCONT)
    site.until(lambda: site.total("level") == 0.5)


@pytest.mark.slow
def test_a_first_start_may_take_longer_than_a_hang(started: list[Site]) -> None:
    site = Site(workers.compiling, stuck_after_s=0.5)
    started.append(site)
    site.until(lambda: site.state() == "running")
    assert site.restarts == []


@pytest.mark.slow
@pytest.mark.parametrize("target", [workers.deaf, workers.mute, workers.stubborn, workers.broken_off])
def test_stopping_takes_bounded_time(started: list[Site], target: Callable[..., None]) -> None:
    site = Site(target)
    started.append(site)
    site.supervisor.watch()
    if target not in (workers.mute, workers.broken_off):
        site.until(lambda: site.report)
    begun = time.monotonic()
    site.supervisor.stop(within_s=1.0)
    assert time.monotonic() - begun < 10.0
    assert children() == []


@pytest.mark.slow
def test_a_worker_that_breaks_off_in_a_message_holds_up_nobody(started: list[Site]) -> None:
    relay = Relay()
    tasks = [
        Task("bad", "camera", workers.broken_off, (), 30.0),
        Task("cam", "monitor", workers.good, (), 30.0),
    ]
    site = Site(workers.good)
    site.supervisor, site.relay = Supervisor(tasks, relay, lambda *told: None), relay
    started.append(site)
    site.until(lambda: site.state() == "running")


def test_stopping_what_never_ran_is_nothing() -> None:
    Site(workers.good).supervisor.stop()


# The worker's end of the line


def _next(daemon: Connection) -> Report:
    assert daemon.poll(PATIENCE_S)
    report = daemon.recv()
    assert isinstance(report, Report)
    return report


def _orphan(connection: Connection) -> None:
    """A daemon that starts a worker and dies without a word."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    worker = context.Process(target=workers.stubborn, args=(theirs,))
    worker.start()
    theirs.close()
    _next(ours)
    connection.send(worker.pid)
    time.sleep(600)


@pytest.mark.slow
def test_a_worker_whose_daemon_dies_ends_by_itself() -> None:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    daemon = context.Process(target=_orphan, args=(theirs,))
    daemon.start()
    assert ours.poll(PATIENCE_S)
    worker = ours.recv()
    assert _lives(worker)
    daemon.kill()
    daemon.join()
    deadline = time.monotonic() + PATIENCE_S
    while _lives(worker):
        assert time.monotonic() < deadline, "the worker lives on"
        time.sleep(0.1)


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False
