"""Looks a second, learned by how well existence can be believed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, LumpFit
from lumpwatch.service.config.jdt import HistogramConfig, JdtConfig, LumpConfig
from lumpwatch.service.storage.label_file import Box
from lumpwatch.service.training.evidence_rate import FOLDS, GRID, cut_in_folds, log_score, temper, with_looks
from lumpwatch.service.training.footage import Footage, read_footage
from tests.service_helpers import camera, frame, learned, lump_fit


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


def test_looks_are_kept_where_they_cannot_be_learned() -> None:
    known = learned(likelihood=lump_fit())
    told: list[int] = []
    none = _footage()
    configured = JdtConfig(likelihood=LumpConfig(evidence=0.3))
    for config in (configured, JdtConfig(likelihood=HistogramConfig()), JdtConfig()):
        roi = camera().rois[0].model_copy(update={"detector": config})
        assert temper(roi, none, known, told.append) is known
    assert told == []
    assert known.likelihood.looks_per_s == DEFAULT_LOOKS_PER_S  # type: ignore[union-attr]


def test_only_a_lumps_likelihood_has_looks() -> None:
    tempered = with_looks(learned(likelihood=lump_fit()), 2.0).likelihood
    assert isinstance(tempered, LumpFit)
    assert tempered.looks_per_s == 2.0
    histogram = learned()
    assert with_looks(histogram, 2.0) is histogram
    assert list(GRID) == sorted(GRID)


def test_no_lump_is_in_both_parts_of_a_fold() -> None:
    """Three lumps of ten pictures with five between them: the cuts fall into lumps, and those are left out."""
    boxes = [
        Box(15 * lump + k + 6, lump + 1, 20.0, 20.0, 20.0, 20.0, None) for lump in range(3) for k in range(10)
    ]
    footage = _footage(50, boxes)
    folds = cut_in_folds(footage)
    assert len(folds) == FOLDS
    judged = [moment.frame for fold in folds for moment in fold.judged.moments]
    assert judged == list(range(1, 51))
    for fold in folds:
        seen, taught = ({t for m in part.moments for t in m.tracks} for part in (fold.judged, fold.rest))
        assert seen.isdisjoint(taught)
        assert {m.frame for m in fold.judged.moments}.isdisjoint(m.frame for m in fold.rest.moments)


def _footage(pictures: int = 4, boxes: Sequence[Box] = ()) -> Footage:
    """Pictures with these labels."""
    frames = (frame(k) for k in range(pictures))
    return read_footage(camera().rois[0], frames, boxes, lambda _: None)
