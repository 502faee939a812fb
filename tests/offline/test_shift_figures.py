"""The figures of a shift against numbers worked by hand."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.intervals import binomial_interval
from lumpwatch.service.cli import main
from lumpwatch.service.config.evidence import ShiftsConfig
from lumpwatch.service.core.alarm import AlarmClass
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.offline.shift_report import shift_page
from lumpwatch.service.shift.figures import Figures, in_ten_minutes, shift_figures, uptime
from lumpwatch.service.shift.record import roi_record
from lumpwatch.service.shift.window import Window, report_window
from lumpwatch.service.storage.event_log import Entry, EventLog, event_file
from lumpwatch.service.storage.event_notes import Span, Verdict, VerdictOutcome
from tests.offline.shift_scene import BEGIN_S, event
from tests.service_helpers import site_tree

HOUR = Window("hour", BEGIN_S, BEGIN_S + 3600)

# An hour with four lumps, by hand:
#   600 s   no. 1, 12 s to the lip, 400 mm at first and 520 mm in the end; acknowledged after 30 s; true
#   1200 s  no. 4, 8 s, no size; acknowledged after 90 s; false, then true, at last false
#   1800 s  no. 7, 10 s, 600 mm; never acknowledged; unsure
#   3500 s  no. 9, nothing known; acknowledged after 200 s, which is after the shift; not judged
EVENTS = [
    event(-100, "raised", 99),  # before the shift
    event(600, "raised", 1, lip_s=12.0, longest_mm=400.0, evidence="id-000001"),
    event(630, "acknowledged", 2, actor="Ada"),
    event(640, "cleared", 3, longest_mm=520.0),
    event(1200, "raised", 4, lip_s=8.0),
    event(1210, "cleared", 5),
    event(1290, "acknowledged", 6, actor="Bob"),
    event(1800, "raised", 7, lip_s=10.0, longest_mm=600.0),
    event(1900, "re_alarmed", 8),
    event(2000, "raised", 20, alarm_class=AlarmClass.BLIND),
    event(2010, "acknowledged", 21, alarm_class=AlarmClass.BLIND, actor="Ada"),
    event(2500, "shelved", 22, actor="Ada"),
    event(2600, "active", 23),
    event(2700, "inactive", 24),
    event(3500, "raised", 9),
    event(3700, "acknowledged", 10, actor="Ada"),
    event(3800, "raised", 11),  # after the shift
]
SAID = [
    (1, VerdictOutcome.TRUE),
    (4, VerdictOutcome.FALSE),
    (4, VerdictOutcome.TRUE),
    (4, VerdictOutcome.FALSE),
    (7, VerdictOutcome.UNSURE),
]
VERDICTS = [
    Verdict(BEGIN_S + 5000 + k, "apron", f"id-{number:06d}", number, says, "Eve", "<dust>")
    for k, (number, says) in enumerate(SAID)
]
# Watched from -30 s on, a minute each, but not from 1770 s to 2370 s (600 s). Blind: 6 s of each minute for
# no stream from 2370 s on, and 60 s for dark from 570 s to 630 s.
SPANS = [
    Span(
        BEGIN_S + at,
        BEGIN_S + at + 60,
        "apron",
        0.0 if at == 570 else 54.0 if at >= 2370 else 60.0,
        {"dark": 60.0} if at == 570 else {"no_stream": 6.0} if at >= 2370 else {},
    )
    for at in range(-30, 3600, 60)
    if not 1770 <= at < 2370
]


def found() -> Figures:
    said = {(one.roi, one.id): one for one in VERDICTS}
    record = roi_record(("cam", "apron"), EVENTS, HOUR, said)
    record.spans = SPANS
    return shift_figures("pit", HOUR, [record], BEGIN_S + 9999)


def check(told: Figures) -> None:
    roi = told["rois"][0]
    for part in (told["total"], roi):
        assert part["lumps"] == 4
        # By the hour watched: 2817 s were seen, see below.
        assert part["alarms_per_hour"] == pytest.approx(4 / (2817 / 3600), abs=1e-4)
        assert part["announcements"] == 4
        assert part["longest_mm"] == {"count": 2, "median": 560.0, "worst": 600.0, "values": [520.0, 600.0]}
        assert part["warning_s"] == {"count": 3, "median": 10.0, "worst": 8.0, "values": [8.0, 10.0, 12.0]}
        assert part["acknowledge_s"] == {
            "count": 3,
            "median": 90.0,
            "worst": 200.0,
            "values": [30.0, 90.0, 200.0],
        }
        assert part["unacknowledged"] == 1
        assert part["verdicts"] == {"true": 1, "false": 1, "unsure": 1, "none": 1}
        assert part["precision"] == 0.5
        # Clopper and Pearson for 1 of 2: 1 - sqrt(0.975) and sqrt(0.975).
        assert part["precision_interval"] == pytest.approx([0.012579, 0.987421], abs=1e-6)
        assert part["held"] == 1
        assert part["blind_alarms"] == 1
    # Not watched: 600 s. Blind: 60 s dark; no stream: the minutes from 2370 to 3570 (20 x 6 s), and half of
    # the one that reaches over the end (3 s). Seen: 3600 - 600 - 60 - 123 = 2817 s.
    assert roi["blind_minutes"] == {"dark": 1.0, "no_stream": 2.05}
    assert roi["unknown_minutes"] == 10.0
    assert roi["availability"] == pytest.approx(2817 / 3600, abs=1e-6)
    assert told["rates"] == {
        "ten_minutes_mean": 0.852,
        "ten_minutes_peak": 1,
        "flood_share": 0.0,
        "eemua_191": "very likely acceptable",
    }
    alarms = told["alarms"]
    assert [one["sequence"] for one in alarms] == [1, 4, 7, 9]
    assert [one["lasted_s"] for one in alarms] == [40.0, 10.0, 900.0, None]
    assert [one["verdict"] for one in alarms] == ["true", "false", "unsure", None]
    assert [one["acknowledged_by"] for one in alarms] == ["Ada", "Bob", None, "Ada"]
    assert [one["evidence"] for one in alarms] == ["id-000001", None, None, None]


def test_a_shift_worked_by_hand() -> None:
    check(found())


def test_the_same_from_the_event_log_by_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = EventLog(event_file(tmp_path / "var", "cam"))
    log.append([Entry(one, b"{}") for one in EVENTS])
    log.add([*VERDICTS, *SPANS])
    log.close()
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(site_tree() | {"store": {"path": str(tmp_path / "var")}}))
    asked = ["report", str(config), "--shift", "2023-11-14T22:13:20/1h"]
    assert main(asked) == 0
    told = json.loads(capsys.readouterr().out)
    check(told)
    assert (told["shift"]["begin"], told["shift"]["hours"]) == ("2023-11-14T22:13:20+00:00", 1.0)
    out = tmp_path / "shift.html"
    assert main([*asked, "--out", str(out), "--json", str(tmp_path / "shift.json")]) == 0
    again = json.loads((tmp_path / "shift.json").read_text())
    assert {key: again[key] for key in again if key != "generated"} == {
        key: told[key] for key in told if key != "generated"
    }
    text = out.read_text()
    assert "50 %" in text
    assert "src='http" not in text
    assert "&lt;dust&gt;" in text
    assert "<dust>" not in text
    assert main([*asked, "--out", str(tmp_path / "no" / "page.html")]) == 1
    assert "cannot be written" in capsys.readouterr().err


def test_the_same_shift_gives_the_same_page() -> None:
    record = roi_record(("cam", "apron"), EVENTS, HOUR, {})
    record.spans = SPANS
    told = shift_figures("pit", HOUR, [record], BEGIN_S)
    pages = {shift_page(told, [record], HOUR, ZoneInfo("UTC"), {}) for _ in range(2)}
    assert len(pages) == 1


def test_a_shift_of_nothing_is_not_a_good_one() -> None:
    record = roi_record(("cam", "apron"), [], HOUR, {})
    told = shift_figures("pit", HOUR, [record], BEGIN_S)
    assert told["rois"][0]["availability"] == 0.0
    assert told["rois"][0]["unknown_minutes"] == 60.0
    assert told["total"]["precision"] is None
    assert told["total"]["precision_interval"] == list(binomial_interval(0, 0)) == [0.0, 1.0]
    assert "None." in shift_page(told, [record], HOUR, ZoneInfo("UTC"), {})


def test_times_after_a_reboot_are_by_the_wall_clock() -> None:
    events = [event(0, "raised", 1), event(77, "acknowledged", 2, actor="Ada", clock="later")]
    (one,) = roi_record(("cam", "apron"), events, HOUR, {}).alarms
    assert one.acknowledged_after_s == pytest.approx(77.0)


def test_what_is_announced_again_while_it_is_there_is_one_lump() -> None:
    """Raised, and again after a shelving: one lump. A minute later: another one."""
    events = [
        event(0, "raised", 1, lip_s=8.0),
        event(5, "shelved", 2),
        event(9, "raised", 3),
        event(30, "cleared", 6, longest_mm=700.0),
        event(90, "raised", 7),
    ]
    said = {
        ("apron", "id-000003"): Verdict(BEGIN_S, "apron", "id-000003", 3, VerdictOutcome.TRUE, "Eve", None)
    }
    record = roi_record(("cam", "apron"), events, HOUR, said)
    assert [(story.raised.sequence, len(story.again)) for story in record.alarms] == [(1, 1), (7, 0)]
    first = record.alarms[0]
    assert (first.lasted_s, first.number("longest_mm"), first.number("lip_s")) == (30.0, 700.0, 8.0)
    assert first.verdict is not None
    told = shift_figures("pit", HOUR, [record], BEGIN_S)
    assert (told["total"]["lumps"], told["total"]["announcements"]) == (2, 3)
    assert told["total"]["alarms_per_hour"] is None  # nobody watched


def test_a_page_says_over_how_many_lumps_a_median_goes() -> None:
    record = roi_record(("cam", "apron"), EVENTS, HOUR, {})
    record.spans = SPANS
    page = shift_page(found(), [record], HOUR, ZoneInfo("UTC"), {})
    assert "median warning before the lip (known of 3 of 4)" in page
    assert "announcements an hour watched (4 in 47 min)" in page
    assert "Content-Security-Policy" in page


def test_a_flood_is_called_one() -> None:
    events = [event(30.0 * k, "raised", k) for k in range(1, 120)]
    told = shift_figures("pit", HOUR, [roi_record(("cam", "apron"), events, HOUR, {})], BEGIN_S)
    # 119 alarms in six times ten minutes, 19 in the first (one is at 0) and 20 in the others.
    assert told["rates"] == {
        "ten_minutes_mean": 19.8333,
        "ten_minutes_peak": 20,
        "flood_share": 1.0,
        "eemua_191": "very likely unacceptable",
    }


# Watching


@given(
    st.lists(
        st.tuples(
            st.floats(-4000, 4000), st.floats(0.1, 2000), st.floats(0, 1), st.sampled_from(["dark", "dust"])
        ),
        max_size=12,
    )
)
def test_no_more_is_seen_than_the_shift_lasts(drawn: list[tuple[float, float, float, str]]) -> None:
    spans = [
        Span(BEGIN_S + at, BEGIN_S + at + lasts, "apron", share * lasts, {why: (1 - share) * lasts})
        for at, lasts, share, why in drawn
    ]
    seen_s, blind_s = uptime(spans, HOUR)
    assert seen_s >= 0.0
    assert seen_s + sum(blind_s.values()) <= 3600 + 1e-6
    # The union of the spans within the hour, by brute force over its ends.
    ends = sorted(
        {0.0, 3600.0, *(min(max(at + d, 0.0), 3600.0) for at, lasts, *_ in drawn for d in (0, lasts))}
    )
    union = sum(
        b - a for a, b in pairwise(ends) if any(at <= (a + b) / 2 < at + lasts for at, lasts, *_ in drawn)
    )
    assert seen_s + sum(blind_s.values()) == pytest.approx(union, abs=1e-3)


def test_the_last_ten_minutes_may_be_shorter() -> None:
    assert in_ten_minutes([BEGIN_S, BEGIN_S + 599.9, BEGIN_S + 601], Window("", BEGIN_S, BEGIN_S + 610)) == [
        2,
        1,
    ]


# Shifts

PERTH = ShiftsConfig(time_zone="Australia/Perth")  # UTC+8, no summer time


def at(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("text", "now", "name", "begin", "end"),
    [
        # 10:30 in Perth: the day shift runs since 06:00, the night shift is the last one that is over.
        ("last", "2026-11-22T02:30", "night", "2026-11-21T10:00", "2026-11-21T22:00"),
        ("night", "2026-11-22T02:30", "night", "2026-11-21T10:00", "2026-11-21T22:00"),
        ("day", "2026-11-22T02:30", "day", "2026-11-20T22:00", "2026-11-21T10:00"),
        ("current", "2026-11-22T02:30", "day (so far)", "2026-11-21T22:00", "2026-11-22T02:30"),
        # 03:00 in Perth: it is the night shift of yesterday.
        ("current", "2026-11-21T19:00", "night (so far)", "2026-11-21T10:00", "2026-11-21T19:00"),
        ("last", "2026-11-21T19:00", "day", "2026-11-20T22:00", "2026-11-21T10:00"),
        ("day@2026-03-01", "2026-11-21T19:00", "day", "2026-02-28T22:00", "2026-03-01T10:00"),
        (
            "2026-11-22T06:00/12h",
            "2026-01-01T00:00",
            "2026-11-22 06:00",
            "2026-11-21T22:00",
            "2026-11-22T10:00",
        ),
        (
            "2026-11-22T06:00Z/90m",
            "2026-01-01T00:00",
            "2026-11-22 14:00",
            "2026-11-22T06:00",
            "2026-11-22T07:30",
        ),
        (
            "2026-11-22T06:00/2026-11-22T08:00",
            "2026-01-01T00:00",
            "2026-11-22 06:00",
            "2026-11-21T22:00",
            "2026-11-22T00:00",
        ),
    ],
)
def test_which_time_is_meant(text: str, now: str, name: str, begin: str, end: str) -> None:
    assert report_window(text, PERTH, at(now)) == Window(name, at(begin), at(end))


def test_a_night_in_which_the_clock_is_put_back_lasts_an_hour_longer() -> None:
    berlin = ShiftsConfig(time_zone="Europe/Berlin")
    autumn = report_window("night@2026-10-24", berlin, at("2026-12-01T00:00"))
    spring = report_window("night@2026-03-28", berlin, at("2026-12-01T00:00"))
    assert (autumn.lasts_s / 3600, spring.lasts_s / 3600) == (13, 11)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("noon", "day, night; or last, current"),
        ("day@yesterday", "'yesterday' is not a date"),
        ("then/12h", "'then' is not a time"),
        ("2026-11-22T06:00/soon", "'soon' is not a time"),
        ("2026-11-22T06:00/2026-11-22T05:00", "ends before it begins"),
        ("night@9999-12-31", "'9999-12-31' is not a date"),
        ("2026-11-22T06:00/9999-12-31T23:59", "'9999-12-31T23:59' is not a time"),
        ("2026-11-22T06:00/2030-01-01T00:00", "longer than 400 days"),
        ("2026-11-22T06:00/99999999999h", "longer than 400 days"),
        ("0001-01-01T00:00/12h", "'0001-01-01T00:00' is not a time"),
    ],
)
def test_what_is_no_time_is_told_so(text: str, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        report_window(text, PERTH, at("2026-11-22T02:30"))
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("tree", "told"),
    [
        ({"time_zone": "Mars/Olympus"}, "time zone 'Mars/Olympus' is not known"),
        ({"starts": {"a": "06:00", "b": "06:00"}}, "two shifts begin"),
        ({"starts": {"last": "06:00"}}, "cannot be called 'last'"),
        ({"starts": {"a": "6 am"}}, "pattern"),
        ({"starts": {}}, "at least 1"),
    ],
)
def test_shifts_that_make_no_sense_are_refused(tree: dict[str, object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        ShiftsConfig.model_validate(tree)


def test_without_an_event_log_there_is_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "site.yaml"
    config.write_text(json.dumps(site_tree() | {"store": {"path": str(tmp_path / "var")}}))
    assert main(["report", str(config)]) == 1
    assert "holds no event log" in capsys.readouterr().err


def test_a_lump_that_is_shelved_again_and_again_is_one_lump() -> None:
    changes = ["raised", *["shelved", "unshelved", "raised"] * 5, "cleared", "raised"]
    events = [event(600 + k, change, k + 1) for k, change in enumerate(changes)]
    record = roi_record(("cam", "apron"), events, HOUR, {})
    assert [story.raised.sequence for story in record.alarms] == [1, len(changes)]
    assert record.alarms[0].cleared is not None
