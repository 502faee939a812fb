"""CLEAR MOT by hand: which pairs are kept, what is a switch, what is a fragmentation.

Boxes are 10 x 10; `tests.models.evaluation_scenes` has their overlaps.
"""

from __future__ import annotations

import pytest

from lumpwatch.models.evaluation import clear_mot, evaluate, pair
from tests.models.evaluation_scenes import scene, track


def test_a_correspondence_is_kept_where_another_box_fits_better() -> None:
    """Track 1 is exact, then shifted by 2 (2/3), while track 2 comes and is exact: track 1 stays the partner,
    track 2 is a false positive. MOTP (1 + 2/3) / 2; N-MODP, which knows no ids, takes the better box.
    """
    truth = scene(*track(1, range(2)))
    result = scene((0, 1, 0), (1, 1, 2), (1, 2, 0))
    scores = evaluate(result, truth)
    assert (scores.matches, scores.false_positives, scores.id_switches) == (2, 1, 0)
    assert scores.motp == pytest.approx((5 / 3) / 2)
    assert scores.n_modp == 1.0


def test_a_correspondence_below_the_threshold_is_not_kept() -> None:
    """Track 1 is shifted by 4 (3/7 < 0.5) in the second frame: track 2 takes over, a switch."""
    truth = scene(*track(1, range(2)))
    counted = clear_mot(pair(scene((0, 1, 0), (1, 1, 4), (1, 2, 0)), truth), 0.5)
    assert (counted.matches, counted.id_switches, counted.false_positives) == (2, 1, 1)


def test_keeping_comes_before_the_sum_of_overlaps() -> None:
    """Objects at 0 and 4 with tracks 1 and 2. In frame 1 track 1 is at 2 (2/3 with either) and track 2 at 1:
    9/11 with object 1 and 7/13 with object 2. Swapping would give the larger sum 2/3 + 9/11; kept: 2/3 + 7/13.
    """
    truth = scene(*track(1, range(2)), *track(2, range(2), 4))
    result = scene((0, 1, 0), (0, 2, 4), (1, 1, 2), (1, 2, 1))
    counted = clear_mot(pair(result, truth), 0.5)
    assert counted.id_switches == 0
    assert counted.overlap == pytest.approx(2 + 8 / 12 + 7 / 13)


@pytest.mark.parametrize(("across_gaps", "switches", "overlap"), [(True, 0, 1 + 2 / 3), (False, 1, 2.0)])
def test_a_correspondence_across_a_gap(across_gaps: bool, switches: int, overlap: float) -> None:
    """Track 1 misses a frame and comes back shifted by 2, beside a new exact track 2. The paper's memory
    holds on to track 1; from frame to frame only, the better box wins and a switch is counted.
    """
    truth = scene(*track(1, range(3)))
    result = scene((0, 1, 0), (2, 1, 2), (2, 2, 0))
    counted = clear_mot(pair(result, truth), 0.5, across_gaps)
    assert counted.id_switches == switches
    assert counted.overlap == pytest.approx(overlap)
    assert (counted.matches, counted.misses, counted.fragmentations) == (2, 1, 1)


def test_two_objects_that_remember_the_same_track() -> None:
    """Objects at 0 and 4. Track 1 follows object 1 in frame 0 and object 2 in frame 1. In frame 2 it is at 3,
    7/13 with object 1 and 9/11 with object 2, and both remember it: the better fit keeps it.
    """
    truth = scene(*track(1, range(3)), (1, 2, 4), (2, 2, 4))
    result = scene((0, 1, 0), (1, 1, 4), (2, 1, 3))
    counted = clear_mot(pair(result, truth), 0.5)
    assert counted.overlap == pytest.approx(1 + 1 + 9 / 11)
    assert (counted.matches, counted.misses, counted.id_switches) == (3, 2, 0)


def test_a_switch_counts_against_the_last_partner_however_long_ago() -> None:
    """Track 1 for two frames, three frames missed, then track 2; and back to 1 at the end: two switches."""
    truth = scene(*track(1, range(8)))
    result = scene(*track(1, range(2)), *track(2, range(5, 7)), *track(1, range(7, 8)))
    scores = evaluate(result, truth)
    assert (scores.id_switches, scores.fragmentations, scores.misses) == (2, 1, 3)


def test_fragmentations() -> None:
    """Object 1 is found in frames 1, 2, 5, 8 of 0 to 9: two interruptions that end; the late start and the early
    end are none. Object 2 is away in frames 3 and 4 itself: nothing was interrupted.
    """
    truth = scene(*track(1, range(10)), *track(2, range(3), 100), *track(2, range(5, 7), 100))
    found = [(t, 1, 0.0) for t in (1, 2, 5, 8)]
    result = scene(*found, *track(2, range(3), 100), *track(2, range(5, 7), 100))
    scores = evaluate(result, truth)
    assert (scores.fragmentations, scores.id_switches, scores.misses) == (2, 0, 6)
