"""What likelihoods share: bounding, box edges, and the share of a box inside the polygon."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.likelihood.base import bounded, box_edges, box_inside
from lumpwatch.models.roi import make_roi
from tests.models.helpers import box, boxes

INSIDE = make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], 100, 80, 100).inside


@pytest.mark.parametrize(
    ("log_ratio", "expected"),
    [(2.0, 1.0), (-2.0, -1.0), (100.0, 4.0), (-100.0, -4.0), (np.inf, 4.0), (-np.inf, -4.0), (0.0, 0.0)],
)
def test_bounded_by_hand(log_ratio: float, expected: float) -> None:
    """Evidence one half, bound 4."""
    assert bounded(np.array([log_ratio]), 0.5, 4.0)[0] == expected


@given(st.lists(st.floats(-50, 50), min_size=2, max_size=20), st.floats(0.01, 1), st.floats(0.1, 10))
def test_bounded_keeps_the_order_and_the_sign(values: list[float], evidence: float, bound: float) -> None:
    ordered = bounded(np.array(sorted(values)), evidence, bound)
    assert np.all(np.diff(ordered) >= 0)
    assert np.all(np.abs(ordered) <= bound)
    assert np.all(ordered * np.array(sorted(values)) >= 0)


@pytest.mark.parametrize(
    ("state", "scale", "expected"),
    [
        (box(10, 20, 30, 26), 1.0, (10, 20, 30, 26)),
        (box(10, 20, 30, 26), 1.5, (5, 19, 35, 28)),  # 18.5 and 27.5 round up
        (box(10.4, 20.6, 30.4, 26.6), 1.0, (10, 21, 30, 27)),
        (box(-10, -5, 30, 26), 1.0, (0, 0, 30, 26)),
        (box(90, 70, 130, 90), 1.0, (90, 70, 100, 80)),
        (box(-50, 10, -20, 30), 1.0, (0, 10, 0, 30)),  # wholly outside: empty
    ],
)
def test_box_edges_by_hand(
    state: NDArray[np.float64], scale: float, expected: tuple[int, int, int, int]
) -> None:
    assert box_edges(state[0], scale, 100, 80) == expected


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (box(10, 20, 30, 40), 1.0),
        (box(-10, 20, 10, 40), 0.5),
        (box(-10, -10, 10, 10), 0.25),
        (box(-40, 20, -20, 40), 0.0),
        (box(0, 0, 100, 80), 1.0),
        (box(-50, -40, 150, 120), 0.25),
    ],
)
def test_inside_share_by_hand(state: NDArray[np.float64], expected: float) -> None:
    """Parts beyond the picture count as outside."""
    assert box_inside(INSIDE, state[0])[1] == pytest.approx(expected)


def test_inside_share_of_a_polygon() -> None:
    """The triangle below the diagonal of 100 x 100 px: a box across the diagonal is half inside."""
    inside = make_roi([(0, 0), (1, 1), (0, 1)], 100, 100, 100).inside
    assert box_inside(inside, box(30, 30, 70, 70)[0])[1] == pytest.approx(0.5, abs=0.03)
    assert box_inside(inside, box(5, 60, 35, 90)[0])[1] == 1.0
    assert box_inside(inside, box(60, 5, 90, 35)[0])[1] == 0.0


@given(st.floats(1, 40), st.floats(1, 40), st.floats(30, 70), st.floats(25, 55))
def test_box_within_the_polygon_counts_as_inside(w: float, h: float, x: float, y: float) -> None:
    """Small boxes too, whose rounded area differs most from the exact one."""
    assert box_inside(INSIDE, boxes(1, x, y, w, h)[0])[1] == 1.0
