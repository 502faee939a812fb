"""What people and programs do to an event log under a running daemon, and values that nobody thought of."""

from __future__ import annotations

import os
import resource
import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from lumpwatch.service.core.alarm import AlarmClass
from lumpwatch.service.storage import event_log_writer
from lumpwatch.service.storage.cannot_open import cause_of
from lumpwatch.service.storage.event_log import EventLog, event_file
from lumpwatch.service.storage.event_log_reader import read_events
from tests.bus.test_bus_support import eventually
from tests.storage.test_event_log import WAITING, WALL_S, Counting, entry, sequences, writer


def _remove(path: Path) -> None:
    path.unlink()


def _remove_all(path: Path) -> None:
    for file in path.parent.glob(f"{path.name}*"):
        file.unlink()


def _remove_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def _move_folder(path: Path) -> None:
    path.parent.rename(path.parent.with_name("old"))


def _remove_journal(path: Path) -> None:
    path.with_name(f"{path.name}-wal").unlink()


@pytest.mark.parametrize("harm", [_remove, _remove_all, _remove_folder, _move_folder, _remove_journal])
def test_a_log_that_is_removed_under_the_daemon_is_put_back(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    counting = Counting()
    log = writer(tmp_path, counting)
    assert log.write([entry(1), entry(2)])
    before = log.trouble
    harm(event_file(tmp_path, "cam"))
    assert log.write([entry(3)])
    assert (before, log.trouble) == (False, True)
    assert counting.problems["removed"] + counting.problems["replaced"] == 1
    log.close()
    assert sequences(tmp_path) == [1, 2, 3]
    again = writer(tmp_path)
    assert again.sequences() == {"apron": 3}
    assert again.alarms(0.0, WALL_S, "boot") == {("apron", AlarmClass.LUMP): WAITING}
    again.close()


def test_it_says_what_the_system_says_of_a_file_that_cannot_be_opened(tmp_path: Path) -> None:
    path = tmp_path / "cam.sqlite"
    path.mkdir()
    with pytest.raises(sqlite3.OperationalError, match="unable to open database file") as caught:
        sqlite3.connect(path)
    assert str(cause_of(caught.value, path)) == "Is a directory"
    path.rmdir()
    assert cause_of(caught.value, path) is caught.value  # no more is known of what is not there
    path.touch()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    lowest = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest + 2, before[1]))  # one file alone could be opened
    try:
        cause = cause_of(caught.value, path)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert str(cause) == "Too many open files"
    assert cause_of(ValueError("x"), path).args == ("x",)


def test_it_is_put_back_though_nothing_happens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_log_writer, "LOOK_S", 0.02)
    log = writer(tmp_path)
    log.write([entry(1)])
    _remove_folder(event_file(tmp_path, "cam"))
    eventually(lambda: log.trouble and event_file(tmp_path, "cam").exists())
    log.close()
    assert sequences(tmp_path) == [1]


def test_a_log_that_is_replaced_goes_on_with_the_present_state(tmp_path: Path) -> None:
    """A restore from a copy of yesterday: alarms and numbers are today's."""
    path, copy = event_file(tmp_path, "cam"), tmp_path / "copy"
    log = writer(tmp_path)
    log.write([entry(1)])
    log.close()
    shutil.copy(path, copy)
    counting = Counting()
    log = writer(tmp_path, counting)
    log.write([entry(2), entry(3)])
    copy.replace(path)
    assert log.write([entry(4)])
    assert counting.problems["replaced"] == 1
    log.close()
    assert sequences(tmp_path) == [1, 3, 4]  # what came between is in the file that was replaced
    again = writer(tmp_path)
    assert again.sequences() == {"apron": 4}
    again.close()


class _Surprise(EventLog):
    """Fails in a way that nobody has thought of, once."""

    due = True

    def append(self, entries: object) -> None:
        if _Surprise.due:
            _Surprise.due = False
            raise ZeroDivisionError
        super().append(entries)  # type: ignore[arg-type]


@pytest.mark.parametrize("frame", [2**63 - 1, 2**63, 2**80])
def test_no_value_ends_the_log(tmp_path: Path, frame: int) -> None:
    log = writer(tmp_path)
    odd = entry(1)
    log.write([replace(odd, event=replace(odd.event, frame=frame, sequence=frame))])
    assert log.write([entry(2)])
    assert sequences(tmp_path)[-1] == 2
    log.close()


def test_a_surprise_ends_no_thread_and_is_told(tmp_path: Path) -> None:
    counting = Counting()
    _Surprise.due = True
    log = writer(tmp_path, counting, open_log=lambda path, check: _Surprise(path, check=check))
    assert not log.write([entry(1)])
    assert counting.problems["failed"] == 1
    assert log.trouble
    assert log.write([entry(2)])
    log.close()
    assert sequences(tmp_path) == [2]


def test_a_file_that_sqlite_cannot_even_name_is_moved_aside(tmp_path: Path) -> None:
    log = writer(tmp_path)
    assert log.write([entry(1)])
    log.close()
    path = event_file(tmp_path, "cam")
    content = path.read_bytes()
    at = content.index(b"CREATE TABLE")
    path.write_bytes(
        content[:at] + b"CREATE TABEE\xef(" + content[at + 14 :]
    )  # its error quotes what is no text
    again = writer(tmp_path)
    assert again.write([entry(2)])
    again.close()
    assert sequences(tmp_path) == [2]
    assert list(path.parent.glob("*.corrupt-*"))


def test_a_flipped_byte_costs_the_rows_that_it_hits(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    log = writer(tmp_path)
    for first in range(1, 200, 20):
        log.write([entry(number) for number in range(first, first + 20)])
    log.close()
    path = event_file(tmp_path, "cam")
    content = path.read_bytes()
    at = content.index(b"id-000100") - 200
    path.write_bytes(content[:at] + content[at:].replace(b'"active":true', b'"active":\xfftru', 1))
    found = [one.sequence for one in read_events(path)]
    assert len(found) == 199
    assert found[-1] == 200
    assert "1 rows cannot be read" in caplog.text


def test_a_broken_page_costs_its_rows(tmp_path: Path) -> None:
    log = writer(tmp_path)
    for first in range(1, 200, 20):
        log.write([entry(number) for number in range(first, first + 20)])
    log.close()
    path = event_file(tmp_path, "cam")
    content = bytearray(path.read_bytes())
    page = content.index(b"id-000100") // 4096 * 4096
    content[page : page + 8] = b"\xff" * 8
    path.write_bytes(content)
    found = [one.sequence for one in read_events(path)]
    assert 150 < len(found) < 200
    assert found[-1] == 200
