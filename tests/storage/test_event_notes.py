"""What the event log holds beside the events, what it forgets, and logs of the version before."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from lumpwatch.service.core.alarm import Alarm, AlarmClass, AlarmRequestError, Hold
from lumpwatch.service.core.clock import Clocks
from lumpwatch.service.monitor.uptime import UptimeRecorder
from lumpwatch.service.monitor.verdict_handler import verdict_on
from lumpwatch.service.protocol import VerdictRequest, read_request
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.event_log_reader import read_events, reading
from lumpwatch.service.storage.event_log_writer import Retention
from lumpwatch.service.storage.event_notes import (
    Span,
    Verdict,
    VerdictOutcome,
    latest_verdicts,
    uptime_spans,
    verdicts,
)
from tests.integration.site import wait_for
from tests.offline.shift_scene import BEGIN_S, entry, event
from tests.storage.test_event_log import WALL_S, Counting, writer

DAY_S = 86_400.0
OVER = Alarm()
UP = Alarm(active=True, waits=True)


@pytest.fixture
def log(tmp_path: Path) -> Iterator[EventLog]:
    opened = EventLog(event_file(tmp_path, "cam"))
    yield opened
    opened.close()


def kept(tmp_path: Path) -> list[tuple[int, str]]:
    return [(one.sequence, one.change) for one in read_events(event_file(tmp_path, "cam"))]


# Verdicts


def verdict(number: int, says: VerdictOutcome, at_s: float = 0.0) -> Verdict:
    return Verdict(BEGIN_S + at_s, "apron", f"id-{number:06d}", number, says, "Eve", "why")


def test_the_last_verdict_counts_and_all_are_kept(tmp_path: Path, log: EventLog) -> None:
    log.append([entry(1, "raised", 1), entry(2, "raised", 2)])
    said = [
        verdict(1, VerdictOutcome.TRUE),
        verdict(2, VerdictOutcome.UNSURE, 1),
        verdict(1, VerdictOutcome.FALSE, 2),
    ]
    log.add(said)
    log.add([Span(BEGIN_S, BEGIN_S + 60, "apron", 60.0, {})])
    with reading(event_file(tmp_path, "cam")) as db:
        assert list(verdicts(db)) == said
        assert latest_verdicts(db) == {("apron", "id-000001"): said[2], ("apron", "id-000002"): said[1]}
    with closing(sqlite3.connect(event_file(tmp_path, "cam"))) as db:
        for statement in (
            "UPDATE verdicts SET verdict = 'true'",
            "DELETE FROM verdicts",
            "DELETE FROM watched",
        ):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                db.execute(statement)


ALARMS = [
    entry(10, "raised", 3),
    entry(12, "acknowledged", 4),
    entry(15, "cleared", 5),
    entry(16, "raised", 6, alarm_class=AlarmClass.BLIND),
    entry(20, "raised", 7),
    entry(21, "raised", 7, roi="chute"),
]


@pytest.mark.parametrize(
    ("asked", "sequence"),
    [
        ({}, 7),
        ({"alarm": "3"}, 3),
        ({"alarm": "4"}, 3),  # any record of the alarm will do
        ({"alarm": "id-000005"}, 3),
        ({"evidence": "id-000003"}, 3),
        ({"alarm": "7"}, 7),
    ],
)
def test_which_alarm_is_judged(tmp_path: Path, log: EventLog, asked: dict[str, str], sequence: int) -> None:
    log.append(ALARMS)
    parameters = asked | {"actor": " Ada  B. ", "verdict": "false", "note": " dust \n cloud "}
    request = read_request(VerdictRequest, parameters)
    made = verdict_on(event_file(tmp_path, "cam"), "apron", request, 5.0)
    assert made == Verdict(
        5.0, "apron", f"id-{sequence:06d}", sequence, VerdictOutcome.FALSE, "Ada B.", "dust cloud"
    )


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ({"alarm": "6"}, "lump alarm 6"),
        ({"alarm": "99"}, "lump alarm 99"),
        ({"alarm": "'; DROP TABLE events"}, "no lump alarm"),
        ({"verdict": "maybe"}, "verdict: "),
        ({"actor": ""}, "actor: is missing"),
        ({"alarm": "3", "evidence": "3"}, "one of them is enough"),
        ({"clas": "lump"}, "clas: is no parameter"),
    ],
)
def test_what_cannot_be_judged_is_one_line(
    tmp_path: Path, log: EventLog, asked: dict[str, str], told: str
) -> None:
    log.append(ALARMS)

    def judge() -> Verdict:
        request = read_request(VerdictRequest, {"actor": "Ada", "verdict": "true"} | asked)
        return verdict_on(event_file(tmp_path, "cam"), "apron", request, 0.0)

    with pytest.raises(AlarmRequestError) as caught:
        judge()
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_before_anything_has_happened_nothing_can_be_judged(tmp_path: Path) -> None:
    request = VerdictRequest(actor="Ada", verdict=VerdictOutcome.TRUE)
    with pytest.raises(AlarmRequestError, match="no event log"):
        verdict_on(tmp_path / "cam.sqlite", "apron", request, 0.0)


# Retention


def test_what_is_over_and_old_is_forgotten(tmp_path: Path, log: EventLog) -> None:
    log.append(
        [
            entry(0, "raised", 1, alarm=UP),
            entry(1, "cleared", 2, alarm=OVER),
            entry(2 * DAY_S, "raised", 3, alarm=UP),
            entry(2 * DAY_S + 1, "acknowledged", 4, alarm=OVER),
            entry(3 * DAY_S, "raised", 5, alarm=UP),
            entry(3 * DAY_S + 1, "cleared", 6, alarm=OVER),
        ]
    )
    log.add([verdict(1, VerdictOutcome.TRUE), verdict(5, VerdictOutcome.FALSE)])
    log.add(
        [
            Span(BEGIN_S, BEGIN_S + 60, "apron", 60.0, {}),
            Span(BEGIN_S + 3 * DAY_S, BEGIN_S + 4 * DAY_S, "apron", 1.0, {}),
        ]
    )
    assert log.prune(BEGIN_S + DAY_S, 1000, 100) == 4  # two events, a verdict and a span
    assert kept(tmp_path) == [(3, "raised"), (4, "acknowledged"), (5, "raised"), (6, "cleared")]
    with reading(event_file(tmp_path, "cam")) as db:
        assert [one.sequence for one in verdicts(db)] == [5]
        assert [one.seen_s for one in uptime_spans(db, 0, 1e12)] == [1.0]
    assert log.prune(BEGIN_S + DAY_S, 1000, 100) == 0
    assert log.prune(BEGIN_S + 100 * DAY_S, 1000, 100) > 0
    assert kept(tmp_path) == [(6, "cleared")]  # the alarm's state


@pytest.mark.parametrize(
    "alarm",
    [
        UP,
        Alarm(active=True),
        Alarm(waits=True),
        Alarm(latched=True),
        Alarm(out_of_service=Hold("Ada", "moved")),
    ],
)
def test_what_is_active_waits_or_is_held_is_never_forgotten(
    tmp_path: Path, log: EventLog, alarm: Alarm
) -> None:
    log.append(
        [
            entry(0, "raised", 1, alarm=UP),
            entry(1, "cleared", 2, alarm=OVER),
            entry(2, "raised", 3, alarm=UP),
            entry(3, "re_alarmed", 4, alarm=alarm),
            entry(4, "raised", 5, alarm_class=AlarmClass.BLIND, alarm=UP),
            entry(5, "cleared", 6, alarm_class=AlarmClass.BLIND, alarm=OVER),
        ]
    )
    log.prune(BEGIN_S + 1000 * DAY_S, 1, 100)
    assert kept(tmp_path) == [(3, "raised"), (4, "re_alarmed"), (6, "cleared")]
    # The file itself keeps an alarm's state.
    db = sqlite3.connect(event_file(tmp_path, "cam"))
    with closing(db), pytest.raises(sqlite3.IntegrityError, match="append-only"):
        db.execute("DELETE FROM events WHERE sequence = 6")


def test_the_number_of_events_is_bounded_in_steps(tmp_path: Path, log: EventLog) -> None:
    log.append([entry(k, "raised" if k % 2 else "cleared", k, alarm=OVER) for k in range(1, 101)])
    assert [log.prune(BEGIN_S - DAY_S, 30, 40) for _ in range(4)] == [40, 30, 0, 0]
    assert [sequence for sequence, _ in kept(tmp_path)] == list(range(71, 101))
    log.append([entry(200, "raised", 200, alarm=UP)])
    assert kept(tmp_path)[-1] == (200, "raised")


def into_the_file(path: Path) -> None:
    """What is in the log beside the file goes into it."""
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def test_the_file_gets_smaller(tmp_path: Path, log: EventLog) -> None:
    path = event_file(tmp_path, "cam")
    log.append([entry(k, "raised", k, alarm=OVER, note="x" * 500) for k in range(2000)])
    into_the_file(path)
    before = path.stat().st_size
    while log.prune(BEGIN_S + 1e9, 10**6, 500):
        pass
    into_the_file(path)
    assert path.stat().st_size < before / 4


def test_the_writer_forgets_while_nothing_else_is_to_do(tmp_path: Path) -> None:
    made = EventLog(event_file(tmp_path, "cam"))
    made.append([entry(k, "raised", k, alarm=OVER) for k in range(1200)])
    made.close()
    counting = Counting()
    opened = writer(tmp_path, counting, retention=Retention(1.0, 700))
    wait_for("pruned", lambda: counting.removed == 500, 20)
    assert opened.write([entry(9999, "raised", 9999, alarm=UP)])
    opened.close()
    assert counting.problems == {}
    assert len(kept(tmp_path)) == 701


# The version before


VERSION_1 = """
CREATE TABLE events (
    number INTEGER PRIMARY KEY AUTOINCREMENT,
    time_s REAL NOT NULL, monotonic_s REAL NOT NULL, clock TEXT NOT NULL,
    camera TEXT NOT NULL, roi TEXT NOT NULL, class TEXT NOT NULL,
    change TEXT NOT NULL, before TEXT NOT NULL, after TEXT NOT NULL,
    actor TEXT, reason TEXT, existence REAL NOT NULL, frame INTEGER NOT NULL,
    id TEXT NOT NULL, sequence INTEGER NOT NULL, alarm TEXT NOT NULL,
    UNIQUE (roi, id)
) STRICT;
CREATE INDEX events_of_alarm ON events (roi, class, number);
CREATE INDEX events_by_time ON events (time_s);
CREATE TRIGGER no_update BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TRIGGER no_delete BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'append-only'); END;
CREATE TABLE outbox (roi TEXT NOT NULL, id TEXT NOT NULL, record BLOB NOT NULL, UNIQUE (roi, id)) STRICT;
INSERT INTO events VALUES (5, 1.7e9, 7.0, 'boot', 'cam', 'apron', 'lump', 'raised', 'NORMAL',
    'UNACKNOWLEDGED', NULL, NULL, 0.9, 3, 'id-000008', 8, '{"active":true,"waits":true}');
INSERT INTO outbox VALUES ('apron', 'id-000008', x'7B7D');
PRAGMA journal_mode = WAL;
PRAGMA user_version = 1;
"""


def test_a_log_of_the_version_before_is_read_and_taken_over(tmp_path: Path) -> None:
    path = event_file(tmp_path, "cam")
    path.parent.mkdir()
    with closing(sqlite3.connect(path)) as db:
        db.executescript(VERSION_1)
    (old,) = read_events(path)  # by a command, before any daemon has opened it
    assert (old.sequence, old.alarm, old.details) == (8, UP, {})
    with reading(path) as db:
        assert latest_verdicts(db) == {}
        assert list(uptime_spans(db, 0, 1e12)) == []
    counting = Counting()
    opened = writer(tmp_path, counting)
    assert opened.alarms(0.0, WALL_S, "boot") == {("apron", AlarmClass.LUMP): UP}
    assert opened.unpublished == [("apron", "id-000008", b"{}")]
    assert opened.write([Entry(event(1, "cleared", 9, lip_s=2.5), b"{}")])
    assert opened.add([verdict(8, VerdictOutcome.TRUE)], wait=True)
    opened.close()
    assert counting.problems == {}
    assert [(one.sequence, one.details) for one in read_events(path)] == [(8, {}), (9, {"lip_s": 2.5})]


# How long a ROI could see


def clocks(monotonic_s: float, step_s: float = 0.0) -> Clocks:
    return Clocks(monotonic_s, BEGIN_S + monotonic_s + step_s)


def test_each_minute_is_summed_up() -> None:
    watch = UptimeRecorder()
    told: list[Span] = []
    for k in range(0, 4 * 150 + 1):  # four looks a second; dark from 30 s to 75 s
        told += watch.observe("apron", "dark" if 120 <= k < 300 else None, clocks(k / 4))
    told += watch.close(clocks(150.0))
    assert told == [
        Span(BEGIN_S, BEGIN_S + 60, "apron", 30.0, {"dark": 30.0}),
        Span(BEGIN_S + 60, BEGIN_S + 120, "apron", 45.0, {"dark": 15.0}),
        Span(BEGIN_S + 120, BEGIN_S + 150, "apron", 30.0, {}),
    ]


def test_a_time_in_which_the_monitor_stood_still_belongs_to_nobody() -> None:
    watch = UptimeRecorder()
    assert watch.observe("apron", None, clocks(0.0)) == ()
    assert watch.observe("apron", None, clocks(1.0)) == ()
    assert watch.observe("apron", None, clocks(31.0)) == (Span(BEGIN_S, BEGIN_S + 3, "apron", 3.0, {}),)
    assert watch.observe("apron", "dust", clocks(32.0)) == ()
    assert watch.close(clocks(33.0)) == (Span(BEGIN_S + 31, BEGIN_S + 33, "apron", 1.0, {"dust": 1.0}),)


def test_a_wall_clock_that_is_stepped_makes_no_span_longer() -> None:
    watch = UptimeRecorder()
    told: list[Span] = []
    for k in range(0, 241):
        told += watch.observe("apron", None, clocks(k / 2, step_s=3600.0 if k >= 60 else 0.0))
    assert [(one.end_s - one.begin_s, one.seen_s) for one in told] == [(60.0, 60.0), (60.0, 60.0)]


def test_rois_are_summed_up_each_by_itself() -> None:
    watch = UptimeRecorder()
    for k in range(5):
        watch.observe("apron", None, clocks(float(k)))
        watch.observe("chute", "dark", clocks(float(k)))
    assert {(one.roi, one.seen_s) for one in watch.close(clocks(4.0))} == {("apron", 4.0), ("chute", 0.0)}
