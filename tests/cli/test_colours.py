"""Colours of states: on a terminal only, and not where NO_COLOR is set."""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

from lumpwatch.service.cli import events, replay
from lumpwatch.service.cli.alarms import _Follower, describe_alarm, describe_state
from lumpwatch.service.cli.colours import coloured
from lumpwatch.service.core import Alarm, AlarmClass
from lumpwatch.service.offline import RoiSummary, Summary
from lumpwatch.service.storage import Event
from tests.protocol.test_messages import RECORDS

RED, VIOLET, PLAIN = "\x1b[1;31m", "\x1b[1;35m", "\x1b[0m"
LINE = "cam/apron: BLIND (dark), alarm NORMAL"


def printed(
    monkeypatch: pytest.MonkeyPatch, name: str = "", value: str = "", *, as_json: bool = False
) -> str:
    """What a follower prints of LINE on a terminal."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    if name:
        monkeypatch.setenv(name, value)
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "w") as terminal, monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", terminal)
        _Follower("site", {"cam": ["apron"]}, as_json, None, False)._line(LINE)
        told = os.read(ours, 4096).decode()
    os.close(ours)
    return told.rstrip("\r\n")


def test_a_terminal_gets_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    assert printed(monkeypatch) == LINE.replace("BLIND", f"{VIOLET}BLIND{PLAIN}")


@pytest.mark.parametrize("environment", [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_a_terminal_that_wants_none_gets_none(
    monkeypatch: pytest.MonkeyPatch, environment: tuple[str, str]
) -> None:
    assert printed(monkeypatch, *environment) == LINE


def test_an_empty_no_color_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    assert VIOLET in printed(monkeypatch, "NO_COLOR", "")


def test_records_have_no_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    assert printed(monkeypatch, as_json=True) == LINE


def test_what_is_no_terminal_gets_none(capsys: pytest.CaptureFixture[str]) -> None:
    _Follower("site", {"cam": ["apron"]}, False, None, False)._line(LINE)
    assert capsys.readouterr().out == f"{LINE}\n"


def test_control_characters_of_others_stay_harmless(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules[__name__], "LINE", "cam/a: shelved by \x1b[31mx")
    assert "\x1b" not in printed(monkeypatch)


def test_states_and_alarms_in_colours() -> None:
    alarm, state = (json.dumps(RECORDS[of][0]).encode() for of in ("alarm", "state"))
    assert f"cam/apron: {RED}raised{PLAIN}, now" in coloured(describe_alarm(alarm))
    assert f"cam/apron: {RED}LUMP{PLAIN}, alarm" in coloured(describe_state(state))
    test = describe_alarm(alarm).replace(": raised", ": TEST raised")
    assert f": {RED}TEST raised{PLAIN}, now" in coloured(test)
    blind = describe_alarm(alarm).replace(": raised", ": blind raised")
    assert f": {VIOLET}blind raised{PLAIN}, now" in coloured(blind)
    assert f"cam: {VIOLET}SILENT{PLAIN}," in coloured("cam: SILENT, no heartbeat")
    cleared = describe_alarm(alarm).replace(": raised", ": cleared")
    assert coloured(cleared) == cleared


def event(alarm_class: str, change: str) -> Event:
    return Event(
        time_s=1.7e9,
        monotonic_s=5.0,
        clock="c",
        camera="cam",
        roi="apron",
        alarm_class=AlarmClass(alarm_class),
        change=change,
        before="NORMAL",
        after="UNACKNOWLEDGED",
        actor=None,
        reason=None,
        existence=0.9,
        frame=1,
        id="1",
        sequence=1,
        alarm=Alarm(),
    )


@pytest.mark.parametrize(("no_color", "coloured_cells"), [(None, True), ("1", False)])
def test_tables_have_the_same_colours(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    no_color: str | None,
    coloured_cells: bool,
) -> None:
    """Of a replay and of the event log, as a terminal gets them."""
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "xterm"), ("COLUMNS", "200")):
        monkeypatch.setenv(name, value)
    if no_color is None:
        monkeypatch.delenv("NO_COLOR", raising=False)
    else:
        monkeypatch.setenv("NO_COLOR", no_color)
    counts = RoiSummary(frames=10, states=Counter(LUMP=2, BLIND=1, CLEAR=7), blind=Counter(dark=1))
    summary = Summary("pit", "cam", "a.mp4", frames=10, rois={"apron": counts})
    replay._print(summary, Path("out"), 1.0, True)
    events._table(iter([event("lump", "raised"), event("blind", "raised"), event("lump", "cleared")]))
    told = capsys.readouterr().out
    assert (re.search(rf"{re.escape(RED)} *20.0 %", told) is not None) is coloured_cells
    assert (re.search(rf"{re.escape(VIOLET)} *10.0 % dark", told) is not None) is coloured_cells
    for colour in (RED, VIOLET):
        assert (
            re.search(rf"{re.escape(colour)}raised *{re.escape(PLAIN)}", told) is not None
        ) is coloured_cells
    assert "cleared" in told
    assert f"{RED}cleared" not in told
