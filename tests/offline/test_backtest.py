"""Backtests on recordings written by hand: episodes, warnings, curves, recommendations, intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import beta, chi2, poisson

from lumpwatch.models.intervals import (
    RULE_OF_THREE,
    binomial_interval,
    poisson_interval,
    poisson_upper,
)
from lumpwatch.service.config.alarm import AlarmConfig
from lumpwatch.service.offline.backtest.curve import (
    Point,
    Terms,
    VideoRecord,
    curve,
    point_at,
    quiet_time,
    recommend,
    thresholds,
)
from lumpwatch.service.offline.backtest.episodes import Score, alarm_at, score, spans
from lumpwatch.service.offline.backtest.record import Recording
from lumpwatch.service.offline.backtest.truth import Truth, truth_of
from lumpwatch.service.storage.label_file import Box

N = 100
"""Frames of a recording, ten a second: frame k + 1 is at k / 10 s."""
ALARM = AlarmConfig(raise_above=0.9, clear_below=0.5, on_delay_s=0.2, off_delay_s=0.3, latch=True)
ROI = ((0.0, 0.0), (1.0, 0.0), (1.0, 0.8), (0.0, 0.8))
Rectangle = tuple[float, float, float, float]
LUMP: Rectangle = (10.0, 10.0, 20.0, 20.0)
OTHER: Rectangle = (60.0, 10.0, 20.0, 20.0)


def existence(*above: tuple[int, int], level: float = 0.95) -> np.ndarray:
    """`level` at the frames of these ranges (of indices), 0.1 elsewhere."""
    values = np.full(N, 0.1)
    for start, end in above:
        values[start:end] = level
    return values


def recording(
    values: np.ndarray, estimates: Mapping[range, Sequence[Rectangle]] | None = None, length: int = N
) -> Recording:
    shown = sorted((k, box) for frames, boxes in (estimates or {}).items() for k in frames for box in boxes)
    return Recording(
        np.arange(1, N + 1),
        np.arange(N) / 10,
        values,
        np.array([k for k, _ in shown], dtype=np.intp),
        np.array([box for _, box in shown], dtype=float).reshape(-1, 4),
        100,
        100,
        length,
        0,
    )


def track(
    first: int, last: int, *, fall: int | None = None, box: Rectangle = LUMP, number: int = 1
) -> list[Box]:
    """Labels of the frames of these indices, falling from index `fall` on."""
    return [
        Box(k + 1, number, *box, model="fall" if fall is not None and k >= fall else "belt")
        for k in range(first, last + 1)
    ]


def truth(one: Recording, *tracks: list[Box], least_warning_s: float = 1.0) -> Truth:
    return truth_of(one, [box for boxes in tracks for box in boxes], ROI, "fall", least_warning_s)


def judged(one: Recording, *tracks: list[Box], tolerance_s: float = 0.5) -> Score:
    return score(one, truth(one, *tracks), alarm_at(ALARM, 0.9), tolerance_s)


def told(found: Score) -> list[tuple[int, int, str]]:
    return [(episode.raised, episode.cleared, episode.verdict) for episode in found.episodes]


# Episodes


def test_a_lump_is_announced_from_the_raise_on() -> None:
    """Above from index 30: raised 0.2 s later. Below from 50: cleared 0.3 s later. The lip is at 5.0 s."""
    one = recording(existence((30, 50)), {range(30, 50): [LUMP]})
    found = judged(one, track(20, 59, fall=50))
    assert told(found) == [(32, 53, "true")]
    assert found.warned_s == pytest.approx([1.8])
    assert found.standing_s == 0.0


def test_the_warning_begins_where_the_estimate_comes_to_lie_on_the_lump() -> None:
    one = recording(existence((30, 50)), {range(30, 40): [OTHER], range(40, 50): [LUMP]})
    found = judged(one, track(20, 59, fall=50))
    assert told(found) == [(32, 53, "true")]
    assert found.warned_s == pytest.approx([1.0])


def test_an_estimate_at_the_lip_or_after_is_no_warning() -> None:
    one = recording(existence((30, 60)), {range(50, 60): [LUMP]})
    found = judged(one, track(20, 59, fall=50))
    assert told(found) == [(32, 63, "true")]
    assert found.warned_s == (None,)


@pytest.mark.parametrize(
    ("first", "last", "verdict"),
    [
        (37, 60, "misplaced"),  # comes 0.5 s after the raise at index 32: within the tolerance
        (38, 60, "false"),
        (5, 27, "misplaced"),  # went 0.5 s before it
        (5, 26, "false"),
    ],
)
def test_false_is_an_alarm_without_a_lump_within_the_tolerance(first: int, last: int, verdict: str) -> None:
    one = recording(existence((30, 36)))
    assert told(judged(one, track(first, last))) == [(32, 39, verdict)]


def test_a_false_alarm_stays_false_when_a_lump_comes_while_it_stands() -> None:
    """An alarm that never clears must not turn into a good one; the lump still counts as warned of."""
    one = recording(existence((10, 80)), {range(50, 80): [LUMP]})
    found = judged(one, track(50, 85, fall=75))
    assert told(found) == [(12, 83, "false")]
    assert found.warned_s == pytest.approx([2.5])
    assert found.standing_s == pytest.approx(3.3)  # from index 12 to 44, 0.5 s before the lump


def test_an_alarm_that_stays_when_the_lump_has_gone_stands_without_one() -> None:
    """Of index 32 to the end, the lump accounts for those up to 50 + 5 (tolerance) + 3 (to clear)."""
    one = recording(existence((30, N)), {range(30, 50): [LUMP]})
    found = judged(one, track(20, 50))
    assert told(found) == [(32, N, "true")]
    assert found.standing_s == pytest.approx((N - 59) / 10)


@pytest.mark.parametrize(
    ("estimate", "verdict"),
    [
        (OTHER, "misplaced"),
        ((20.0, 10.0, 20.0, 20.0), "true"),  # 200 of 600 square pixels are common: 1/3
        ((21.0, 10.0, 20.0, 20.0), "misplaced"),  # 180 of 620: 0.29
        ((18.0, 18.0, 4.0, 4.0), "misplaced"),  # its centre lies in the lump, but it is a pebble
    ],
)
def test_an_alarm_whose_estimate_lies_elsewhere_is_misplaced(estimate: Rectangle, verdict: str) -> None:
    one = recording(existence((30, 50)), {range(30, 50): [estimate]})
    assert told(judged(one, track(20, 59, fall=50))) == [(32, 53, verdict)]


def test_two_lumps_under_one_alarm() -> None:
    estimates = {range(30, 45): [LUMP], range(45, 60): [LUMP, OTHER]}
    one = recording(existence((30, 60)), estimates)
    lumps = (track(20, 65, fall=60), track(40, 80, fall=70, box=OTHER, number=2))
    found = judged(one, *lumps)
    assert told(found) == [(32, 63, "true")]
    assert found.warned_s == pytest.approx([2.8, 2.5])


def test_a_latched_alarm_is_counted_each_time() -> None:
    assert spans(np.arange(N) / 10, existence((10, 20), (40, 50)), alarm_at(ALARM, 0.9)) == [
        (12, 23),
        (42, 53),
    ]


@pytest.mark.parametrize(
    ("above", "expected"),
    [
        ([(10, 12)], []),  # 0.2 s are not over at the last frame above
        ([(10, 13)], [(12, 16)]),
        ([(10, 20), (22, 30)], [(12, 33)]),  # a gap too short to clear
        ([(10, 20), (24, 30)], [(12, 23), (26, 33)]),
        ([(95, N)], [(97, N)]),
    ],
)
def test_delays(above: list[tuple[int, int]], expected: list[tuple[int, int]]) -> None:
    assert spans(np.arange(N) / 10, existence(*above), alarm_at(ALARM, 0.9)) == expected


@pytest.mark.parametrize(("raise_above", "clear_below"), [(0.99, 0.5), (0.9, 0.5), (0.45, 0.25)])
def test_the_lower_threshold_stays_below_the_upper_one(raise_above: float, clear_below: float) -> None:
    config = alarm_at(ALARM, raise_above)
    assert (config.raise_above, config.latch) == (raise_above, False)
    assert config.clear_below == pytest.approx(clear_below)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=60), st.floats(0.01, 1))
def test_alarms_follow_each_other_and_begin_above_the_threshold(values: list[float], upper: float) -> None:
    config = alarm_at(ALARM, upper)
    found = spans(np.arange(len(values)) / 10, np.array(values), config)
    ends = [index for span in found for index in span]
    assert ends == sorted(set(ends))
    for raised, cleared in found:
        assert min(values[raised - 2 : raised + 1]) > upper
        if cleared < len(values):
            assert max(values[cleared - 3 : cleared + 1]) < config.clear_below


# Truth


def test_the_lip_is_the_first_label_of_the_fall_or_else_the_last_label() -> None:
    one = recording(existence())
    fell, vanished = truth(one, track(20, 59, fall=50), track(30, 70, number=2)).lumps
    assert (fell.lip_frame, fell.lip_from, fell.lip_s, fell.counted) == (51, "fall label", 5.0, True)
    assert (vanished.lip_frame, vanished.lip_from) == (71, "last label")
    assert (vanished.first_s, vanished.last_s, vanished.lip_s) == (3.0, 7.0, 7.0)


def test_lumps_that_the_video_cuts_off_are_not_counted() -> None:
    one = recording(existence())
    lumps = truth(
        one,
        track(80, 99),  # still there at the end
        track(80, 99, fall=90, number=2),
        track(0, 9, number=3),  # gone 0.9 s after the start: nobody could have said so 1 s before
        track(0, 10, number=4),
    ).lumps
    assert [lump.counted for lump in lumps] == [False, True, False, True]


def test_lumps_outside_the_roi_are_left_out() -> None:
    """The ROI ends at row 80. One lump lies below it, another comes in for a moment."""
    below: Rectangle = (10.0, 75.0, 20.0, 20.0)
    crossing = [*track(20, 30, box=below, number=2), *track(31, 32, number=2)]
    found = truth(recording(existence()), track(20, 59, box=below), crossing)
    assert [lump.track for lump in found.lumps] == [2]
    assert found.outside == 1


def test_boxes_between_labels_are_interpolated() -> None:
    """Labelled at index 20 and 40, 40 px further right: in the middle the lump is 20 px from either."""
    ends = [Box(21, 1, 10, 10, 20, 20, None), Box(41, 1, 50, 10, 20, 20, None)]
    one = recording(existence(), {range(30, 31): [(30.0, 10.0, 20.0, 20.0)], range(31, 32): [LUMP]})
    (lump,) = truth(one, ends).lumps
    assert lump.on.tolist() == [30]


# Curves


def flat_out() -> VideoRecord:
    """A false alarm at 0.7, one at 0.97, and a lump that is seen with 0.95 for two seconds."""
    values = existence((30, 50)) + 0.0
    values[5:10], values[80:86] = 0.7, 0.97
    one = recording(values, {range(30, 50): [LUMP]})
    return VideoRecord("a", one, truth(one, track(20, 59, fall=50)))


def test_a_point_counts_over_all_videos() -> None:
    quiet = recording(existence((10, 20)))
    empty = VideoRecord("b", quiet, truth(quiet))
    point = point_at([flat_out(), empty], alarm_at(ALARM, 0.9), Terms())
    assert (point.lumps, point.announced) == (1, 1)
    assert (point.true_alarms, point.false_alarms, point.misplaced_alarms) == (1, 2, 0)
    # 10 s without a lump, and of the other video all but 2.0 - 0.5 s to 5.9 + 0.5 s, 50 frames.
    assert quiet_time(flat_out(), Terms()) == pytest.approx(5.0)
    assert point.quiet_h == pytest.approx(15.0 / 3600)
    assert point.false_per_hour == pytest.approx(2 / (15.0 / 3600))
    # The alarm stands from 0.2 s after the rise to 0.3 s after the end: 1.1 s, and 0.7 s in the other.
    assert point.standing_share == pytest.approx((1.1 + 0.7) / 15.0)


def test_warnings_of_lumps_never_announced_are_zero() -> None:
    """Warnings of 1.8, 1.8, 1.8 and none: median 1.8, worst tenth 0."""
    seen = recording(existence((30, 50)), {range(30, 50): [LUMP]})
    blind = recording(existence())
    lump = track(20, 59, fall=50)
    clips = [*[VideoRecord("a", seen, truth(seen, lump))] * 3, VideoRecord("b", blind, truth(blind, lump))]
    point = point_at(clips, alarm_at(ALARM, 0.9), Terms())
    assert (point.announced, point.detection_rate) == (3, 0.75)
    assert point.warning_median_s == pytest.approx(1.8)
    assert point.warning_worst_tenth_s == 0.0


@pytest.mark.parametrize(("least", "announced"), [(1.8, 1), (1.81, 0), (0.0, 1)])
def test_a_late_warning_does_not_count(least: float, announced: int) -> None:
    assert point_at([flat_out()], alarm_at(ALARM, 0.9), Terms(least_warning_s=least)).announced == announced


def test_without_any_warning_nothing_is_announced_even_where_none_is_asked_for() -> None:
    blind = recording(existence())
    clip = VideoRecord("a", blind, truth(blind, track(20, 59, fall=50)))
    assert point_at([clip], alarm_at(ALARM, 0.9), Terms(least_warning_s=0.0)).announced == 0


def test_videos_without_lumps_have_no_detection_rate() -> None:
    one = recording(existence())
    point = point_at([VideoRecord("a", one, truth(one))], ALARM, Terms())
    assert (point.detection_rate, point.detection_interval) == (None, (0.0, 1.0))
    assert (point.warning_median_s, point.warning_worst_tenth_s) == (None, None)


def test_a_video_full_of_lumps_has_no_false_alarm_rate() -> None:
    one = recording(existence())
    clip = VideoRecord("a", one, truth(one, track(0, 99, fall=90)))
    points = curve([clip], ALARM, Terms())
    assert {(p.false_per_hour, p.false_interval) for p in points} == {(None, (0.0, math.inf))}
    assert recommend(points, Terms()).point is None


def test_the_recommended_threshold_is_the_lowest_without_too_many_false_alarms() -> None:
    """Two false alarms up to 0.65, one up to 0.96; the lump is lost from 0.96 on."""
    points = curve([flat_out()], ALARM, Terms())
    assert [p.raise_above for p in points] == list(thresholds(ALARM))
    assert [p.false_alarms for p in points] == [
        2 if p.raise_above < 0.7 else int(p.raise_above < 0.97) for p in points
    ]
    advice = recommend(points, Terms())
    # From 0.97 on there is no false alarm, and nothing else either: that is nothing to recommend.
    assert (advice.point, advice.reason, advice.most_announced) == (None, "nothing_announced", 1)
    # Nothing in 5 s shows less than 3 in 5 s; 0.1 an hour takes 30 hours.
    assert advice.below_per_hour == pytest.approx(2.9957 / 5.0 * 3600, rel=1e-4)
    assert advice.needed_h == pytest.approx(29.957, rel=1e-4)
    generous = recommend(points, Terms(false_alarms_per_hour=3600 / 5.0))  # one in 5 s
    assert generous.point is not None
    assert generous.point.raise_above == 0.7


def test_an_alarm_that_stands_at_low_thresholds_is_not_recommended() -> None:
    """Between 0.5 and 0.8 existence jumps all the time: at 0.5 one alarm stands for good, at 0.8 there are
    five. One alarm in 10 s would do, but not at 0.5."""
    values = np.where(np.arange(N) % 20 < 10, 0.6, 0.85)
    values[:2] = 0.1
    one = recording(values)
    config = AlarmConfig(raise_above=0.8, clear_below=0.7, on_delay_s=0.2, off_delay_s=0.3)
    terms = Terms(false_alarms_per_hour=360.0)
    points = curve([VideoRecord("a", one, truth(one))], config, terms)
    counts = {p.raise_above: p.false_alarms for p in points}
    assert (counts[0.5], counts[0.8], counts[0.85]) == (1, 5, 0)
    assert recommend(points, terms).reason == "no_lumps"
    seen = recording(existence((30, 50)), {range(30, 50): [LUMP]})
    lump = VideoRecord("b", seen, truth(seen, track(20, 59, fall=50)))
    advice = recommend(curve([VideoRecord("a", one, truth(one)), lump], config, terms), terms)
    assert advice.point is not None
    assert advice.point.raise_above == 0.85


def test_nothing_is_recommended_where_every_threshold_gives_too_many() -> None:
    one = recording(existence((30, 50), level=1.0))
    points = curve([VideoRecord("a", one, truth(one))], ALARM, Terms())
    advice = recommend(points, Terms())
    assert (advice.point, advice.reason) == (None, "no_lumps")
    assert advice.below_per_hour == pytest.approx(4.7439 / 10.0 * 3600, rel=1e-4)


def test_the_configured_threshold_is_always_tried() -> None:
    assert 0.123 in thresholds(AlarmConfig(raise_above=0.123, clear_below=0.1))


# Intervals


@pytest.mark.parametrize(
    ("count", "low", "high"), [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (5, 1.6235, 11.6683)]
)
def test_poisson_intervals_of_the_tables(count: int, low: float, high: float) -> None:
    """Garwood's 95 % limits as they stand in statistical tables."""
    assert poisson_interval(count, 1.0) == pytest.approx((low, high), abs=5e-5)
    assert poisson_interval(count, 4.0) == pytest.approx((low / 4, high / 4), abs=5e-5)


def test_no_event_in_two_hours_only_shows_fewer_than_one_and_a_half_an_hour() -> None:
    assert poisson_upper(0, 2.0) == pytest.approx(1.498, abs=5e-4)
    assert poisson_upper(0, RULE_OF_THREE / 0.1) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("count", "trials", "low", "high"),
    [(10, 10, 0.6915, 1.0), (0, 10, 0.0, 0.3085), (5, 10, 0.1871, 0.8129)],
)
def test_binomial_intervals_of_the_tables(count: int, trials: int, low: float, high: float) -> None:
    assert binomial_interval(count, trials) == pytest.approx((low, high), abs=5e-5)


def test_nothing_tried_says_nothing() -> None:
    assert poisson_interval(0, 0.0) == (0.0, math.inf)
    assert poisson_upper(3, 0.0) == math.inf
    assert binomial_interval(0, 0) == (0.0, 1.0)


@given(st.integers(1, 500), st.floats(0.01, 100.0))
def test_poisson_limits_are_quantiles(count: int, time: float) -> None:
    low, high = poisson_interval(count, time)
    assert low == pytest.approx(chi2.ppf(0.025, 2 * count) / 2 / time)
    assert high == pytest.approx(chi2.ppf(0.975, 2 * count + 2) / 2 / time)
    assert poisson.cdf(count, poisson_upper(count, time) * time) == pytest.approx(0.05)


@given(st.integers(1, 200), st.integers(1, 200))
def test_binomial_limits_are_quantiles(count: int, others: int) -> None:
    low, high = binomial_interval(count, count + others)
    assert low == pytest.approx(beta.ppf(0.025, count, others + 1))
    assert high == pytest.approx(beta.ppf(0.975, count + 1, others))


def test_points_know_their_intervals() -> None:
    point = Point(0.9, 0.5, 10, 10, 3.0, 2.0, 10, 0, 0, 2.0, 0.0)
    assert point.detection_interval == pytest.approx((0.6915, 1.0), abs=5e-5)
    assert point.false_interval == pytest.approx((0.0, 1.84444), abs=5e-5)
