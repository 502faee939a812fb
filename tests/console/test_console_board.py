from __future__ import annotations

import json
from datetime import UTC, datetime
from typing import Any

import pytest

from lumpwatch.service.console.board import Board
from tests.service_helpers import site, site_tree

STATE = {
    "site": "pit", "camera": "cam", "roi": "apron", "frame": 7, "time_s": 1.0, "state": "CLEAR", "existence": 0.02,
    "alarm": "NORMAL", "alarms": {"lump": "NORMAL", "blind": "NORMAL", "system": "NORMAL"},
}  # fmt: skip


class Told:
    """A board that hears one region."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.board = Board(site(site_tree()), lambda: self.now_s)
        self._seq = 0

    def state(self, **more: Any) -> None:
        self.board.on_state(
            "lumpwatch/v1/pit/cam/apron/state", json.dumps({**STATE, **more}, separators=(",", ":")).encode()
        )

    def beat(self, valid: bool = True, region: bool = True) -> None:
        self._seq += 1
        apron = {"state": "CLEAR", "decided_ago_s": 0.1, "valid": region}
        told = {
            "site": "pit", "camera": "cam", "seq": self._seq, "time": datetime(2026, 1, 1, tzinfo=UTC).isoformat(),
            "valid_s": 3.0, "valid": valid, "rois": {"apron": apron},
        }  # fmt: skip
        self.board.on_heartbeat("lumpwatch/v1/pit/cam/heartbeat", json.dumps(told).encode())

    @property
    def status(self) -> str:
        return str(self.board.snapshot()["regions"][0]["status"])


def test_silence_is_never_clear() -> None:
    told = Told()
    assert told.status == "SILENT"
    told.state()
    assert told.status == "SILENT", "without a heartbeat a state may be of yesterday"
    told.beat()
    assert told.status == "SILENT", "the first heartbeat may be one that the bus kept of a dead monitor"
    told.beat()
    assert told.status == "CLEAR"
    told.now_s += 3.1
    assert told.status == "SILENT"
    told.state()
    assert told.status == "SILENT", "states alone are no sign that they are valid"
    told.beat()
    assert told.status == "CLEAR"


@pytest.mark.parametrize(("valid", "region"), [(False, True), (True, False)])
def test_a_heartbeat_that_is_not_valid_is_none(valid: bool, region: bool) -> None:
    told = Told()
    told.state()
    told.beat()
    told.beat(valid, region)
    assert told.status == "SILENT"


def test_the_same_heartbeat_again_does_not_count_as_a_new_one() -> None:
    told = Told()
    told.state()
    told.beat()
    told.beat()
    told.now_s += 3.1
    told._seq -= 1
    told.beat()
    assert told.status == "SILENT"


def test_states_are_found_by_their_frame_and_the_curve_is_thinned() -> None:
    told = Told()
    for frame in range(100):
        told.now_s += 0.04
        told.state(frame=frame, existence=frame / 100)
    decided = told.board.decided_on("cam")
    assert max(decided) == 99
    assert len(decided) == 90, "what is kept is bounded"
    assert json.loads(decided[99]["apron"])["existence"] == 0.99
    assert 18 <= len(told.board.curve("cam", "apron")) <= 21


def test_what_is_malformed_is_counted_and_harmless() -> None:
    told = Told()
    told.board.on_state("x", b"\xff")
    told.board.on_state("lumpwatch/v1/pit/cam/apron/state", b'{"frame":1,"existence":e}')
    told.board.on_heartbeat("lumpwatch/v1/pit/cam/heartbeat", b"{}")
    told.board.on_alarm("lumpwatch/v1/pit/cam/apron/alarm", b"[]")
    assert told.status == "SILENT"
    assert told.board.malformed >= 3
