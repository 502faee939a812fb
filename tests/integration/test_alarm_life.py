"""Alarms of a real daemon whose camera is this test: restarts, operators, the plant, the event log."""

from __future__ import annotations

import csv
import io
import json
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from lumpwatch.service.bus.client import Bus
from lumpwatch.service.bus.keys import Keys
from lumpwatch.service.bus.session import open_client
from lumpwatch.service.cli.alarms import as_client
from lumpwatch.service.config import load_config
from lumpwatch.service.core.alarm import Alarm
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.prior_store import PriorStore
from tests.integration.feed import Feed
from tests.integration.site import AlarmFollower, Daemon, wait_for
from tests.protocol.test_messages import EVENT
from tests.service_helpers import prior, site_tree
from tests.storage.test_event_log import event

pytestmark = pytest.mark.slow

KEYS = Keys("test")
TARGET = ("--camera", "cam", "--roi", "apron", "--actor", "Ada")


class Site:
    """A daemon with its camera and what can be seen of it from outside."""

    def __init__(self, daemon: Daemon, bus: Bus, feed: Feed, follower: AlarmFollower) -> None:
        self.daemon = daemon
        self.bus = bus
        self.feed = feed
        self.follower = follower
        self.killed = False
        """Whether a test has killed the daemon itself."""

    def state(self) -> dict[str, Any]:
        return self._one(KEYS.state("cam", "apron"))

    def level(self) -> dict[str, Any]:
        return self._one(KEYS.level("cam", "apron"))

    def _one(self, key: str) -> dict[str, Any]:
        replies = [reply.payload for reply in self.bus.ask(key) if reply.payload is not None]
        return json.loads(replies[-1]) if replies else {}

    def wait_alarm(self, state: str, of: str = "alarm") -> dict[str, Any]:
        def there() -> dict[str, Any] | None:
            found = self.state()
            return found if found.get(of) == state else None

        found: dict[str, Any] = wait_for(f"{of} {state}", there, 30)
        return found

    def changes(self, count: int) -> list[tuple[int, str, str]]:
        """Sequence, change and state after it of the first records, once there are so many."""
        records = wait_for(
            f"{count} records", lambda: (r := self.follower.records(None))[count - 1 :] and r, 30
        )
        return [(one["data"]["sequence"], one["data"]["change"], one["data"]["state"]) for one in records]

    def kill_monitor(self) -> None:
        (pid,) = self.daemon.children()["monitor"]
        restarts = self.daemon.metric("lumpwatch_worker_restarts_total")
        os.kill(pid, signal.SIGKILL)
        wait_for("restart", lambda: self.daemon.metric("lumpwatch_worker_restarts_total") == restarts + 1, 20)
        wait_for("decides again", lambda: self.state().get("state") in ("CLEAR", "LUMP"), 60)
        wait_for("is watched again", lambda: self.daemon.ready, 20)

    def command(self, *arguments: str, code: int = 0) -> str:
        done = self.daemon.command(*arguments[0].split(), str(self.daemon.config), *arguments[1:])
        assert done.returncode == code, done.stderr
        assert "Traceback" not in done.stderr
        return done.stdout if code == 0 else done.stderr

    def events(self) -> list[dict[str, Any]]:
        text = self.command("events", "--format", "jsonl")
        return [json.loads(line) for line in text.splitlines()]


@contextmanager
def running(
    folder: Path,
    learning: dict[str, Any] | None = None,
    latency: dict[str, float] | None = None,
    more: str = "",
    **alarm: Any,
) -> Iterator[Site]:
    """`more` is added to the configuration."""
    camera = site_tree()["cameras"][0] | ({"latency": latency} if latency else {})
    camera["rois"][0]["learning"] = learning or {}
    camera["rois"][0]["alarm"] |= alarm
    daemon = Daemon(folder, f"  - {json.dumps(camera)}\n{more}")
    daemon.roles = ("--only", "monitor")
    config = load_config(daemon.config)
    PriorStore(config.store.path).save(prior())
    with (
        daemon,
        open_client(as_client(config.bus)) as bus,
        Feed(bus) as feed,
        AlarmFollower(daemon.config, folder / "alarms.log") as follower,
    ):
        wait_for("ready", lambda: daemon.ready, 60)
        wait_for("follower", lambda: _listens(bus), 20)
        site = Site(daemon, bus, feed, follower)
        yield site
        assert site.killed or daemon.stop()[0] == 0
    assert "Traceback" not in daemon.log.read_text()


def _listens(bus: Bus) -> bool:
    return bool(bus.ask(KEYS.state("cam", "apron")))


def test_a_monitor_that_is_killed_goes_on_with_its_alarms(tmp_path: Path) -> None:
    with running(tmp_path, off_delay_s=4.0, blind={"on_delay_s": 60.0}) as site:
        site.feed.bright = True
        before = site.wait_alarm("UNACKNOWLEDGED")
        assert (before["state"], before["sequence"]) == ("LUMP", 1)
        site.kill_monitor()
        after = site.state()
        assert (after["state"], after["alarm"], after["sequence"]) == ("LUMP", "UNACKNOWLEDGED", 1)

        site.feed.bright = False
        site.wait_alarm("RETURNED")
        site.kill_monitor()
        assert (site.state()["state"], site.state()["alarm"]) == ("CLEAR", "RETURNED")
        assert site.command("ack", *TARGET) == "cam/apron lump: acknowledged, now NORMAL\n"
        site.kill_monitor()
        assert site.state()["alarm"] == "NORMAL"

        # Who comes only now sees what happened before the restarts, as it was.
        with AlarmFollower(site.daemon.config, tmp_path / "late.log") as late:
            wait_for("late joiner", lambda: len(late.records(None)) >= 4, 30)
            site.changes(4)
            assert late.records(None) == site.follower.records(None)

        # Over four lives of the monitor: one record each, in order, on the bus and in the log; and it tells of them.
        records = [one["data"] for one in site.follower.records(None)]
        assert [one["sequence"] for one in records] == list(range(1, len(records) + 1))
        of_lumps = [(one["change"], one["state"]) for one in records if one["class"] == "lump"]
        assert of_lumps == [("raised", "UNACKNOWLEDGED"), ("cleared", "RETURNED"), ("acknowledged", "NORMAL")]
        assert any("restarts" in one["reason"] for one in records if one["class"] == "system")
        events = site.events()
        assert [(one["sequence"], one["change"], one["after"]) for one in events] == [
            (one["sequence"], one["change"], one["state"]) for one in records
        ]
        assert [one["id"] for one in events] == [one["id"] for one in site.follower.records(None)]
        assert [one["actor"] for one in events if one["change"] == "acknowledged"] == ["Ada"]
        assert site.daemon.metric("lumpwatch_event_log_problems_total") == 0


def test_a_hub_that_is_killed_loses_no_alarm_and_blinds_the_region_meanwhile(tmp_path: Path) -> None:
    with running(tmp_path, off_delay_s=0.5, blind={"on_delay_s": 60.0}) as site:
        for kills, bright in ((1, True), (2, False)):
            (hub,) = site.daemon.children()["hub"]
            os.kill(hub, signal.SIGKILL)
            site.feed.bright = bright
            wait_for("blind", lambda: site.daemon.metric("lumpwatch_roi_blind") == 1, 20)

            def again(kills: int = kills) -> bool:
                return site.daemon.metric("lumpwatch_worker_restarts_total", process="hub") == kills

            wait_for("hub started again", again, 20)
            site.wait_alarm("UNACKNOWLEDGED" if bright else "RETURNED")
        site.command("ack", *TARGET)
        assert site.changes(3) == [
            (1, "raised", "UNACKNOWLEDGED"),
            (2, "cleared", "RETURNED"),
            (3, "acknowledged", "NORMAL"),
        ]
        # A signal that reaches every process of the service is obeyed in order too.
        site.feed.bright = True
        site.wait_alarm("UNACKNOWLEDGED")
        wait_for("the record is sent", lambda: not _unpublished(tmp_path), 20)
        site.killed = True
        code, seconds = site.daemon.stop(everyone=True)
        assert (code, seconds < 6.0) == (0, True)
        assert [one["sequence"] for one in site.events()] == [1, 2, 3, 4]
        assert not _unpublished(tmp_path)
        assert "is gone (SIG" not in site.daemon.log.read_text().rpartition("hub runs as process")[2]


def test_decisions_that_come_too_late_are_an_alarm_of_their_own(tmp_path: Path) -> None:
    """A camera far away: pictures are 0.6 s old when they come, and 0.5 s are allowed."""
    with running(tmp_path, latency={"budget_s": 0.5, "for_s": 1.0}, system={"off_delay_s": 0.5}) as site:
        site.feed.late_s = 0.6
        wait_for("late", lambda: site.level()["system"] == 1, 30)
        raised = wait_for("raised", lambda: site.follower.records("system"), 20)[0]["data"]
        assert (raised["change"], raised["reason"], raised["priority"]) == ("raised", "latency", "medium")
        assert raised["latency"]["receive_s"] == pytest.approx(0.6, abs=1e-3)
        assert raised["latency"]["total_s"] > raised["latency"]["budget_s"] == 0.5
        wait_for("told in metrics", lambda: site.daemon.metric("lumpwatch_latency_budget_ratio") > 1.0, 30)
        assert site.state()["state"] == "CLEAR"
        assert "shelved" in site.command(
            "shelve", *TARGET, "--class", "system", "--for", "5m", "--reason", "x"
        )
        wait_for("shelved", lambda: site.state()["alarms"]["system"] == "SHELVED", 30)
        site.command("unshelve", *TARGET, "--class", "system")
        assert "acknowledged" in site.command("ack", *TARGET, "--class", "system")
        site.feed.late_s = 0.0
        wait_for("in time again", lambda: site.level()["system"] == 0, 30)
        # The page of metrics is told twice a second.
        wait_for(
            "inactive", lambda: site.daemon.metric("lumpwatch_alarm_active", **{"class": "system"}) == 0, 30
        )
        told = [(one["change"], one["reason"]) for one in site.events() if one["class"] == "system"]
        assert told[0] == ("raised", "latency")
        assert told[-1][0] == "cleared"


def test_a_record_that_was_written_but_not_sent_comes_after_the_restart(tmp_path: Path) -> None:
    """A monitor that is killed between the disk and the bus loses no alarm and makes none twice."""
    unsent = {**EVENT, "id": "id-000007", "data": {**EVENT["data"], "sequence": 7}}
    log = EventLog(event_file(tmp_path / "var", "cam"))
    log.append([Entry(event(6, Alarm()), b"{}"), Entry(event(7), json.dumps(unsent).encode())])
    log.published([("apron", "id-000006")])
    log.close()
    with running(tmp_path, off_delay_s=60.0, blind={"on_delay_s": 60.0}) as site:
        assert site.changes(1) == [(7, "raised", "UNACKNOWLEDGED")]
        assert (site.state()["alarm"], site.state()["sequence"]) == ("UNACKNOWLEDGED", 7)
        # It is marked as sent a moment after it left: killed in between, it would come twice under one id.
        wait_for("marked", lambda: not _unpublished(tmp_path), 30)
        site.kill_monitor()
        site.command("ack", *TARGET)
        assert site.changes(2) == [(7, "raised", "UNACKNOWLEDGED"), (8, "acknowledged", "ACKNOWLEDGED")]
        assert site.follower.records(None)[0] == unsent


def _unpublished(folder: Path) -> int:
    """Records that are written and not marked as sent."""
    log = EventLog(event_file(folder / "var", "cam"), check=False)
    try:
        return len(log.unpublished())
    finally:
        log.close()


def test_operators_and_the_plant_hold_alarms_back(tmp_path: Path) -> None:
    blind = {"on_delay_s": 4.0, "needs_reset": True}
    with running(tmp_path, off_delay_s=0.3, shelve_max_s=3600.0, blind=blind) as site:
        first = site.state()["sequence"]
        told = site.command("shelve", *TARGET, "--for", "30m", "--reason", "dust from the repair")
        assert told == "cam/apron lump: shelved, now SHELVED\n"
        site.feed.bright = True
        wait_for("condition recorded", lambda: site.level()["lump"] == 1, 30)
        assert (site.level()["alarm"], site.level()["sequence"]) == ("SHELVED", first + 2)
        wait_for(
            "shelved in metrics",
            lambda: site.daemon.metric("lumpwatch_alarm_shelved", **{"class": "lump"}) == 1,
            30,
        )
        written = first + 2
        wait_for("counted", lambda: site.daemon.metric("lumpwatch_events_written_total") >= written, 30)
        assert site.daemon.metric("lumpwatch_events_written_total") == written == site.state()["sequence"]
        assert "unshelved, raised, now UNACKNOWLEDGED" in site.command("unshelve", *TARGET)
        assert "acknowledged, now ACKNOWLEDGED" in site.command("ack", *TARGET)
        assert "nothing to do, now ACKNOWLEDGED" in site.command("ack", *TARGET)

        site.command("service out", *TARGET, "--reason", "camera is being moved")
        site.kill_monitor()
        assert site.state()["alarm"] == "OUT_OF_SERVICE"
        site.wait_alarm("OUT_OF_SERVICE")
        wait_for("condition judged on", lambda: site.level()["lump"] == 1, 30)
        assert "in_service, raised, now UNACKNOWLEDGED" in site.command("service in", *TARGET)

        # The plant: by a put that is not repeated, so the suppression ends by itself.
        with open_client(as_client(load_config(site.daemon.config).bus)) as plant:
            plant.publisher(KEYS.command("cam", "apron", "suppress")).put(
                b'{"signal": "feeder", "valid_s": 1.5}'
            )
            site.wait_alarm("SUPPRESSED")
            site.wait_alarm("UNACKNOWLEDGED")
            plant.publisher(KEYS.command("cam", "apron", "suppress")).put(b"nonsense")
            wait_for(
                "counted",
                lambda: site.daemon.metric("lumpwatch_commands_refused_total", command="suppress") == 1,
                30,
            )
        (reply,) = site.bus.ask(
            KEYS.command("cam", "apron", "suppress"), {"signal": "feeder", "valid_s": "60"}
        )
        assert reply.payload is not None
        assert json.loads(reply.payload)["changes"] == ["suppressed"]
        (reply,) = site.bus.ask(
            KEYS.command("cam", "apron", "suppress"), {"signal": "feeder", "valid_s": "0"}
        )
        assert reply.payload is not None
        assert json.loads(reply.payload)["changes"] == ["unsuppressed", "raised"]

        # It cannot see, for the same frame comes again and again: an alarm of its own class.
        site.feed.frozen = True
        site.wait_alarm("UNACKNOWLEDGED", of="blind_alarm")
        wait_for("level of the same", lambda: site.level()["blind"] == 1, 30)
        assert "acknowledged, now ACKNOWLEDGED" in site.command("ack", *TARGET, "--class", "blind")
        assert "nothing to do, now ACKNOWLEDGED" in site.command("reset", *TARGET, "--class", "blind")
        site.feed.frozen = False
        site.wait_alarm("LATCHED", of="blind_alarm")
        assert "reset, now NORMAL" in site.command("reset", *TARGET, "--class", "blind")
        assert (site.events()[-1]["change"], site.events()[-1]["actor"]) == ("reset", "Ada")

        # What cannot be done is said in one line.
        for key, parameters, told in (
            (KEYS.command("cam", "apron", "ack"), {}, "actor: is missing"),
            (
                KEYS.command("cam", "apron", "shelve"),
                {"actor": "Ada", "reason": "x", "for_s": "3601"},
                "at most 3600",
            ),
            (KEYS.command("cam", "apron", "service"), {"actor": "Ada", "state": "off"}, "state: "),
        ):
            (reply,) = site.bus.ask(key, parameters)
            assert reply.error is not None
            assert told in reply.error
        refused = site.command("shelve", *TARGET, "--for", "2h", "--reason", "x", code=1)
        assert refused.startswith("lumpwatch: cam/apron: for_s: 7200")
        assert len(refused.splitlines()) == 1

        events = site.events()
        rows = list(csv.DictReader(io.StringIO(site.command("events", "--camera", "cam", "--format", "csv"))))
        assert [row["id"] for row in rows] == [one["id"] for one in events]
        assert "camera is being moved" in site.command("events", "--since", "1h")
        assert [one["sequence"] for one in events] == list(range(1, len(events) + 1))
        blind_changes = [(one["change"], one["reason"]) for one in events if one["class"] == "blind"]
        assert blind_changes[-4:-1] == [("raised", "no_stream"), ("acknowledged", None), ("cleared", None)]
        wait_for("the follower has all", lambda: len(site.follower.records(None)) >= len(events), 30)
        records = site.follower.records(None)
        assert {one["id"] for one in records} == {one["id"] for one in events}
        assert len(records) == len(events)
