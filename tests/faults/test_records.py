"""Faults of processes, bus, clocks and disks: what becomes of the alarms.

Most happen to one daemon, which is a client of a hub in a process of its own; its store is a small file
system where that can be had.
"""

from __future__ import annotations

import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import pytest

from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.event_log_reader import read_events
from tests.bus.test_bus_support import Child, free_endpoint
from tests.bus.tokens import Tokens
from tests.faults.lumps import CAM, Lumps, start
from tests.faults.outside import KEYS, NOTICED_S, PATIENCE_S, ROI
from tests.faults.table import Record, Row
from tests.integration.site import AlarmFollower, wait_for
from tests.storage.test_event_log import event

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

RECOVERED_S = 20.0
STARTED_S = 180.0  # four monitors at once, on a machine that does other things too
DELIVERED_S = 2.0
FAKETIME = next(Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)
EVENTS_BEFORE = 60
HOUR_S = 3600.0


def truncated(path: Path) -> None:
    os.truncate(path, path.stat().st_size * 2 // 3)


def headless(path: Path) -> None:
    with path.open("r+b") as file:
        file.write(b"garbage!" * 128)


def torn(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(path.stat().st_size // 2 // 4096 * 4096)
        file.write(b"\xa5" * 8192)


DAMAGE = {"truncated": truncated, "headless": headless, "torn": torn}
DONE = {
    "truncated": "cut to two thirds before the start",
    "headless": "the first KiB overwritten with garbage before the start",
    "torn": "8 KiB of garbage in the middle before the start",
}


class Disk:
    """The store: a small file system where one can be mounted, else an ordinary folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self.mounted = self._mount("-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder))

    def _mount(self, *arguments: str) -> bool:
        return subprocess.run(["mount", *arguments], capture_output=True, check=False).returncode == 0

    @contextmanager
    def full(self) -> Iterator[None]:
        """Not a byte is free."""
        filler = self.folder / "filler"
        with filler.open("wb", buffering=0) as file:
            for size in (1 << 20, 4096, 1):
                try:
                    while True:
                        file.write(bytes(size))
                except OSError:
                    continue
        try:
            yield
        finally:
            filler.unlink()

    @contextmanager
    def read_only(self) -> Iterator[None]:
        """Whoever opens a file now cannot write it; those that are open stay as they are."""
        assert self._mount("--bind", str(self.folder), str(self.folder))
        assert self._mount("-o", "remount,bind,ro", str(self.folder))
        try:
            yield
        finally:
            subprocess.run(["umount", "-l", self.folder], check=True)

    def close(self) -> None:
        """Unmount."""
        if self.mounted:
            subprocess.run(["umount", "-l", self.folder], check=False)


class WallClock:
    """That of the daemon's processes, by libfaketime."""

    def __init__(self, folder: Path, library: Path) -> None:
        self._file = folder / "faketime"
        self.step(0.0)
        self.environment = {
            "LD_PRELOAD": str(library),
            "FAKETIME_TIMESTAMP_FILE": str(self._file),
            "FAKETIME_CACHE_DURATION": "1",
            "FAKETIME_DONT_FAKE_MONOTONIC": "1",
        }

    def step(self, offset_s: float) -> None:
        """So far from the true time."""
        self._file.write_text(f"{offset_s:+.0f}\n")


@dataclass
class Site(Lumps):
    """That of most tests: with a hub of its own and a disk that can be made full."""

    hub: Child
    endpoint: str
    disk: Disk
    damage_told_s: dict[str, float] = field(default_factory=dict)
    """By camera: from the start of the daemon."""


def damage_logs(store: Path) -> None:
    """Each of the cameras that are named after a damage has an event log with it."""
    for name, damage in DAMAGE.items():
        log = EventLog(event_file(store, name))
        log.append([Entry(event(k, reason="x" * 300), b"{}") for k in range(EVENTS_BEFORE)])
        log.close()
        damage(event_file(store, name))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("records")
    with ExitStack() as stack:
        disk = Disk(folder / "var")
        stack.callback(disk.close)
        endpoint = free_endpoint()
        hub = Child("hub", endpoint)
        bus = f'mode: client, connect: ["{endpoint}"]'
        daemon, outside, feeds = start(stack, folder, (CAM, *DAMAGE), bus, damage_logs)
        made = Site(daemon, outside, feeds, disk.folder, hub, endpoint, disk)
        began = time.monotonic()
        for name in DAMAGE:

            def told(name: str = name) -> bool:
                return made.problems("corrupt", name) == 1

            wait_for("damage told", told, PATIENCE_S)
            made.damage_told_s[name] = time.monotonic() - began
        for name in feeds:
            outside.sees(name, 0.0)
        stack.callback(lambda: made.hub.__exit__())
        yield made
        assert daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()


@pytest.mark.parametrize("of", DAMAGE)
def test_the_event_log_is_corrupt(site: Site, record: Record, of: str) -> None:
    """It starts, says so, and detects."""
    (aside,) = event_file(site.store, of).parent.glob(f"{of}.sqlite.corrupt-*[0-9]")
    assert f"was moved to {aside.name}" in site.daemon.log.read_text()
    assert aside.stat().st_size > 0
    _, announced = site.lump(of)
    record(
        Row(
            f"event log corrupt: {of}", DONE[of],
            "`lumpwatch_event_log_problems_total{reason=\"corrupt\"}` and an error in the log; counted from the start",
            site.damage_told_s[of], STARTED_S, site.outside.lost(site.store, of),
            "the file is moved aside, a new one begins; a lump is announced after its appearance in",
            announced, NOTICED_S,
        )
    )  # fmt: skip


def test_the_monitor_is_killed_while_there_is_a_lump(site: Site, record: Record) -> None:
    outside, feed = site.outside, site.feeds[CAM]
    began = time.monotonic()
    feed.bright = True
    outside.wait(CAM, "UNACKNOWLEDGED", since_s=began)
    raised = outside.raised(CAM, began)
    with Tokens(site.endpoint, KEYS.alive("monitor", CAM)) as tokens:
        wait_for("token there", lambda: tokens.events, 30)
        killed = site.kill_monitor()
        wait_for("token gone", lambda: any(not there for _, there in tokens.events), 30)
        noticed = time.monotonic() - killed
    back = outside.wait(CAM, "UNACKNOWLEDGED", since_s=killed + noticed)
    assert back.sequence == raised["data"]["sequence"]
    seen = outside.sees(CAM, killed + noticed)
    feed.bright = False
    # Still latched: it waits until someone acknowledges.
    outside.wait(CAM, "RETURNED", since_s=seen.at_s)
    site.acknowledge()
    outside.wait(CAM, "NORMAL", since_s=seen.at_s)
    # Between its last word and the first decision of its successor nobody said CLEAR.
    told = [one.state for one in outside.since(CAM, raised["arrived_s"]) if one.at_s <= seen.at_s]
    assert "CLEAR" not in told
    record(
        Row(
            "monitor killed while LUMP", "SIGKILL", "its liveliness token is gone (levels are valid for 3 s)",
            noticed, NOTICED_S, outside.lost(site.store, CAM),
            "started again after 0.5 s, alarm latched as before, same sequence", seen.at_s - killed, RECOVERED_S,
        )
    )  # fmt: skip


def test_the_monitor_hangs(site: Site, record: Record) -> None:
    pid = site.daemon.worker("monitor", CAM)
    os.kill(pid, signal.SIGSTOP)
    stopped = time.monotonic()
    wait_for("not ready", lambda: f"{CAM}/{ROI}" in site.daemon.get("/readyz")[1], 30)
    wait_for(
        "its gauges are gone", lambda: not site.daemon.shows("lumpwatch_roi_blind", camera=CAM, roi=ROI), 20
    )
    noticed = time.monotonic() - stopped
    os.kill(pid, signal.SIGCONT)
    resumed = time.monotonic()
    before = site.outside.since(CAM, 0.0)[-1].frame
    seen = wait_for(
        "decides on new frames",
        lambda: next((one for one in site.outside.since(CAM, resumed) if one.frame > before), None),
        PATIENCE_S,
    )
    record(
        Row(
            "monitor hangs", "SIGSTOP; SIGCONT once it was noticed",
            "`/readyz` names the region, then its gauges vanish from the metrics", noticed, 2 * NOTICED_S,
            site.outside.lost(site.store, CAM), "goes on; after 10 s it would be killed and started again",
            seen.at_s - resumed, RECOVERED_S,
        )
    )  # fmt: skip


def test_the_hub_is_killed(site: Site, record: Record) -> None:
    """Frames pass the hub too, so what is raised while it is away is the alarm that the region is blind."""
    outside = site.outside
    first = outside.since(CAM, 0.0)[-1].sequence
    noticed: list[float] = []
    watching = threading.Thread(target=lambda: noticed.append(_blind_in_metrics(site)))
    site.hub.process.kill()
    site.hub.process.wait()
    killed = time.monotonic()
    watching.start()
    watching.join()
    wait_for(
        "blind alarm raised meanwhile",
        lambda: site.daemon.metric("lumpwatch_alarm_active", camera=CAM, **{"class": "blind"}) == 1,
        20,
    )
    time.sleep(1.0)
    assert outside.since(CAM, killed + 0.5) == []
    returned = time.monotonic()
    site.hub = Child("hub", site.endpoint)
    seen = outside.sees(CAM, returned)
    site.lump()
    lost = outside.lost(site.store, CAM)
    changes = [
        (one["data"]["class"], one["data"]["change"])
        for one in outside.records[CAM]
        if one["data"]["sequence"] > first
    ]
    assert changes[:1] == [("blind", "raised")]
    assert ("blind", "cleared") in changes
    record(
        Row(
            "zenoh router killed", "SIGKILL; started again after the alarms of class blind were raised",
            "BLIND (no_stream) in the metrics", noticed[0] - killed, NOTICED_S, lost,
            "all processes and subscribers connect by themselves, records missed are fetched",
            seen.at_s - returned, RECOVERED_S,
        )
    )  # fmt: skip


def _blind_in_metrics(site: Site) -> float:
    wait_for("blind", lambda: site.daemon.metric("lumpwatch_roi_blind", camera=CAM) == 1, 20)
    return time.monotonic()


def test_the_hub_and_the_monitor_are_killed(site: Site, record: Record) -> None:
    """What was raised while there was no hub must not be lost with the process that raised it."""
    outside = site.outside
    site.hub.process.kill()
    site.hub.process.wait()
    killed = time.monotonic()
    noticed = _blind_in_metrics(site) - killed
    wait_for(
        "blind alarm raised meanwhile",
        lambda: site.daemon.metric("lumpwatch_alarm_active", camera=CAM, **{"class": "blind"}) == 1,
        20,
    )
    wait_for(
        "it is in the log", lambda: list(read_events(event_file(site.store, CAM)))[-1].change == "raised", 20
    )
    site.kill_monitor()
    returned = time.monotonic()
    site.hub = Child("hub", site.endpoint)
    seen = outside.sees(CAM, returned)
    site.lump()
    record(
        Row(
            "router and monitor killed", "SIGKILL of the router, then of the monitor, which had raised an alarm",
            "BLIND (no_stream) in the metrics", noticed, NOTICED_S, outside.lost(site.store, CAM),
            "what no router was there for is sent again by the next monitor", seen.at_s - returned, RECOVERED_S,
        )
    )  # fmt: skip


def test_subscribers_that_come_late_or_sleep(site: Site, record: Record, tmp_path: Path) -> None:
    outside, config = site.outside, site.daemon.config
    with AlarmFollower(config, tmp_path / "sleeper.log") as sleeper:
        site.lump()
        wait_for("sleeper listens", lambda: sleeper.records(None), 30)
        sleeper.sleep()
        delays = [site.lump()[1] for _ in range(2)]
        last = outside.records[CAM][-1]["id"]
        assert not got(sleeper, last)
        woken = time.monotonic()
        sleeper.wake()
        with AlarmFollower(config, tmp_path / "late.log") as late:
            started = time.monotonic()
            wait_for("sleeper has caught up", lambda: got(sleeper, last), PATIENCE_S)
            awake = time.monotonic() - woken
            wait_for("late one has all", lambda: got(late, last), PATIENCE_S)
            joined = time.monotonic() - started
            time.sleep(0.5)
            ours = [one["id"] for one in outside.records[CAM]]
            lost = outside.lost(site.store, CAM)
            for follower in (sleeper, late):
                ids = [one["id"] for one in follower.records(None) if one["data"]["camera"] == CAM]
                assert ids == ours[-len(ids) :]
                assert len(ids) >= 9
    assert max(delays) <= DELIVERED_S
    record(
        Row(
            "subscriber sleeps", "`lumpwatch alarms` under SIGSTOP while two lumps came, then SIGCONT",
            "nothing: the others are told as before", None, None, lost, "it gets what it missed", awake, RECOVERED_S,
        )
    )  # fmt: skip
    record(
        Row(
            "subscriber comes late", "`lumpwatch alarms` started after the alarms", "nothing to notice", None, None,
            lost, "it gets the last 64 records of each region first", joined, RECOVERED_S,
        )
    )  # fmt: skip


def got(one: AlarmFollower, record: str) -> bool:
    """Whether it has printed the record of this id."""
    return any(found["id"] == record for found in one.records(None))


def test_a_subscriber_that_never_reads(site: Site, record: Record) -> None:
    """Its buffers are full: neither the filter nor the other subscribers may wait for it."""
    with Child("listen", site.endpoint, "lumpwatch/**") as deaf:
        os.kill(deaf.process.pid, signal.SIGSTOP)
        with open_client(as_client(load_config(site.daemon.config).bus)) as bus:
            bulk = bus.publisher("lumpwatch/v1/test/none/frame")
            for _ in range(100):  # more than sockets and queues hold
                bulk.put(bytes(1 << 20))
        began = time.monotonic()
        delays = [site.lump()[1] for _ in range(3)]
        assert all(one.state != "BLIND" for one in site.outside.since(CAM, began))
    record(
        Row(
            "subscriber never reads", "subscribed to everything, SIGSTOP, 100 MiB sent to it; then three lumps",
            "nothing: others are told as before; the slowest alarm, from the lump's appearance, came after",
            max(delays), DELIVERED_S, site.outside.lost(site.store, CAM), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_the_wall_clock_is_stepped(tmp_path: Path, record: Record) -> None:
    """A daemon of its own: libfaketime also breaks time.sleep, which only the end of a process uses."""
    if FAKETIME is None:
        pytest.skip("libfaketime is not installed (Debian has it)")
    clock = WallClock(tmp_path, FAKETIME)
    with ExitStack() as stack:
        daemon, outside, feeds = start(stack, tmp_path, (CAM,), environment=clock.environment)
        site = Lumps(daemon, outside, feeds, load_config(daemon.config).store.path)
        outside.sees(CAM, 0.0)
        assert abs(wrong_by(site)) < 10
        for name, offset in (("forward", HOUR_S), ("back", -HOUR_S)):
            began = time.monotonic()
            outside.act(KEYS.command(CAM, ROI, "shelve"), actor="Ada", reason="step", for_s="3")
            clock.step(offset)
            time.sleep(2.0)  # libfaketime looks once a second
            assert outside.since(CAM, 0.0)[-1].alarm == "SHELVED"
            freed = outside.wait(CAM, "NORMAL", since_s=began + 2.0).at_s - began
            assert 2.5 <= freed <= 3.0 + NOTICED_S  # by the monotonic clock
            assert abs(wrong_by(site) - offset) < 10
            assert all(one.state != "BLIND" for one in outside.since(CAM, began))
            record(
                Row(
                    f"wall clock stepped {name}", "to an hour from the truth, for all processes, in a shelving of 3 s",
                    "nothing but the times in the records; no time-out, delay or shelving is moved", None, None,
                    outside.lost(site.store, CAM), "nothing to recover from", None, None,
                )
            )  # fmt: skip


def wrong_by(site: Lumps) -> float:
    """How far the daemon's wall clock is from ours, as an alarm record has it."""
    began, delay = site.lump()
    assert delay <= DELIVERED_S
    arrived = site.outside.raised(CAM, began)
    ours = time.time() - (time.monotonic() - arrived["arrived_s"])
    return datetime.fromisoformat(arrived["time"]).timestamp() - ours


def test_the_disk_is_full(site: Site, record: Record) -> None:
    if not site.disk.mounted:
        pytest.skip("a full disk needs root: a small file system is mounted")
    outside = site.outside
    before = site.problems("unwritable")
    with site.disk.full():
        began = time.monotonic()
        delays = []
        while site.problems("unwritable") == before:  # some room is left in the journal's last page
            delays.append(site.lump()[1])
        noticed = time.monotonic() - began
        delays.append(site.lump()[1])
    freed = time.monotonic()
    wait_for("written after all", site.written, 30)
    recovered = time.monotonic() - freed
    assert max(delays) <= DELIVERED_S
    assert site.problems("lost") == 0
    record(
        Row(
            "disk full", "the store's file system filled to the last byte while lumps came",
            "`lumpwatch_event_log_problems_total{reason=\"unwritable\"}`; detection and bus go on", noticed, 10.0,
            outside.lost(site.store, CAM), "tried every 5 s; what waited in memory is written", recovered, RECOVERED_S,
        )
    )  # fmt: skip


def test_the_store_is_read_only(site: Site, record: Record) -> None:
    """A monitor that starts on it goes on with a latched alarm and announces new ones."""
    if not site.disk.mounted:
        pytest.skip("a read-only store needs root: it is mounted so")
    outside, feed = site.outside, site.feeds[CAM]
    began = time.monotonic()
    feed.bright = True
    raised = outside.raised(CAM, began)
    feed.bright = False
    outside.wait(CAM, "RETURNED", since_s=began)
    with site.disk.read_only():
        killed = site.kill_monitor()
        back = outside.wait(CAM, "RETURNED", since_s=killed)
        assert back.sequence == raised["data"]["sequence"] + 1
        noticed = time.monotonic() - killed
        outside.sees(CAM, killed)
        wait_for("counted", lambda: site.problems("unwritable") > 0, 20)
        site.acknowledge()
        site.lump()
    freed = time.monotonic()
    wait_for("written after all", site.written, 30)
    record(
        Row(
            "store read-only", "mounted read-only, the monitor killed and started on it with a latched alarm",
            "`lumpwatch_event_log_problems_total{reason=\"unwritable\"}`; alarm latched as before, detection goes on",
            noticed, RECOVERED_S, outside.lost(site.store, CAM), "tried every 5 s; what waited in memory is written",
            time.monotonic() - freed, RECOVERED_S,
        )
    )  # fmt: skip


def test_the_event_log_is_overwritten_while_it_is_open(site: Site, record: Record) -> None:
    outside, path = site.outside, event_file(site.store, CAM)
    pid = site.daemon.worker("monitor", CAM)
    began = time.monotonic()
    for damaged in (path, path.with_name(path.name + "-wal")):
        if damaged.exists():
            damaged.write_bytes(b"\xa5" * damaged.stat().st_size)
    first = outside.since(CAM, 0.0)[-1].sequence + 1
    delays = []
    while site.problems("corrupt") == 0:
        delays.append(site.lump()[1])
        assert time.monotonic() < began + 60.0
    noticed = time.monotonic() - began
    delays.append(site.lump()[1])
    wait_for("written", site.written, 30)
    assert site.daemon.worker("monitor", CAM) == pid
    assert len(list(path.parent.glob(f"{path.name}.corrupt-*[0-9]"))) == 1
    record(
        Row(
            "event log corrupt: in use", "file and journal overwritten with garbage while the monitor had them open",
            "`lumpwatch_event_log_problems_total{reason=\"corrupt\"}` and an error in the log", noticed, 10.0,
            outside.lost(site.store, CAM, first),
            "damaged file moved aside, a new one begins with the present state; the slowest alarm meanwhile",
            max(delays), DELIVERED_S,
        )
    )  # fmt: skip
