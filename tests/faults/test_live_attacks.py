"""Attacks on a running daemon by a program of this host that reaches its bus without TLS, its page or its store."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from lumpwatch.service.bus import codec
from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.ordering import stamp, stamped
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.protocol import COMMANDS
from lumpwatch.service.storage.event_log import event_file
from tests.attacks.mutations import mutated
from tests.bus.test_bus_support import Child
from tests.faults.lumps import CAM, Lumps, start
from tests.faults.outside import KEYS, NOTICED_S, ROI
from tests.faults.table import Record, Row
from tests.integration.feed import Feed
from tests.integration.site import wait_for
from tests.service_helpers import HEIGHT, WIDTH, frame, picture

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

RECOVERED_S = 20.0
DELIVERED_S = 2.0
READERS = 10
FILES = 256
"""The daemon may have so many files open when its page is flooded."""
ODD = 240
FORGED = 999_999_999_999_999_996


@dataclass
class Site(Lumps):
    """With the attacker's own session."""

    attacker: Bus

    def dropped(self, reason: str) -> float:
        return self.daemon.metric("lumpwatch_frames_dropped_total", camera=CAM, reason=reason)

    def lost(self) -> int:
        return self.outside.lost(self.store, CAM)

    def undisturbed(self, since_s: float) -> bool:
        """Whether nobody was told since then that the region is blind."""
        return all(one.state != "BLIND" for one in self.outside.since(CAM, since_s))

    def system_alarm(self, reason: str, since_s: float) -> float:
        """When the system alarm came for this reason."""

        def there() -> float | None:
            for one in list(self.outside.records.get(CAM, ())):
                data = one["data"]
                if one["arrived_s"] >= since_s and (data["class"], data["reason"]) == ("system", reason):
                    return float(one["arrived_s"])
            return None

        return float(wait_for(f"system alarm: {reason}", there, 30))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("attacks")
    with ExitStack() as stack:
        daemon, outside, feeds = start(stack, folder, (CAM,))
        config = load_config(daemon.config)
        attacker = stack.enter_context(open_client(as_client(config.bus)))
        outside.sees(CAM, 0.0)
        yield Site(daemon, outside, feeds, config.store.path, attacker)
        assert daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()


class Impostor:
    """Sends frames as if it were the camera: under the name that stands in every frame of it."""

    def __init__(self, site: Site) -> None:
        self._publisher = site.attacker.frame_publisher(KEYS.frame(CAM))
        self._name = site.feeds[CAM].name

    def send(self, one: Frame, forge: Callable[[bytes], bytes] = bytes) -> None:
        """One frame with a header that was forged."""
        payload, header = codec.encode_frame(one, self._publisher._clock, self._name)
        self._publisher._frames.put(payload, attachment=forge(header))


def dark(seq: int, capture_s: float) -> Frame:
    now = time.monotonic()
    return frame(seq, time_s=capture_s, received_s=now, data=picture(bright=False), size=(WIDTH, HEIGHT))


def test_frames_from_the_future(site: Site, record: Record) -> None:
    send = Impostor(site).send
    began = time.monotonic()

    def refused() -> bool:
        """A frame of the camera may take the place of one that was not looked at yet."""
        for ahead_s in (1.0, 3600.0, 1e8):
            send(dark(7, time.monotonic() + ahead_s))
        return site.dropped("future") >= 1

    wait_for("refused", refused, 20)
    noticed = time.monotonic() - began
    _, delay = site.lump()
    assert delay <= DELIVERED_S
    assert site.undisturbed(began)
    record(
        Row(
            "forged frames of the future", "sent under the camera's own name, up to three years ahead",
            "`lumpwatch_frames_dropped_total{reason=\"future\"}`; decisions go on, the next lump is announced",
            noticed, NOTICED_S, site.lost(), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_numbers_that_no_camera_reaches(site: Site, record: Record) -> None:
    """The largest number that a log can hold and one beyond, while a lump comes."""
    send = Impostor(site).send
    began = time.monotonic()

    def refused() -> bool:
        send(dark(7, began), lambda header: header.replace(b'"seq":7,', b'"seq":%d,' % (2**63 - 1)))
        return site.dropped("malformed_bad_header") >= 1

    wait_for("refused", refused, 20)
    noticed = time.monotonic() - began
    send(dark(2**53 - 1, time.monotonic()))
    site.lump()
    wait_for("written", site.written, 30)
    assert site.problems("failed") == 0
    record(
        Row(
            "forged frame numbers", "2^63 - 1, which no log would take, and 2^53 - 1, the largest that is taken",
            "`lumpwatch_frames_dropped_total{reason=\"malformed_bad_header\"}`; the log goes on",
            noticed, NOTICED_S, site.lost(), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_a_second_camera_of_the_same_name(site: Site, record: Record) -> None:
    """A copied configuration: it shows no lump while the camera does."""
    began = time.monotonic()
    with Feed(site.attacker):
        noticed = site.system_alarm("second_source", began) - began
        _, delay = site.lump()
    assert delay <= DELIVERED_S
    assert site.undisturbed(began)
    record(
        Row(
            "second publisher of a camera's frames", "20 frames a second without a lump, under the same key",
            "system alarm `second_source`; its frames are refused, lumps of the first are announced",
            noticed, NOTICED_S, site.lost(), "alarm over once it is silent for 10 s", None, None,
        )
    )  # fmt: skip


def test_readers_that_do_not_read(site: Site, record: Record) -> None:
    """Their connections are full, and the daemon's own hub is in the way."""
    cut = {"reason": "slow"}
    before = site.daemon.metric("lumpwatch_bus_sessions_cut_off_total", **cut)
    (endpoint,) = load_config(site.daemon.config).bus.listen
    with Child("listen", endpoint, "lumpwatch/**", str(READERS)) as frozen:
        os.kill(frozen.process.pid, signal.SIGSTOP)
        began = time.monotonic()
        bulk = site.attacker.publisher("lumpwatch/v1/test/none/frame")
        for _ in range(40):  # more than sockets and queues hold
            bulk.put(bytes(1 << 20))
        delays = [site.lump()[1] for _ in range(2)]
        wait_for(
            "cut off",
            lambda: site.daemon.metric("lumpwatch_bus_sessions_cut_off_total", **cut) - before >= READERS,
            60,
        )
        noticed = time.monotonic() - began
    assert site.undisturbed(began)
    record(
        Row(
            f"{READERS} readers that never read", "plain TCP, subscribed to everything, SIGSTOP, 40 MiB for each",
            "`lumpwatch_bus_sessions_cut_off_total{reason=\"slow\"}` counts all; slowest alarm meanwhile "
            f"{max(delays):.1f} s (limit {DELIVERED_S:g}) after the lump's appearance",
            noticed, 60.0, site.lost(), "nothing to recover from", None, None,
        )
    )  # fmt: skip
    assert max(delays) <= DELIVERED_S


def test_a_forged_alarm_record(site: Site, record: Record) -> None:
    """It has the publisher's own name and a number that leaps ahead: who follows must miss nothing that comes."""
    key = KEYS.alarm(CAM, ROI)
    site.lump()
    real = site.attacker._recent(key)[-1]
    forged: dict[str, Any] = json.loads(real.payload) | {"id": "forged"}
    seen: list[str] = []
    missed: list[int] = []
    with open_client(as_client(load_config(site.daemon.config).bus)) as bus:
        bus.subscribe_alarms(key, lambda _, payload: seen.append(json.loads(payload)["id"]), missed.append)
        session = site.attacker._session
        session.put(key, json.dumps(forged).encode(), attachment=stamp(real.publisher, FORGED))
        assert stamped(key, b"", stamp(real.publisher, FORGED)).number == FORGED
        wait_for("the forged record is shown", lambda: "forged" in seen, 20)
        began = time.monotonic()
        site.lump()
        told = site.outside.raised(CAM, began)
        wait_for("the real one comes", lambda: told["id"] in seen, 20)
        noticed = told["arrived_s"] - began
    assert missed == []
    site.outside.records[CAM] = [one for one in site.outside.records[CAM] if one["id"] != "forged"]
    record(
        Row(
            "forged alarm record", f"under the monitor's own name, number {FORGED}",
            "shown like any other and moves nothing; the next real one comes, after the lump's appearance, in",
            noticed, DELIVERED_S, site.lost(), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_the_event_log_is_removed(site: Site, record: Record) -> None:
    """A clean-up took its folder away; then the monitor is killed."""
    site.lump()
    wait_for("written", site.written, 30)
    began = time.monotonic()
    site.feeds[CAM].bright = True
    site.outside.raised(CAM, began)
    shutil.rmtree(event_file(site.store, CAM).parent)
    removed = time.monotonic()
    wait_for("counted", lambda: site.problems("removed") >= 1, 30)
    noticed = time.monotonic() - removed
    site.system_alarm("event_log", removed)
    wait_for("put back", site.written, 30)
    last = site.outside.since(CAM, 0.0)[-1].sequence
    killed = site.kill_monitor()
    back = site.outside.wait(CAM, "UNACKNOWLEDGED", since_s=killed)
    assert back.sequence >= last
    seen = site.outside.sees(CAM, killed)
    site.feeds[CAM].bright = False
    site.outside.wait(CAM, "RETURNED", since_s=seen.at_s)
    site.acknowledge()
    record(
        Row(
            "event log removed", "its folder deleted while a lump's alarm stands; then SIGKILL of the monitor",
            "`lumpwatch_event_log_problems_total{reason=\"removed\"}`, system alarm `event_log`", noticed, 15.0,
            site.lost(), "put back with all that it held; alarm and sequence as before after the restart",
            seen.at_s - killed, RECOVERED_S,
        )
    )  # fmt: skip


def test_slow_clients_of_the_page(site: Site, record: Record) -> None:
    """More than the daemon may have files open; then the monitor dies and has to be started anew."""
    assert site.daemon.process is not None
    resource.prlimit(site.daemon.process.pid, resource.RLIMIT_NOFILE, (FILES, FILES))
    began = time.monotonic()
    with contextlib.ExitStack() as stack:
        for _ in range(FILES + 50):
            one = stack.enter_context(socket.create_connection(("127.0.0.1", site.daemon.port), timeout=5))
            with contextlib.suppress(OSError):
                one.sendall(b"GET /metrics HTTP/1.1\r\nX-Slow: ")
        killed = site.kill_monitor()
        seen = site.outside.sees(CAM, killed)
        site.lump()
        assert site.daemon.process.poll() is None
    wait_for("the page answers", lambda: site.daemon.ready, 40)
    record(
        Row(
            "slow HTTP clients",
            f"{FILES + 50} requests that never end at a limit of {FILES} files; SIGKILL of the monitor",
            "connections beyond 32 are refused, the others ended after 20 s", None, None, site.lost(),
            "the daemon starts the monitor again", seen.at_s - killed, RECOVERED_S,
        )
    )  # fmt: skip
    assert time.monotonic() - began < 120


def test_odd_commands(site: Site, record: Record) -> None:
    """What is nearly a command, at every door that changes nothing for good."""
    rng = np.random.default_rng(18)
    names = ("ack", "reset", "unshelve", "verdict", "evidence", "prior")
    monitor, began = site.daemon.worker("monitor", CAM), time.monotonic()
    refused = 0
    for number in range(ODD):
        name = names[number % len(names)]
        text = json.dumps(COMMANDS[name].example.model_dump(mode="json", by_alias=True)).encode()
        replies = site.attacker.ask(KEYS.command(CAM, ROI, name), payload=mutated(text, rng), timeout_s=20.0)
        assert replies, "nobody answers"
        refused += replies[0].payload is None
    assert refused > ODD / 2
    took = time.monotonic() - began
    site.lump()
    assert site.daemon.worker("monitor", CAM) == monitor
    assert "Traceback" not in site.daemon.log.read_text()
    record(
        Row(
            "odd commands", f"{ODD} that are nearly right, in {took:.1f} s",
            f"each is answered, {refused} with one line of error; no traceback, the next lump is announced", None, None,
            site.lost(), "nothing to recover from", None, None,
        )
    )  # fmt: skip


def test_the_daemons_own_hub_is_killed(site: Site, record: Record) -> None:
    """The hub is a process of the daemon: it comes back at the same address, and so does everybody."""
    outside = site.outside
    hub = site.daemon.worker("hub")
    os.kill(hub, signal.SIGKILL)
    killed = time.monotonic()
    wait_for("a new hub", lambda: site.daemon.worker("hub") != hub, 20)
    noticed = time.monotonic() - killed
    seen = outside.sees(CAM, time.monotonic())
    site.lump()
    restarts = site.daemon.metric("lumpwatch_worker_restarts_total", process="hub", reason="exited")
    assert restarts == 1
    record(
        Row(
            "hub's process killed", "SIGKILL of the daemon's process that routes for all",
            "`lumpwatch_worker_restarts_total{process=\"hub\"}`, an error in the log", noticed, NOTICED_S, site.lost(),
            "started again at the same address; all sessions join again, records missed are fetched",
            seen.at_s - killed, RECOVERED_S,
        )
    )  # fmt: skip
