"""The event log: what survives kills, damage and full disks, and that nobody waits for a disk for long."""

from __future__ import annotations

import os
import re
import resource
import signal
import sqlite3
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from lumpwatch.service.bus.endpoints import ALARMS_KEPT
from lumpwatch.service.core.alarm import Alarm, AlarmClass, Hold
from lumpwatch.service.storage.event import Event
from lumpwatch.service.storage.event_log import (
    RECORDS_KEPT,
    Entry,
    EventLog,
    EventLogError,
    event_file,
)
from lumpwatch.service.storage.event_log_reader import read_events, reading
from lumpwatch.service.storage.event_log_writer import EventWriter
from lumpwatch.service.storage.event_notes import Verdict, VerdictOutcome, verdicts
from tests.integration.site import wait_for

WALL_S = 1.7e9
WAITING = Alarm(active=True, waits=True, announced_s=5.0)


class Counting:
    """Counts what the log says of itself."""

    def __init__(self) -> None:
        self.written = 0
        self.waiting = 0
        self.removed = 0
        self.problems: Counter[str] = Counter()

    def events_written(self, count: int) -> None:
        self.written += count

    def events_waiting(self, count: int) -> None:
        self.waiting = count

    def events_removed(self, count: int) -> None:
        self.removed += count

    def event_problem(self, reason: str, count: int = 1) -> None:
        self.problems[reason] += count


def event(
    sequence: int,
    alarm: Alarm = WAITING,
    alarm_class: AlarmClass = AlarmClass.LUMP,
    roi: str = "apron",
    reason: str | None = None,
) -> Event:
    return Event(
        time_s=WALL_S + sequence,
        monotonic_s=100.0 + sequence,
        clock="boot",
        camera="cam",
        roi=roi,
        alarm_class=alarm_class,
        change="raised",
        before="NORMAL",
        after="UNACKNOWLEDGED",
        actor="Ada",
        reason=reason,
        existence=0.97,
        frame=40 + sequence,
        id=f"id-{sequence:06d}",
        sequence=sequence,
        alarm=alarm,
    )


def entry(sequence: int, alarm: Alarm = WAITING, reason: str | None = None) -> Entry:
    return Entry(event(sequence, alarm, reason=reason), f"record {sequence}".encode())


def writer(store: Path, counting: Counting | None = None, **more: object) -> EventWriter:
    return EventWriter(store, "cam", counting or Counting(), lambda: WALL_S, **more)  # type: ignore[arg-type]


def sequences(store: Path) -> list[int]:
    return [one.sequence for one in read_events(event_file(store, "cam"))]


# What is written is there


def test_events_come_back_as_they_were(tmp_path: Path) -> None:
    held = Alarm(active=True, shelved=Hold("Ada", "dust", 900.0), out_of_service=Hold("Bob", "repair"))
    entries = [entry(1), Entry(event(2, held, AlarmClass.BLIND, reason="no_stream"), b"two")]
    log = writer(tmp_path)
    assert log.alarms(0.0, WALL_S, "boot") == {}
    assert log.write(entries)
    assert list(read_events(event_file(tmp_path, "cam"))) == [
        one.event for one in entries
    ]  # while it is open
    log.close()
    again = writer(tmp_path)
    assert again.alarms(200.0, WALL_S + 100, "boot") == {
        ("apron", AlarmClass.LUMP): WAITING,
        ("apron", AlarmClass.BLIND): held,
    }
    assert again.sequences() == {"apron": 2}
    again.close()
    assert list(read_events(event_file(tmp_path, "cam"))) == [one.event for one in entries]  # and closed
    assert [one.sequence for one in read_events(event_file(tmp_path, "cam"), WALL_S + 1.5)] == [2]


def test_the_last_event_of_each_alarm_says_how_it_stands(tmp_path: Path) -> None:
    log = writer(tmp_path)
    log.write([entry(1), entry(2, Alarm(active=True)), entry(3, Alarm())])
    log.close()
    again = writer(tmp_path)
    assert again.alarms(0.0, WALL_S, "boot") == {("apron", AlarmClass.LUMP): Alarm()}
    again.close()


def test_what_may_not_be_on_the_bus_is_known_after_a_restart(tmp_path: Path) -> None:
    log = writer(tmp_path)
    log.write([entry(1), entry(2)])
    log.published([("apron", "id-000001")])
    log.write([entry(3)])
    log.close()
    again = writer(tmp_path)
    assert again.unpublished == [
        ("apron", "id-000002", b"record 2"),
        ("apron", "id-000003", b"record 3"),
    ]
    again.close()


def test_the_last_records_are_there_after_a_restart(tmp_path: Path) -> None:
    """64 of each ROI, and the last one of each class however old it is."""
    log = writer(tmp_path)
    blind = Entry(event(1, alarm_class=AlarmClass.BLIND), b"blind", "0a" * 8)
    other = Entry(event(1, roi="lip"), b"other", "0b" * 8)
    log.write([blind, other, *(replace(entry(n), publisher="0a" * 8) for n in range(2, 90))])
    log.published([("apron", f"id-{n:06d}") for n in range(1, 90)])
    log.close()
    again = writer(tmp_path)
    kept = [(one.roi, one.number, one.publisher, one.record) for one in again.records]
    assert kept[0] == ("apron", 1, "0a" * 8, b"blind")
    assert kept[1] == ("lip", 1, "0b" * 8, b"other")
    assert [number for _, number, _, _ in kept[2:]] == list(range(26, 90))
    again.close()
    assert RECORDS_KEPT == ALARMS_KEPT


def test_events_can_be_added_only(tmp_path: Path) -> None:
    log = EventLog(event_file(tmp_path, "cam"))
    log.append([entry(1)])
    log.append([entry(1)])  # tried again after a commit whose success could not be told
    log.close()
    assert sequences(tmp_path) == [1]
    with closing(sqlite3.connect(event_file(tmp_path, "cam"))) as db:
        for statement in ("UPDATE events SET actor = 'Eve'", "DELETE FROM events"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                db.execute(statement)


def test_a_batch_is_written_wholly_or_not_at_all(tmp_path: Path) -> None:
    log = EventLog(event_file(tmp_path, "cam"))
    broken = Entry(event(2), None)  # type: ignore[arg-type]
    with pytest.raises(sqlite3.IntegrityError):
        log.append([entry(1), broken])
    log.close()
    assert sequences(tmp_path) == []


@pytest.mark.parametrize(
    ("now_s", "wall_after_s", "clock", "left_s"),
    [
        (150.0, 49.0, "boot", 750.0),  # the same boot: the monotonic clock says it
        (150.0, 3600.0, "boot", 750.0),  # even where the wall clock was stepped
        (7.0, 100.0, "later", 699.0),  # 799 s were left, and 100 s went by
        (7.0, 5000.0, "later", 0.0),
        (7.0, -3600.0, "later", 799.0),  # a wall clock that went back makes no hold longer
    ],
)
def test_a_hold_goes_on_after_a_reboot(now_s: float, wall_after_s: float, clock: str, left_s: float) -> None:
    hold = Hold("Ada", "dust", 900.0)
    alarm = Alarm(shelved=hold, suppressed=(hold, hold), out_of_service=Hold("Bob", "repair"))
    then = event(1, alarm)
    carried = then.alarm_now(now_s, then.time_s + wall_after_s, clock)
    assert carried.shelved is not None
    assert carried.shelved.until_s is not None
    assert carried.shelved.until_s - now_s == pytest.approx(left_s)
    assert carried.suppressed == (carried.shelved, carried.shelved)
    assert carried.out_of_service == alarm.out_of_service


# Kills


CHILD = """
import sys
import time
from pathlib import Path
from tests.storage.test_event_log import Counting, entry, writer
log = writer(Path(sys.argv[1]))
number = log.sequences().get("apron", 0)
print("last", number, flush=True)
while True:
    number += 1
    while not log.write([entry(number)]):  # a slow machine: the same again is still one row
        time.sleep(0.05)
    log.published([("apron", f"id-{number:06d}")])
    print(number, flush=True)
"""


@pytest.mark.slow
def test_what_was_written_survives_being_killed_again_and_again(tmp_path: Path) -> None:
    told, ends = 0, []
    for k in range(6):
        child = subprocess.Popen(
            [sys.executable, "-c", CHILD, str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        assert child.stdout is not None
        first = child.stdout.readline()
        # Nothing that was told is lost; what was being written may be there.
        assert int(first.split()[1]) in (told, told + 1)
        for _ in range(5 + 17 * k):
            told = int(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        rest, _ = child.communicate()
        told = max([told, *(int(line) for line in rest.split("\n")[:-1])])
        ends.append(told)
    found = sequences(tmp_path)
    assert found == list(range(1, len(found) + 1))  # none twice, none missing
    assert len(found) in (told, told + 1)
    last = writer(tmp_path)
    # Only what was being written or published when the process was killed may have to be sent again.
    for _, name, _ in last.unpublished:
        assert any(end - 1 <= int(name.removeprefix("id-")) <= end + 1 for end in ends)
    last.close()


# Damage


def _nothing_but_noise(path: Path) -> None:
    path.write_bytes(os.urandom(20_000))


def _noise_in_the_middle(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(4096)
        file.write(os.urandom(path.stat().st_size - 8192))


def _cut_off(path: Path) -> None:
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 2)


def _of_a_later_version(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 99")


def _of_something_else(path: Path) -> None:
    path.unlink()
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE events (x)")


def _not_an_alarm(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.execute("DROP TRIGGER no_update")
        db.execute("""UPDATE events SET alarm = '{"lump": 1}'""")
        db.commit()


@pytest.mark.parametrize(
    "damage",
    [
        _nothing_but_noise,
        _noise_in_the_middle,
        _cut_off,
        _of_a_later_version,
        _of_something_else,
        _not_an_alarm,
    ],
)
def test_a_damaged_file_is_moved_aside_and_a_new_one_begins(
    tmp_path: Path, damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    log = writer(tmp_path)
    log.write([entry(k, reason="x" * 200) for k in range(1, 60)])
    log.close()
    path = event_file(tmp_path, "cam")
    damage(path)
    damaged = path.read_bytes()
    counting = Counting()
    log = writer(tmp_path, counting)
    assert log.alarms(0.0, WALL_S, "boot") == {}
    assert log.write([entry(1)])
    log.close()
    assert counting.problems == {"corrupt": 1}
    assert sequences(tmp_path) == [1]
    (aside,) = path.parent.glob("cam.sqlite.corrupt-*[0-9]")
    assert aside.name == "cam.sqlite.corrupt-20231114T221320"
    assert aside.read_bytes() == damaged
    assert aside.name in caplog.text


HALF_A_PAIR = "\ud800"


def poisoned(sequence: int) -> Entry:
    return Entry(event(sequence, reason=HALF_A_PAIR), b"{}")


def too_large(sequence: int) -> Entry:
    return Entry(replace(event(sequence), frame=2**70), b"{}")


def without_a_number(sequence: int) -> Entry:
    return Entry(replace(event(sequence), existence=float("nan")), b"{}")


@pytest.mark.parametrize("bad", [poisoned, too_large, without_a_number])
def test_an_event_that_no_file_would_take_is_set_aside_alone(
    tmp_path: Path, bad: Callable[[int], Entry], caplog: pytest.LogCaptureFixture
) -> None:
    """Its error was once taken for damage: the healthy log was moved aside, again and again."""
    counting = Counting()
    log = writer(tmp_path, counting)
    assert log.write([entry(1)])
    assert not log.write([entry(2), bad(3), entry(4)])
    assert log.write([entry(5)])
    log.close()
    assert sequences(tmp_path) == [1, 2, 4, 5]
    assert list((tmp_path / "events").glob("*corrupt*")) == []
    assert counting.problems == {"refused": 1}
    assert (counting.written, counting.waiting) == (4, 0)
    assert "apron/id-000003" in caplog.text


def test_a_verdict_that_no_file_would_take_holds_up_nothing(tmp_path: Path) -> None:
    counting = Counting()
    log = writer(tmp_path, counting)
    bad = Verdict(WALL_S, "apron", "id-000001", 1, VerdictOutcome.TRUE, HALF_A_PAIR)
    assert log.write([entry(1)])
    assert not log.add([bad, replace(bad, actor="Ada")], wait=True)
    assert log.write([entry(2)])
    log.close()
    assert sequences(tmp_path) == [1, 2]
    with reading(event_file(tmp_path, "cam")) as db:
        assert [one.actor for one in verdicts(db)] == ["Ada"]
    assert counting.problems == {"refused": 1}
    assert list((tmp_path / "events").glob("*corrupt*")) == []


def test_two_damaged_files_of_one_second_are_both_kept(tmp_path: Path) -> None:
    path = event_file(tmp_path, "cam")
    path.parent.mkdir()
    for k in range(3):
        path.write_bytes(bytes([k]) * 5000)
        writer(tmp_path).close()
    assert len(list(path.parent.glob("cam.sqlite.corrupt-*"))) == 3


class FailsOnce(EventLog):
    """Finds its file damaged at the second batch."""

    batches = 0

    def append(self, entries: object) -> None:
        FailsOnce.batches += 1
        if FailsOnce.batches == 2:
            error = sqlite3.DatabaseError("database disk image is malformed")
            error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
            raise error
        super().append(entries)  # type: ignore[arg-type]


def test_a_file_that_is_overwritten_while_it_is_open_is_noticed_with_the_next_event(tmp_path: Path) -> None:
    counting = Counting()
    log = writer(tmp_path, counting)
    assert log.write([entry(1)])
    path = event_file(tmp_path, "cam")
    for one in (path, path.with_name("cam.sqlite-wal")):
        one.write_bytes(b"\xa5" * one.stat().st_size)
    assert log.write([entry(2)])
    log.close()
    assert counting.problems == {"corrupt": 1}
    assert sequences(tmp_path)[-1] == 2


def test_a_file_that_turns_out_to_be_damaged_while_running_loses_no_state(tmp_path: Path) -> None:
    counting = Counting()
    log = writer(tmp_path, counting, open_log=lambda path, check: FailsOnce(path, check=check))
    blind = Entry(event(1, Alarm(active=True), AlarmClass.BLIND), b"one")
    assert log.write([blind])
    assert log.write([entry(2)])
    log.close()
    assert counting.problems == {"corrupt": 1}
    again = writer(tmp_path)
    assert again.alarms(0.0, WALL_S, "boot") == {
        ("apron", AlarmClass.BLIND): Alarm(active=True),
        ("apron", AlarmClass.LUMP): WAITING,
    }
    assert again.sequences() == {"apron": 2}
    again.close()


# Disks in trouble


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 512 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", folder], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("cannot mount a small file system (needs root)")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def remount(folder: Path, mode: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{mode}", folder], check=True)


def test_a_full_disk_holds_up_nothing_and_is_caught_up_with(small_disk: Path) -> None:
    counting = Counting()
    log = writer(small_disk, counting, retry_s=0.05)
    number = 0
    while log.write([entry(number + 1, reason="x" * 4000)]):
        number += 1
    assert number > 3
    for more in range(2, 6):
        assert not log.write([entry(number + more, reason="x" * 4000)])
    assert counting.problems["unwritable"] >= 1
    assert sequences(small_disk) == list(range(1, number + 1))
    remount(small_disk, "size=4m")
    wait_for("caught up", lambda: counting.written == number + 5, 20)
    assert log.write([entry(number + 6)])
    log.close()
    assert sequences(small_disk) == list(range(1, number + 7))
    assert counting.waiting == 0


def test_a_read_only_store_still_says_how_the_alarms_stood(small_disk: Path) -> None:
    log = writer(small_disk)
    log.write([entry(1), entry(2)])
    log.close()
    remount(small_disk, "ro")
    counting = Counting()
    log = writer(small_disk, counting, retry_s=0.05)
    assert log.alarms(0.0, WALL_S, "boot") == {("apron", AlarmClass.LUMP): WAITING}
    assert log.sequences() == {"apron": 2}
    assert not log.write([entry(3)])
    assert counting.problems["unwritable"] >= 1
    assert counting.problems["corrupt"] == 0
    assert sequences(small_disk) == [1, 2]  # the command reads it as well
    remount(small_disk, "rw")
    wait_for("written after all", lambda: counting.written == 1, 20)
    log.close()
    assert sequences(small_disk) == [1, 2, 3]


def test_a_folder_that_cannot_be_made(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "events").write_text("not a folder")
    counting = Counting()
    log = writer(tmp_path, counting, retry_s=0.01)
    for number in range(1, 4):
        assert not log.write([entry(number)])
    wait_for("tried again", lambda: counting.problems["unwritable"] > 5, 20)
    assert caplog.text.count("unwritable") == 1  # said once, counted each time
    (tmp_path / "events").unlink()
    wait_for("written after all", lambda: counting.written == 3, 20)
    log.close()
    assert sequences(tmp_path) == [1, 2, 3]


LIMITED = """
import resource, sys
from pathlib import Path
from tests.storage.test_event_log import Counting, entry, writer
counting = Counting()
log = writer(Path(sys.argv[1]), counting)
resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, resource.RLIM_INFINITY))
number = 0
while log.write([entry(number + 1, reason="x" * 4000)]):
    number += 1
assert not log.write([entry(number + 2)])
log.close()
print(number, counting.problems["unwritable"] > 0, counting.problems["corrupt"])
"""


def test_a_file_that_may_not_grow(tmp_path: Path) -> None:
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    number, unwritable, corrupt = done.stdout.split()
    assert (unwritable, corrupt) == ("True", "0")
    assert sequences(tmp_path)[: int(number)] == list(range(1, int(number) + 1))
    assert int(number) >= 3


class Stalling(EventLog):
    """A disk that does not answer until it is told to."""

    go = threading.Event()

    def append(self, entries: object) -> None:
        Stalling.go.wait(60)
        super().append(entries)  # type: ignore[arg-type]


def test_nobody_waits_for_a_disk_that_does_not_answer(tmp_path: Path) -> None:
    Stalling.go.clear()
    counting = Counting()
    log = writer(
        tmp_path, counting, most_waiting=50, open_log=lambda path, check: Stalling(path, check=check)
    )
    results = [log.write([entry(number)]) for number in range(1, 61)]
    assert results == [False] * 60
    assert counting.problems == {"late": 1, "lost": 10}  # only the first waited for its time
    Stalling.go.set()
    wait_for("caught up", lambda: counting.written == 50, 20)
    assert log.write([entry(61)])
    log.close()
    assert sequences(tmp_path) == [*range(1, 51), 61]


def test_another_process_may_hold_the_file_for_a_while(tmp_path: Path) -> None:
    counting = Counting()
    log = writer(tmp_path, counting, retry_s=0.05)
    assert log.write([entry(1)])
    with closing(sqlite3.connect(event_file(tmp_path, "cam"), isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert not log.write([entry(2)])
        assert counting.problems == {"late": 1}
        other.execute("COMMIT")
    wait_for("caught up", lambda: counting.written == 2, 20)
    log.close()
    assert sequences(tmp_path) == [1, 2]


# Reading


def errors(path: Path) -> Sequence[str]:
    with pytest.raises(EventLogError) as caught:
        list(read_events(path))
    return str(caught.value).splitlines()


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "cam.sqlite"
    assert re.fullmatch(rf"{path}: there is no event log .*", errors(path)[0])
    path.write_bytes(b"nonsense" * 1000)
    (told,) = errors(path)
    assert told.startswith(f"{path}: cannot be read")
    path.unlink()
    with closing(sqlite3.connect(path)) as db:
        db.execute("CREATE TABLE other (x)")
    assert "no such table: events" in errors(path)[0]
