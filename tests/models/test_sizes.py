"""Sizes by row from a handful of objects: the line, the pooled spread, the aspect."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.jdt.row_profile import SIZE_LIMIT, RowProfile, learn_profile
from lumpwatch.models.learning.sizes import PRIOR_ASPECT, PRIOR_OBJECTS, PRIOR_SPREAD, with_sizes
from lumpwatch.models.state import H, States, W, Y
from tests.models.helpers import boxes

HEIGHT = 200.0
ROWS = np.linspace(40.0, 160.0, 25)


def ride(factor: float, wider: float = 1.0, first: float = 10.0, slope: float = 0.2) -> States:
    """One object on its way down: a line of sizes in the row, times its own factor."""
    states = boxes(len(ROWS))
    states[:, Y] = ROWS
    states[:, W] = factor * wider * (first + slope * ROWS)
    states[:, H] = factor / wider * (first + slope * ROWS)
    return states


def learned(*rides: States) -> RowProfile:
    starts: NDArray[np.bool_] = np.concatenate([np.arange(len(one)) == 0 for one in rides])
    states = np.concatenate(rides)
    return with_sizes(learn_profile(states, HEIGHT), states, starts, HEIGHT)


def test_the_line_holds_beyond_the_labelled_rows() -> None:
    """10 + 0.2 y px: 10 at the top, 50 at the bottom, where no object was labelled."""
    mean, _ = learned(ride(0.9), ride(1 / 0.9)).at(np.array([0.0, 100.0, 200.0]))
    assert np.exp(mean[:, 2]) == pytest.approx([10.0, 30.0, 50.0], rel=0.03)
    assert np.exp(mean[:, 3]) == pytest.approx([10.0, 30.0, 50.0], rel=0.03)


def test_spread_is_that_of_the_next_object() -> None:
    """Log factors -0.3, 0, 0.3: (4 x 0.28^2 + 0.18) / (4 + 2) times 1 + 1/3; the same at every row."""
    profile = learned(*(ride(float(np.exp(v))) for v in (-0.3, 0.0, 0.3)))
    expected = np.sqrt((PRIOR_OBJECTS * PRIOR_SPREAD**2 + 0.18) / (PRIOR_OBJECTS + 2) * 4 / 3)
    assert profile.spread[:, 2:] == pytest.approx(expected, rel=0.02)
    assert profile.aspect_spread == pytest.approx(
        np.sqrt(PRIOR_OBJECTS * PRIOR_ASPECT**2 / (PRIOR_OBJECTS + 2) * 4 / 3), rel=0.02
    )


def test_one_object_leaves_the_stated_range() -> None:
    spread = learned(ride(1.0)).spread[0, 2]
    assert spread == pytest.approx(PRIOR_SPREAD * np.sqrt(2.0), rel=0.02)


def test_an_object_seen_for_long_counts_as_one() -> None:
    short = ride(1.3)[::5]
    middle = learned(ride(1 / 1.3), short).at(np.array([100.0]))[0][0, 2]
    assert np.exp(middle) == pytest.approx(30.0, rel=0.05)


def test_boxes_cut_by_the_border_do_not_shrink_the_objects() -> None:
    """Half the height shows at the top; the other rows say how high the object is."""
    cut = ride(1.0)[:5].copy()
    cut[:, Y], cut[:, H] = 4.0, 8.0
    one = np.concatenate([cut, ride(1.0)])
    assert np.exp(learned(one, ride(1.0)).at(np.array([0.0]))[0][0, 3]) == pytest.approx(10.0, rel=0.05)


def test_drawn_and_followed_boxes_keep_to_the_aspect() -> None:
    profile = learned(ride(1.0, 1.05), ride(1.0, 1 / 1.05))
    rng = np.random.default_rng(0)
    rows = np.full(4000, 100.0)
    drawn = profile.draw(rows, rng)
    before = boxes(len(rows))
    before[:, Y], before[:, [W, H]] = rows, drawn[:, 2:]
    after = before.copy()
    profile.follow(before, after, 1.0, rng)
    most = SIZE_LIMIT * profile.aspect_spread
    for sides in (drawn[:, 2:], after[:, [W, H]]):
        aspect = np.abs(np.log(sides[:, 0] / sides[:, 1]))
        assert aspect.max() == pytest.approx(most, abs=0.02)
        assert np.log(sides).std(axis=0).min() > 0.1
