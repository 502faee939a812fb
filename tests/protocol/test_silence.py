"""The follower's dead man's switch, by a clock of the test's own."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest

from lumpwatch.service.protocol.silence import VALID_S, Silence, SilenceWatch


def beat(
    camera: str = "cam", *, valid: bool = True, valid_s: float = 2.0, rois: tuple[str, ...] = ("apron",)
) -> bytes:
    regions = {roi: {"state": "CLEAR", "decided_ago_s": 0.1, "valid": valid} for roi in rois}
    told = {"site": "pit", "camera": camera, "seq": 1, "time": "2024-05-17T06:00:00Z", "valid_s": valid_s}
    return json.dumps({**told, "valid": valid, "rois": regions}).encode()


@pytest.fixture
def watch() -> SilenceWatch:
    return SilenceWatch("pit", {"cam": ("apron",)}, 100.0)


def test_a_camera_that_is_never_heard_is_silent_after_the_first_wait(watch: SilenceWatch) -> None:
    assert watch.changes(100.0 + VALID_S) == []
    (change,) = watch.changes(100.1 + VALID_S)
    assert (change.camera, change.silent, change.reason) == ("cam", True, "never_heard")
    assert "SILENT" in str(change)
    assert watch.changes(200.0) == []
    assert watch.silent == {"cam"}


def test_silence_begins_when_the_last_heartbeat_expires_and_ends_with_the_next(watch: SilenceWatch) -> None:
    watch.heard(beat(), 101.0)
    assert watch.changes(103.0) == []
    (began,) = watch.changes(103.1)
    assert (began.silent, began.reason) == (True, "not_heard")
    assert began.for_s == pytest.approx(2.1)
    watch.heard(beat(), 110.0)
    (ended,) = watch.changes(110.1)
    assert not ended.silent
    assert ended.for_s == pytest.approx(9.1)
    assert str(ended) == "cam: heard again after 9.1 s"
    assert watch.silent == frozenset()


@pytest.mark.parametrize("payload", [beat(valid=False), beat(rois=())])
def test_a_heartbeat_that_is_not_valid_or_lacks_a_region_counts_like_none(
    watch: SilenceWatch, payload: bytes
) -> None:
    watch.heard(beat(), 101.0)
    watch.heard(payload, 101.5)
    (change,) = watch.changes(101.6)
    assert change.reason == "not_valid"
    watch.heard(beat(), 102.0)
    assert [one.silent for one in watch.changes(102.1)] == [False]


@pytest.mark.parametrize("payload", [b"", b"{}", b"\xff", beat("another")])
def test_what_is_no_heartbeat_of_the_camera_is_no_sign_of_life(watch: SilenceWatch, payload: bytes) -> None:
    watch.heard(payload, 102.9)
    assert [one.reason for one in watch.changes(103.1)] == ["never_heard"]


def test_each_camera_is_watched_by_itself() -> None:
    watch = SilenceWatch("pit", {"a": (), "b": ()}, 0.0)
    watch.heard(beat("b", valid_s=10.0), 1.0)
    assert [one.camera for one in watch.changes(5.0)] == ["a"]
    assert [one.camera for one in watch.changes(12.0)] == ["b"]


def test_the_record_fits_between_alarm_records() -> None:
    line = Silence("pit", "cam", silent=True, for_s=3.04, reason="not_heard").line(
        datetime(2024, 5, 17, 6, tzinfo=UTC)
    )
    told = json.loads(line)
    assert told["type"] == "io.lumpwatch.silence.began.v1"
    assert told["time"] == "2024-05-17T06:00:00Z"
    assert told["data"] == {
        "site": "pit",
        "camera": "cam",
        "silent": True,
        "for_s": 3.04,
        "reason": "not_heard",
    }
