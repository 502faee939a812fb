"""Times as people at the site read and type them."""

from __future__ import annotations

from datetime import datetime

import pytest

from lumpwatch.service.console.times import SiteTimes
from tests.service_helpers import site, site_tree


@pytest.fixture
def perth() -> SiteTimes:
    return SiteTimes(site(site_tree() | {"shifts": {"time_zone": "Australia/Perth"}}))


def test_times_stand_in_the_zone_of_the_shifts(perth: SiteTimes) -> None:
    assert perth.moment("2026-11-30T19:05:44.9+00:00") == "2026-12-01 03:05:44"
    assert perth.minute(datetime.fromisoformat("2026-11-30T19:05:00+00:00").timestamp()) == "01. 03:05"
    assert SiteTimes(site(site_tree())).moment("2026-11-30T19:05:44+02:00") == "2026-11-30 17:05:44"


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("2026-12-01T03:00", "2026-11-30T19:00+00:00"),
        ("2026-12-01", "2026-11-30T16:00+00:00"),
        ("2026-12-01T03:00+01:00", "2026-12-01T02:00+00:00"),
        ("2h", "2026-11-30T17:00+00:00"),
    ],
)
def test_a_time_without_a_zone_is_the_sites(perth: SiteTimes, typed: str, meant: str) -> None:
    now_s = datetime.fromisoformat("2026-11-30T19:00+00:00").timestamp()
    assert perth.seconds_of(typed, now_s) == datetime.fromisoformat(meant).timestamp()


@pytest.mark.parametrize("typed", ["", "tomorrow", "<b>", "2h later"])
def test_what_is_no_time_is_none(perth: SiteTimes, typed: str) -> None:
    assert perth.seconds_of(typed, 0.0) is None
