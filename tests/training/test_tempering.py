"""Margin and looks a second, learned by what would have been announced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, LumpFit
from lumpwatch.models.likelihood.net import STRIDE
from lumpwatch.models.state import H, W, X, Y
from lumpwatch.service.config.jdt import HistogramConfig, JdtConfig, LumpConfig
from lumpwatch.service.core import DetectedObject, Detection
from lumpwatch.service.storage.label_file import Box
from lumpwatch.service.training.evidence_rate import (
    FOLDS,
    Announced,
    best,
    cut_in_folds,
    temper,
    tuned,
    tuned_like,
    without_objects,
)
from lumpwatch.service.training.footage import Footage, read_footage
from tests.service_helpers import camera, frame, learned, lump_fit


def test_the_margin_with_the_most_announced_and_the_fewest_false_and_the_largest_modest_of_equals() -> None:
    assert best({1.0: 17, 1.5: 19, 2.0: 19, 3.0: 19, 4.0: 17}) == 2.0
    assert best({1.0: 17, 2.0: 17, 3.0: 19, 4.0: 19}) == 3.0
    assert best({1.0: -3, 1.5: 2, 2.0: 1}) == 1.5


def test_what_is_labelled_is_taken_out_of_the_maps() -> None:
    """A box of 20 pixels around (30, 30), 1.2 times as large: cells 4 to 10 of 4 pixels each way."""
    footage = _footage(3, [Box(2, 1, 20.0, 20.0, 20.0, 20.0, None)])
    x, y = footage.views[1].objects[0, [X, Y]]
    w, h = footage.views[1].objects[0, [W, H]]
    rows, columns = (side // STRIDE for side in footage.views[1].view.gray.shape)
    maps = np.full((6, rows, columns), 3.0, np.float32)
    cleared = without_objects(footage, lambda gray: maps)
    assert (cleared(footage.views[0].view.gray) == 3.0).all()
    found = cleared(footage.views[1].view.gray)
    gone = found[0] < 0
    low_x, high_x = int((x - 0.6 * w) // STRIDE), int(-(-(x + 0.6 * w) // STRIDE))
    low_y, high_y = int((y - 0.6 * h) // STRIDE), int(-(-(y + 0.6 * h) // STRIDE))
    assert gone.sum() == (min(high_x, columns) - max(low_x, 0)) * (min(high_y, rows) - max(low_y, 0)) > 0
    assert (found[1][gone] < 0).all()
    assert (found[2:] == 3.0).all()
    assert (maps == 3.0).all()


def test_a_lump_is_announced_in_time_or_not() -> None:
    """Three lumps labelled for two seconds: announced at once, half a second before the end, and beside the lump."""
    footage = _footage(
        21, [Box(k + 1, t, 20.0 * t, 20.0, 20.0, 20.0, None) for t in (1, 2, 3) for k in range(21)]
    )
    announced = Announced()
    for view, moment in zip(footage.views, footage.moments, strict=True):
        boxes = []
        time_s = 0.1 * (moment.frame - 1)
        if time_s >= 0.5:
            boxes.append((20.0, 20.0, 20.0, 20.0))
            boxes.append((60.0, 45.0, 20.0, 20.0))
        if time_s >= 1.5:
            boxes.append((42.0, 20.0, 20.0, 20.0))
        announced.add((view, replace(moment, time_s=time_s)), _said(boxes), footage)
    assert announced.in_time == 1


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
    tempered = tuned(learned(likelihood=lump_fit()), 2.0, 1.5).likelihood
    assert isinstance(tempered, LumpFit)
    assert (tempered.looks_per_s, tempered.margin) == (2.0, 1.5)
    like = tuned_like(learned(likelihood=lump_fit()), learned(likelihood=tempered)).likelihood
    assert isinstance(like, LumpFit)
    assert (like.looks_per_s, like.margin) == (2.0, 1.5)
    histogram = learned()
    assert tuned(histogram, 2.0, 1.5) is tuned_like(histogram, histogram) is histogram


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


def _said(boxes: Sequence[tuple[float, float, float, float]]) -> Any:
    """What stands of a channel while its alarm is raised."""
    objects = tuple(DetectedObject(k, *box, 1.0, 1.0, 1.0, "cv") for k, box in enumerate(boxes))
    return SimpleNamespace(detection=Detection(1.0, objects), alarm=SimpleNamespace(active=True))
