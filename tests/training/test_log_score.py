"""The logarithmic score of existence."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.service.training.histogram_rate import log_score


def test_the_log_score_is_that_of_hand_worked_numbers() -> None:
    """Log 0.8 and 0.4 halved for frames with an object, log 0.9 for the one without."""
    score = log_score(np.array([0.8, 0.4, 0.1]), np.array([True, True, False]))
    assert score == pytest.approx((np.log(0.8) + np.log(0.4)) / 2 + np.log(0.9))


def test_one_frame_that_is_sure_and_wrong_does_not_decide_everything() -> None:
    assert log_score(np.array([0.0, 0.0]), np.array([True, False])) == pytest.approx(np.log(0.001), abs=0.01)


@pytest.mark.parametrize("present", [True, False])
def test_both_kinds_of_frames_are_needed(present: bool) -> None:
    with pytest.raises(ValueError, match="frames with and frames without"):
        log_score(np.array([0.5]), np.array([present]))


@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95))
def test_no_other_probability_scores_better_than_the_true_one(true: float, other: float) -> None:
    """A proper score: expected over outcomes, the truth is at least as good (each kind of frame by itself)."""

    def expected(p: float) -> float:
        return true * float(np.log(p)) + (1 - true) * float(np.log(1 - p))

    assert expected(true) >= expected(other) - 1e-12
