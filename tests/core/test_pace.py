"""Which frames are decided on: evenly apart, no fewer than asked, and the same for all who see them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lumpwatch.service.core.pace import Pace


def taken(pace: Pace, times: list[float]) -> list[float]:
    return [time_s for time_s in times if pace.take(time_s)]


def camera(fps: float, seconds: float, start_s: float = 0.0) -> list[float]:
    return [start_s + k / fps for k in range(round(seconds * fps))]


@pytest.mark.parametrize(
    ("fps", "every"),
    [(10, 1), (15, 1), (18, 1), (20, 2), (24, 2), (25, 2), (29.97, 3), (30, 3), (50, 5), (60, 6)],
)
def test_at_ten_a_second_every_so_manieth_is_taken(fps: float, every: int) -> None:
    times = camera(fps, 20.0)
    found = taken(Pace(10.0), times)
    # The first two come before the camera's interval is known.
    assert found[2:] == times[times.index(found[2]) :: every]
    assert len(found) / 20.0 >= min(fps, 10.0) / 1.05 - 0.1


def test_every_frame_is_taken_without_a_rate() -> None:
    times = camera(60.0, 1.0)
    assert taken(Pace(), times) == times


@settings(deadline=None, max_examples=60)
@given(
    fps=st.floats(1.0, 120.0),
    rate_hz=st.floats(2.0, 30.0),
    tremble=st.floats(0.0, 0.1),
    seed=st.integers(0, 99),
)
def test_no_gap_is_longer_than_asked(fps: float, rate_hz: float, tremble: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = [t + rng.uniform(0.0, tremble / fps) for t in camera(fps, 10.0)]
    found = taken(Pace(rate_hz), times)
    assert found[0] == times[0]
    gaps = np.diff(found)
    assert (gaps <= max(1.05 / rate_hz, 1.0 / fps) + 2 * tremble / fps + 1e-9).all()
    # Nor is one taken that the next would have done for.
    assert (gaps[2:] >= min(1.05 / rate_hz, 1.0) - 1.0 / fps - 3 * tremble / fps - 1e-9).all()


@pytest.mark.parametrize("fps", [15.0, 24.0, 25.0, 30.0, 60.0])
def test_what_was_taken_is_taken_whole_by_the_next_who_chooses(fps: float) -> None:
    first = taken(Pace(10.0), camera(fps, 10.0))
    assert taken(Pace(10.0), first) == first
    for start in range(1, 8):  # began later, as a monitor does that was restarted
        assert taken(Pace(10.0), first[start:]) == first[start:]


def test_after_an_outage_frames_come_as_before() -> None:
    pace = Pace(10.0)
    taken(pace, camera(25.0, 2.0))
    after = taken(pace, camera(25.0, 2.0, start_s=60.0))
    assert after[:3] == [60.0, 60.08, 60.16]


def test_a_frame_that_was_lost_costs_no_other() -> None:
    times = camera(25.0, 4.0)
    whole = taken(Pace(10.0), times)
    found = taken(Pace(10.0), [time_s for time_s in times if time_s != whole[10]])
    assert max(np.diff(found)) < 0.121  # its neighbour came in its place
    assert len(found) >= len(whole) - 1


def test_it_goes_on_from_a_state() -> None:
    times = camera(25.0, 4.0)
    pace, other = Pace(10.0), Pace(10.0)
    taken(pace, times[:51])
    other.restore(pace.state())
    assert taken(other, times[51:]) == taken(pace, times[51:])
