from __future__ import annotations

import math
from itertools import accumulate, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.core.media_time import JUMP_S, LEAK, MediaClock, StreamClock

gaps = st.lists(st.floats(0.001, 2.0), min_size=2, max_size=40)


def arrivals(taken: list[float], delays: list[float]) -> list[float]:
    """When frames arrive that cannot overtake each other."""
    return list(accumulate((t + d for t, d in zip(taken, delays, strict=True)), max))


@given(
    st.lists(
        st.tuples(st.none() | st.floats(-1e6, 1e6), st.floats(0.0, 10.0), st.booleans()),
        min_size=1,
        max_size=40,
    )
)
def test_capture_is_never_after_received_and_never_goes_back(
    frames: list[tuple[float | None, float, bool]],
) -> None:
    clock, received, captures = StreamClock(), 100.0, [-math.inf]
    for pts, gap, restart in frames:
        received += gap
        if restart:
            clock.restart()
        capture = clock.stamp(pts, received).capture_s
        assert captures[-1] <= capture <= received
        captures.append(capture)


@given(gaps, st.data())
def test_capture_lies_between_truth_and_the_smallest_delay_so_far(
    steps: list[float], data: st.DataObject
) -> None:
    taken = list(accumulate(steps))
    delays = data.draw(st.lists(st.floats(0.0, 0.5), min_size=len(taken), max_size=len(taken)))
    received = arrivals(taken, delays)
    clock = StreamClock()
    for n, (true, got) in enumerate(zip(taken, received, strict=True)):
        capture = clock.stamp(true - 77.0, got).capture_s  # the camera's zero is not ours
        fastest = min(received[k] - taken[k] + LEAK * (received[n] - received[k]) for k in range(n + 1))
        assert true - 1e-9 <= capture <= true + fastest + 1e-9


@given(gaps, st.data())
def test_dt_is_right_under_jitter_once_a_frame_came_undelayed(
    steps: list[float], data: st.DataObject
) -> None:
    taken = [0.0, *accumulate(steps)]
    delays = [0.0, *data.draw(st.lists(st.floats(0.0, 0.8), min_size=len(steps), max_size=len(steps)))]
    received = arrivals(taken, delays)
    clock = StreamClock()
    captures = [clock.stamp(t, r).capture_s for t, r in zip(taken, received, strict=True)]
    for (t0, c0), (t1, c1) in pairwise(zip(taken, captures, strict=True)):
        assert c1 - c0 == pytest.approx(t1 - t0, abs=LEAK * (received[-1] + 1e-6))


@pytest.mark.parametrize("rate", [0.999, 0.9999, 1.0, 1.0001, 1.02])
def test_an_hour_of_a_camera_clock_that_drifts_does_not_go_stale(rate: float) -> None:
    clock = StreamClock()
    lags = []
    for i in range(36_000):
        received = 50.0 + i * 0.1
        stamp = clock.stamp(i * 0.1 * rate, received)
        assert not stamp.jumped
        lags.append(received - stamp.capture_s)
    assert max(lags) < 0.001


def test_a_standing_delay_is_forgotten_at_the_rate_of_the_leak() -> None:
    clock = StreamClock()
    clock.stamp(0.0, 10.0)
    lag = [10.0 + i + 1.0 - clock.stamp(float(i), 10.0 + i + 1.0).capture_s for i in range(1, 401)]
    assert lag[0] == pytest.approx(1.0 - 2 * LEAK)
    assert lag[-1] == pytest.approx(1.0 - 401 * LEAK)


def test_a_burst_after_a_stall_shows_its_age() -> None:
    clock = StreamClock(leak=0.0)
    clock.stamp(0.0, 10.0)
    ages = [13.0 - clock.stamp(pts, 13.0).capture_s for pts in (1.0, 2.0, 3.0)]
    assert ages == [2.0, 1.0, 0.0]


def test_a_jump_back_anchors_anew_and_says_so() -> None:
    clock = StreamClock()
    clock.stamp(100.0, 10.0)
    clock.stamp(101.0, 11.0)
    assert clock.stamp(3.0, 12.0) == (12.0, True)
    capture, jumped = clock.stamp(4.0, 13.5)
    assert capture == pytest.approx(13.0 + LEAK * 1.5)
    assert not jumped


def test_a_jump_ahead_is_said_and_the_frame_counts_as_fresh() -> None:
    clock = StreamClock()
    clock.stamp(0.0, 10.0)
    assert clock.stamp(0.5 + JUMP_S, 10.4) == (10.4, True)
    assert not clock.stamp(0.6 + JUMP_S, 10.5).jumped


def test_a_restart_is_no_jump() -> None:
    clock = StreamClock()
    clock.stamp(100.0, 10.0)
    clock.restart()
    assert clock.stamp(0.0, 12.0) == (12.0, False)


def test_frames_without_time_stamps_are_taken_when_received() -> None:
    clock = StreamClock()
    assert [clock.stamp(None, t).capture_s for t in (1.0, 2.0)] == [1.0, 2.0]


@given(
    st.lists(st.tuples(st.none() | st.floats(-1e3, 1e3), st.booleans()), min_size=1, max_size=50),
    st.floats(0.001, 1.0),
)
def test_media_time_starts_at_zero_and_always_rises(
    frames: list[tuple[float | None, bool]], interval: float
) -> None:
    clock = MediaClock(interval)
    times = []
    for pts, lap in frames:
        if lap:
            clock.lap()
        times.append(clock.stamp(pts).capture_s)
    assert times[0] == 0.0
    assert all(a < b for a, b in pairwise(times))


def test_media_time_over_two_laps_is_even() -> None:
    clock = MediaClock(0.5)
    first = [clock.stamp(pts) for pts in (7.0, 7.5, 8.0)]
    clock.lap()
    second = [clock.stamp(pts) for pts in (7.0, 7.5)]
    assert [*first, *second] == [(0.0, False), (0.5, False), (1.0, False), (1.5, False), (2.0, False)]


def test_media_time_over_a_jump_and_a_missing_stamp() -> None:
    clock = MediaClock(0.5)
    got = [clock.stamp(pts) for pts in (0.0, 1.0, 0.2, 0.7, None, 2.2)]
    assert got == [
        (0.0, False),
        (1.0, False),
        (1.5, True),
        (2.0, False),
        (2.5, False),
        (pytest.approx(3.5), False),
    ]
