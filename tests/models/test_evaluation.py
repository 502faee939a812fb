"""The evaluation metrics on scenes worked by hand.

Boxes are 10 x 10 unless said otherwise; `tests.models.evaluation_scenes` has their overlaps.
"""

from __future__ import annotations

import math
from dataclasses import asdict

import numpy as np
import pytest

from lumpwatch.models.evaluation import METRICS, Scores, evaluate, overlaps, tracks_of
from tests.models.evaluation_scenes import scene, track

NOTHING = tracks_of([], [], [])


def test_overlaps_by_hand() -> None:
    boxes = np.array([[0, 0, 10, 10], [5, 0, 10, 10], [0, 5, 10, 20], [10, 0, 4, 4], [2, 2, 5, 5]], float)
    expected = [
        1.0,
        50 / 150,  # half of each
        50 / 250,  # 5 rows of a box of 200
        0.0,  # the edges touch
        25 / 100,  # one inside the other
    ]
    assert overlaps(boxes[:1], boxes)[0] == pytest.approx(expected, abs=1e-15)
    assert overlaps(boxes, boxes) == pytest.approx(overlaps(boxes, boxes).T)
    assert overlaps(boxes, boxes[:0]).shape == (5, 0)


def test_one_object_and_one_track() -> None:
    """Truth in frames 1 to 4; the result in 2 to 5, exact in 2 and 3, shifted by 5 in 4.

    Overlaps 1, 1, 1/3. Five frames have a box.
    SFDA: frames 1 and 5 give 0, so (1 + 1 + 1/3) / 5. ATA: (1 + 1 + 1/3) / 5 frames with either, over one
    track on average; relaxed (1 + 1 + 0) / 5. At 0.5 there are 2 pairs, misses in 1 and 4, false
    positives in 4 and 5: N-MODP (1 + 1) / 5, MOTP 1, N-MODA and MOTA 1 - 4/4, IDF1 2 / ((4 + 4) / 2).
    """
    truth = scene(*track(1, range(1, 5)))
    result = scene((2, 7, 0), (3, 7, 0), (4, 7, 5), (5, 7, 0))
    scores = evaluate(result, truth)
    third = 1 / 3
    expected = Scores(
        sfda=(2 + third) / 5,
        ata=(2 + third) / 5,
        ata_relaxed=2 / 5,
        n_modp=2 / 5,
        n_moda=0.0,
        motp=1.0,
        mota=0.0,
        idf1=0.5,
        precision=0.5,
        recall=0.5,
        id_switches=0,
        fragmentations=0,
        misses=2,
        false_positives=2,
        matches=2,
        truth_boxes=4,
        truth_tracks=1,
        result_boxes=4,
        result_tracks=1,
        frames=5,
        threshold=0.5,
    )
    assert asdict(scores) == pytest.approx(asdict(expected))


def test_a_lower_threshold_takes_the_shifted_box() -> None:
    """The scene before at 0.3: 3 pairs, 1 miss, 1 false positive; MOTP (1 + 1 + 1/3) / 3."""
    truth = scene(*track(1, range(1, 5)))
    result = scene((2, 7, 0), (3, 7, 0), (4, 7, 5), (5, 7, 0))
    scores, before = evaluate(result, truth, 0.3), evaluate(result, truth)
    assert (scores.sfda, scores.ata) == (before.sfda, before.ata)
    assert scores.ata_relaxed == pytest.approx(3 / 5)
    assert scores.n_modp == pytest.approx((7 / 3) / 5)
    assert scores.motp == pytest.approx((7 / 3) / 3)
    assert scores.n_moda == scores.mota == pytest.approx(1 - 2 / 4)
    assert scores.idf1 == pytest.approx(3 / 4)


def test_sfda_of_two_objects_and_three_boxes() -> None:
    """Truth at 0 and 4, result at 3 and -5 and far away. The best pairs are (4, 3) with 9/11 and (0, -5) with
    1/3; the frame has (2 + 3) / 2 boxes.
    """
    truth = scene((1, 1, 0), (1, 2, 4))
    result = scene((1, 1, 3), (1, 2, -5), (1, 3, 500))
    assert evaluate(result, truth).sfda == pytest.approx((9 / 11 + 1 / 3) / 2.5)


def test_the_sum_counts_where_greed_would_fail() -> None:
    """Truth at 0 and 3, result at 2 and 8. Overlaps: (0, 2) 8/12, (3, 2) 9/11, (3, 8) 5/15, (0, 8) 2/18.
    Greed takes 9/11 and leaves 2/18: 0.929. The best sum is 8/12 + 5/15 = 1.
    At a threshold of 0.5 only (0, 2) and (3, 2) may be paired, one of them: 9/11, a miss, a false positive.
    """
    truth = scene((1, 1, 0), (1, 2, 3))
    result = scene((1, 1, 2), (1, 2, 8))
    scores = evaluate(result, truth)
    assert scores.sfda == pytest.approx(1 / 2)
    assert scores.n_modp == scores.motp == pytest.approx(9 / 11)
    assert (scores.matches, scores.misses, scores.false_positives) == (1, 1, 1)


def test_one_object_followed_by_two_tracks() -> None:
    """Ten exact frames, the id changes after the sixth.

    Tracks: 1 and 2. STDA pairs the object with the longer piece: 6 frames of 10; ATA 0.6 / ((1 + 2) / 2).
    MOTA 1 - 1/10; detection is perfect. IDF1 6 / ((10 + 10) / 2).
    """
    truth = scene(*track(1, range(10)))
    scores = evaluate(scene(*track(5, range(6)), *track(3, range(6, 10))), truth)
    assert scores.sfda == scores.n_modp == scores.n_moda == scores.motp == 1.0
    assert scores.ata == scores.ata_relaxed == pytest.approx(0.6 / 1.5)
    assert scores.mota == pytest.approx(0.9)
    assert scores.idf1 == pytest.approx(0.6)
    assert (scores.id_switches, scores.fragmentations) == (1, 0)


def test_two_objects_swap_their_tracks() -> None:
    """Objects at 0 and 100 for 8 frames; the ids swap after the fifth: two switches at once.

    STDA pairs each object with the track of its first 5 frames: 5 common of 8 each; ATA 2 (5/8) / 2.
    """
    truth = scene(*track(1, range(8)), *track(2, range(8), 100))
    result = scene(
        *track(1, range(5)), *track(1, range(5, 8), 100), *track(2, range(5), 100), *track(2, range(5, 8))
    )
    scores = evaluate(result, truth)
    assert scores.id_switches == 2
    assert scores.mota == pytest.approx(1 - 2 / 16)
    assert scores.n_moda == 1.0
    assert scores.ata == pytest.approx(5 / 8)
    assert scores.idf1 == pytest.approx(10 / 16)


def test_the_relaxed_form_may_pair_other_tracks_than_the_original() -> None:
    """Ten frames; track A is exact in 4, track B shifted by 5 (1/3) in 3 frames and by 2 (2/3) in the
    other 5 of its 8. Original: A 4/10, B (3/3 + 10/3)/10 = 0.4333, so B. Relaxed: A 0.4, B 5/10.
    At 0.7, relaxed: A 0.4 and B 0. Three tracks: divide by 1.5.
    """
    truth = scene(*track(1, range(10)))
    result = scene(*track(1, range(4)), *track(2, range(3), 5), *track(2, range(3, 8), 2))
    assert evaluate(result, truth).ata == pytest.approx((13 / 30) / 1.5)
    assert evaluate(result, truth).ata_relaxed == pytest.approx(0.5 / 1.5)
    assert evaluate(result, truth, 0.7).ata_relaxed == pytest.approx(0.4 / 1.5)


def test_ata_counts_the_frames_of_either_track() -> None:
    """Truth in frames 0 to 5, result in 3 to 8: 3 common frames of 9, where dividing by the object's own
    frames would give 3/6. A second object that nobody follows: (2 + 1) / 2 tracks.
    """
    truth = scene(*track(1, range(6)), *track(2, range(4), 300))
    assert evaluate(scene(*track(1, range(3, 9))), truth).ata == pytest.approx((3 / 9) / 1.5)


def test_n_modp_is_a_mean_over_frames_and_motp_over_pairs() -> None:
    """Frame 1: overlap 2/3; frame 2: 1 and 2/3; frame 3: a miss; frame 4: a false positive; 5: nothing at all.
    N-MODP (2/3 + 5/6 + 0 + 0) / 4, MOTP (2/3 + 1 + 2/3) / 3, N-MODA 1 - 2/4.
    """
    truth = scene((1, 1, 0), (2, 1, 0), (2, 2, 100), (3, 1, 0))
    result = scene((1, 1, 2), (2, 1, 0), (2, 2, 98), (4, 1, 0))
    scores = evaluate(result, truth)
    assert scores.frames == 4
    assert scores.n_modp == pytest.approx((3 / 2) / 4)
    assert scores.motp == pytest.approx((7 / 3) / 3)
    assert scores.n_moda == pytest.approx(0.5)


def test_n_moda_does_not_know_ids_and_mota_does() -> None:
    truth = scene(*track(1, range(6)))
    result = scene(*((t, t, 0.0) for t in range(6)))
    scores = evaluate(result, truth)
    assert scores.n_moda == 1.0
    assert scores.id_switches == 5
    assert scores.mota == pytest.approx(1 - 5 / 6)


def test_a_threshold_of_zero_still_needs_a_common_area() -> None:
    """One pair overlaps by 1/19; the other two boxes only touch."""
    scores = evaluate(scene((1, 1, 9), (2, 1, 10)), scene((1, 1, 0), (2, 1, 0)), threshold=0.0)
    assert (scores.matches, scores.misses, scores.false_positives) == (1, 1, 1)
    assert scores.motp == pytest.approx(1 / 19)
    assert scores.ata == pytest.approx(1 / 38)
    assert scores.ata_relaxed == pytest.approx(1 / 2)


def test_the_threshold_itself_is_enough() -> None:
    """A box of 10 x 10 in one of 10 x 20: exactly 1/2."""
    truth = tracks_of([1], [1], [[0, 0, 10, 20]])
    assert evaluate(scene((1, 1, 0, 5)), truth, 0.5).matches == 1
    assert evaluate(scene((1, 1, 0, 5)), truth, np.nextafter(0.5, 1)).matches == 0


# Nothing there


def test_an_empty_result() -> None:
    """All is missed; what would divide by the boxes or pairs of the result is undefined."""
    scores = evaluate(NOTHING, scene(*track(1, range(4))))
    undefined = {"motp", "precision"}
    assert all(math.isnan(getattr(scores, name)) for name in undefined)
    zero = {metric.field for metric in METRICS} - undefined - {"misses"}
    assert all(getattr(scores, name) == 0 for name in zero)
    assert (scores.misses, scores.frames, scores.truth_tracks, scores.result_tracks) == (4, 4, 1, 0)


def test_an_empty_truth() -> None:
    """All is wrong; what would divide by true boxes or pairs is undefined."""
    scores = evaluate(scene(*track(1, range(4))), NOTHING)
    undefined = {"motp", "recall", "mota", "n_moda"}
    assert all(math.isnan(getattr(scores, name)) for name in undefined)
    zero = {metric.field for metric in METRICS} - undefined - {"false_positives"}
    assert all(getattr(scores, name) == 0 for name in zero)
    assert (scores.false_positives, scores.frames) == (4, 4)


def test_nothing_at_all() -> None:
    scores = evaluate(NOTHING, NOTHING)
    for metric in METRICS:
        value = getattr(scores, metric.field)
        assert value == 0 if isinstance(value, int) else math.isnan(value)
    assert scores.frames == 0


# What is refused


@pytest.mark.parametrize(
    ("frames", "ids", "boxes", "reason"),
    [
        ([3, 1, 3], [5, 5, 5], [[0, 0, 1, 1]] * 3, "track 5 .*frame 3"),
        ([1], [1], [[0, 0, 0, 1]], "width and height"),
        ([1], [1], [[0, 0, 1, -1]], "width and height"),
        ([1], [1], [[1e20, 0, 1, 1]], "width and height"),  # lost in rounding
        ([1], [1], [[0, np.nan, 1, 1]], "boxes must be finite"),
        ([1], [1], [[0, 0, np.inf, 1]], "boxes must be finite"),
        ([1.5], [1], [[0, 0, 1, 1]], "frames must be whole numbers"),
        ([1], [np.nan], [[0, 0, 1, 1]], "ids must be whole numbers"),
        ([1, 2], [1], [[0, 0, 1, 1]] * 2, r"not \(2,\), \(1,\) and \(2, 4\)"),
        ([1, 2], [1, 1], [[0, 0, 1, 1]], r"not \(2,\), \(2,\) and \(1, 4\)"),
        ([1], [1], [[0, 0, 1]], r"not \(1,\), \(1,\) and \(1, 3\)"),
        ([1], [1], [], r"not \(1,\), \(1,\) and \(0, 4\)"),
        (1, 1, [[0, 0, 1, 1]], r"not \(\), \(\) and \(1, 4\)"),
    ],
)
def test_bad_tracks_are_refused(frames: object, ids: object, boxes: object, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        tracks_of(frames, ids, boxes)  # type: ignore[arg-type]


@pytest.mark.parametrize("threshold", [-0.1, 1.1, float("nan")])
def test_bad_thresholds_are_refused(threshold: float) -> None:
    with pytest.raises(ValueError, match=r"threshold .*0 and 1"):
        evaluate(NOTHING, NOTHING, threshold)


def test_inputs_are_not_changed() -> None:
    frames, ids, boxes = np.array([2, 1]), np.array([1, 1]), np.array([[0.0, 0, 10, 10], [1, 0, 10, 10]])
    for part in (frames, ids, boxes):
        part.setflags(write=False)
    assert evaluate(tracks_of(frames, ids, boxes), tracks_of(frames, ids, boxes)).sfda == 1.0


def test_every_metric_is_a_score() -> None:
    scores = asdict(evaluate(NOTHING, NOTHING))
    assert {metric.field for metric in METRICS} < set(scores)
    assert {metric.field for metric in METRICS if metric.better == "smaller"} == {
        "id_switches",
        "fragmentations",
        "misses",
        "false_positives",
    }
