"""Trends: what the log and the bus say, hour by hour."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.ages import HOUR_S, Ages
from lumpwatch.service.console.reports import events, shift
from lumpwatch.service.console.trends import TrendError, hours_of, trends
from lumpwatch.service.core import Alarm, AlarmClass
from lumpwatch.service.storage import Entry, Event, EventLogError, EventWriter, Span
from tests.service_helpers import site, site_tree
from tests.storage.test_event_log import Counting

NOW_S = 1_000_000 * HOUR_S + 1800.0


def raised(
    time_s: float, longest_mm: float | None, roi: str = "apron", alarm: AlarmClass = AlarmClass.LUMP
) -> Event:
    return Event(
        time_s=time_s, monotonic_s=0.0, clock="c", camera="cam", roi=roi, alarm_class=alarm, change="raised",
        before="NORMAL", after="UNACKNOWLEDGED", actor=None, reason=None, existence=0.9, frame=1, id=str(time_s),
        sequence=int(time_s), alarm=Alarm(active=True), details={"longest_mm": longest_mm},
    )  # fmt: skip


@pytest.fixture
def config(tmp_path: Path) -> SiteConfig:
    tree = site_tree()
    tree["store"] = {"path": str(tmp_path)}
    return site(tree)


def write(config: SiteConfig, events: list[Event], spans: list[Span]) -> None:
    writer = EventWriter(config.store.path, "cam", Counting(), lambda: NOW_S)
    assert writer.write([Entry(event, b"") for event in events])
    assert writer.add(spans, wait=True)
    writer.close()


def no_age(where: tuple[str, str], hour: int, share: float) -> None:
    return None


def test_percentiles_are_right_within_the_scale_and_hours_stay_apart() -> None:
    ages, rng = Ages(), random.Random(1)
    values = [rng.lognormvariate(-3, 1) for _ in range(2000)]
    for value in values:
        ages.add(value, 10 * HOUR_S + 5)
    ages.add(9.0, 11 * HOUR_S)
    values.sort()
    for share in (0.5, 0.99, 1.0):
        assert ages.percentile(10, share) == pytest.approx(values[round(share * 2000) - 1], rel=0.04)
    assert ages.percentile(11, 0.5) == pytest.approx(9.0, rel=0.04)
    assert ages.percentile(12, 0.5) is None
    ages.add(0.0, 12 * HOUR_S)
    assert ages.percentile(12, 0.5) == 0.001


def test_only_a_week_is_kept() -> None:
    ages = Ages()
    for hour in range(200):
        ages.add(0.1, hour * HOUR_S)
    assert ages.percentile(31, 0.5) is None
    assert ages.percentile(32, 0.5) is not None


@pytest.mark.parametrize(
    "text", ["0", "-1", "169", "1.5", "x", "", "<b>", "9" * 30, "0" * 5 + "19999999", "²"]
)
def test_hours_that_are_none_are_named(text: str) -> None:
    with pytest.raises(TrendError, match="hours"):
        hours_of(text)


def test_lumps_their_size_and_blind_time_fall_into_their_hours(config: SiteConfig) -> None:
    begin = NOW_S - NOW_S % HOUR_S
    write(
        config,
        [
            raised(begin - 2 * HOUR_S - 1, 999.0),  # before what was asked for
            raised(begin - 10, 640.0),
            raised(begin - 5, 810.0),
            raised(begin + 5, None),
            raised(begin + 6, 700.0, alarm=AlarmClass.BLIND),
        ],
        [Span(begin - 600, begin + 600, "apron", 600.0, {"dusty": 400.0, "dark": 200.0})],
    )
    (row,) = trends(config, 2, NOW_S, lambda where, hour, share: 0.05 if hour == begin // HOUR_S else None)
    before, now = row["hours"]
    assert (before.lumps, before.largest_mm, now.lumps, now.largest_mm) == (2, 810.0, 1, None)
    assert (before.blind_min, now.blind_min) == pytest.approx((5.0, 5.0))
    assert (before.watched_min, now.watched_min) == pytest.approx((10.0, 10.0))
    assert (before.age_ms, now.age_ms) == (None, pytest.approx(50.0))


def test_without_a_log_it_is_said(config: SiteConfig) -> None:
    for read in (lambda: shift(config, "current", NOW_S), lambda: events(config, {}, NOW_S)):
        with pytest.raises(EventLogError, match="no event log"):
            read()
    (row,) = trends(config, 3, NOW_S, no_age)
    assert row["logged"] is False
    assert [(hour.lumps, hour.unknown) for hour in row["hours"]] == [(0, True)] * 3
