"""Stamps of cameras whose clocks run at a wrong rate, stand still, or count in another unit."""

from __future__ import annotations

import numpy as np
import pytest

from lumpwatch.service.core.camera_clock import CameraClock


def stream(
    clock: CameraClock, rate: float, fps: float, seconds: float, *, jitter_s: float = 0.02, at_s: float = 50.0
) -> tuple[list[float], list[float], list[str]]:
    """Received and capture times of a camera whose clock counts `rate` seconds a second, and what was said."""
    rng = np.random.default_rng(3)
    received_s, captures, told, last = [], [], [], at_s
    for k in range(round(seconds * fps * rate)):
        pts = k / fps  # frames as declared
        last = max(last, at_s + pts / rate + float(rng.exponential(jitter_s)))
        captures.append(clock.stamp(pts, last).capture_s)
        received_s.append(last)
        if clock.news is not None:
            told.append(clock.news)
            clock.news = None
    return received_s, captures, told


@pytest.mark.parametrize("fps", [10.0, 25.0, 60.0])
@pytest.mark.parametrize("rate", [0.7, 0.84, 0.95, 1.05, 1.3])
def test_a_clock_at_a_wrong_rate_is_put_right_and_told_once(rate: float, fps: float) -> None:
    received, captures, told = stream(CameraClock(), rate, fps, 60.0)
    ages = np.subtract(received, captures)
    assert ages.min() >= 0.0
    assert ages.max() < 2.0  # never stale
    later = np.searchsorted(received, received[0] + 6.0)
    assert ages[later:].max() < 0.4
    # True seconds: what is seen to move a second on the belt does so in a second of captures.
    spans = (captures[-1] - captures[later]) / (received[-1] - received[later])
    assert spans == pytest.approx(1.0, abs=0.01)
    share, way = round(abs(rate - 1.0) * 100), "slow" if rate < 1.0 else "fast"
    (news,) = told
    assert way in news
    assert abs(int(news.split()[3]) - share) <= 1


@pytest.mark.parametrize("fps", [10.0, 25.0, 60.0])
@pytest.mark.parametrize("rate", [0.999, 1.0, 1.001])
def test_a_right_clock_is_left_alone(rate: float, fps: float) -> None:
    clock = CameraClock()
    _, _, told = stream(clock, rate, fps, 60.0, jitter_s=0.05)
    assert (told, clock.second_s, clock.by_arrival) == ([], 1.0, False)


def test_a_connection_made_anew_begins_with_the_rate_that_is_known() -> None:
    clock = CameraClock()
    stream(clock, 0.84, 25.0, 20.0)
    clock.restart()
    received, captures, told = stream(clock, 0.84, 25.0, 20.0, at_s=100.0)
    assert np.subtract(received, captures).max() < 0.3
    assert told == []


def test_a_network_that_falls_behind_later_is_not_taken_for_a_slow_clock() -> None:
    clock = CameraClock()
    stream(clock, 1.0, 25.0, 40.0, jitter_s=0.0)
    received = [90.0 + k * 0.04 * 1.2 for k in range(250)]
    captures = [clock.stamp(40.0 + k * 0.04, received[k]).capture_s for k in range(250)]
    assert received[-1] - captures[-1] > 1.5
    assert (clock.second_s, clock.news) == (1.0, None)


def test_a_stall_and_its_burst_bend_nothing() -> None:
    clock = CameraClock()
    late = [k for k in range(250) if 50 <= k < 100]
    for k in range(250):
        assert (
            clock.stamp(k * 0.04, 10.0 + (4.0 if k in late else k * 0.04)).capture_s <= 10.0 + k * 0.04 + 4.0
        )
    assert (clock.second_s, clock.by_arrival, clock.news) == (1.0, False, None)


@pytest.mark.parametrize("scale", [1 / 90, 90.0, 0.2, 3.0])
def test_stamps_in_another_unit_give_way_to_arrivals(scale: float) -> None:
    clock = CameraClock()
    ages = []
    for k in range(500):
        received = 20.0 + k * 0.04
        ages.append(received - clock.stamp(k * 0.04 * scale, received).capture_s)
    assert clock.by_arrival
    assert clock.news is not None
    assert "contradict" in clock.news
    assert max(ages[130:]) == 0.0


@pytest.mark.parametrize(("patience_s", "stands_s"), [(0.75, 0.75), (60.0, 2.0)])
def test_stamps_that_stand_still_give_way_to_arrivals(patience_s: float, stands_s: float) -> None:
    clock = CameraClock(patience_s)
    clock.stamp(0.0, 10.0)
    for k in range(1, 60):
        assert clock.by_arrival == ((k - 1) * 0.04 > stands_s + 0.02)
        clock.repeated(10.0 + k * 0.04)
    assert clock.by_arrival
    assert [clock.stamp(0.0, t).capture_s for t in (13.0, 13.04)] == [13.0, 13.04]


def test_a_few_repeated_stamps_are_no_standing_clock() -> None:
    clock = CameraClock()
    for k in range(200):
        clock.stamp(k * 0.04, 10.0 + k * 0.04)
        clock.repeated(10.0 + k * 0.04 + 0.01)
    assert not clock.by_arrival
