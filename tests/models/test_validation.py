"""Held-out judgement: by a likelihood whose answers are known, and reliability by hand."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.jdt.row_profile import default_profile
from lumpwatch.models.learning import LabelledView
from lumpwatch.models.learning.validation import BOUND, MOST_OVERLAP, folds, judge, reliability
from lumpwatch.models.roi import View
from lumpwatch.models.state import H, States, W, X, Y, blank

SHAPE = (60, 80)


class ByColumn:
    """The log ratio of a box is the column of its centre; what lies left of 10 is outside the polygon."""

    def observe(self, view: View, dt: float = inf) -> ByColumn:
        return self

    def log_ratio(self, states: States) -> np.ndarray:
        return np.where(states[:, X] < 10, -BOUND, states[:, X])


def view(*objects: tuple[float, float, float, float]) -> LabelledView:
    states = blank(len(objects))
    if objects:
        states[:, [X, Y, W, H]] = objects
    return LabelledView(View(np.zeros(SHAPE, np.uint8), None, np.zeros((61, 81), np.int32)), states)


def births() -> PolygonBirths:
    return polygon_births(np.ones(SHAPE, np.uint8), default_profile(60.0, 10.0, 20.0, 5.0), np.ones(1))


def test_objects_and_the_hardest_background() -> None:
    item = view((70.0, 30.0, 30.0, 60.0), (5.0, 30.0, 8.0, 8.0))
    verdict = judge(ByColumn(), item, births(), np.random.default_rng(0), 500)
    assert verdict.objects[0] == 70.0
    assert np.isnan(verdict.objects[1])
    assert len(verdict.background) > 200
    assert verdict.background.min() >= 10.0
    # A box with its centre well inside the object lies on it: 10 px wide of 30 in a column as high.
    assert verdict.hardest_ratio == verdict.background.max()
    assert verdict.hardest is not None
    assert verdict.hardest[X] == verdict.hardest_ratio


def test_boxes_on_an_object_are_no_background() -> None:
    whole = view((40.0, 30.0, 16.0, 16.0))
    alone = judge(ByColumn(), view(), births(), np.random.default_rng(1), 2000)
    other = judge(ByColumn(), whole, births(), np.random.default_rng(1), 2000)
    drawn = births().draw(2000, np.random.default_rng(1))[0]
    low = np.maximum(drawn[:, [X, Y]] - drawn[:, [W, H]] / 2, (32.0, 22.0))
    high = np.minimum(drawn[:, [X, Y]] + drawn[:, [W, H]] / 2, (48.0, 38.0))
    common = np.prod(np.maximum(high - low, 0.0), axis=1)
    share = common / (drawn[:, W] * drawn[:, H] + 256.0 - common)
    inside = drawn[:, X] >= 10
    assert len(alone.background) == inside.sum()
    assert len(other.background) == (inside & (share < MOST_OVERLAP)).sum()
    assert len(other.background) < len(alone.background)


def test_no_box_anywhere() -> None:
    verdict = judge(ByColumn(), view(), births(), np.random.default_rng(0), 0)
    assert verdict.hardest is None
    assert np.isnan(verdict.hardest_ratio)


def test_reliability_by_hand() -> None:
    """Two objects at 0.5, one at 5; three of the background at 0.5, one at -5."""
    bins = reliability(np.array([0.5, 0.5, 5.0]), np.array([0.5, 0.5, 0.5, -5.0]))
    assert [(one.objects, one.background) for one in bins] == [(0, 1), (2, 3), (1, 0)]
    middle = 1 / (1 + np.exp(-0.5))
    assert [one.predicted for one in bins] == pytest.approx(
        [1 / (1 + np.exp(5)), middle, 1 / (1 + np.exp(-5))]
    )
    assert [one.observed for one in bins] == pytest.approx([0.0, (2 / 3) / (2 / 3 + 3 / 4), 1.0])


def test_log_ratios_of_known_laws_are_reliable() -> None:
    """Two Gaussians: the true log ratio of N(1, 1) to N(-1, 1) is 2 x."""
    rng = np.random.default_rng(4)
    bins = reliability(2 * (rng.standard_normal(100_000) + 1), 2 * (rng.standard_normal(100_000) - 1))
    assert len(bins) == 10
    for one in bins:
        assert one.observed == pytest.approx(one.predicted, abs=0.02)


@pytest.mark.parametrize("missing", [0, 1])
def test_reliability_needs_both(missing: int) -> None:
    both = [np.ones(2), np.ones(2)]
    both[missing] = np.empty(0)
    with pytest.raises(ValueError, match="boxes without"):
        reliability(*both)


@given(st.integers(1, 60), st.integers(1, 12))
def test_every_index_is_in_one_fold(count: int, wanted: int) -> None:
    groups = folds(count, wanted)
    assert len(groups) == min(count, wanted)
    assert sorted(np.concatenate(groups)) == list(range(count))
    assert max(map(len, groups)) - min(map(len, groups)) <= 1
