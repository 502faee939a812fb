"""The lump likelihood's features against plain NumPy on maps, what they tell of bodies, and its score."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.special import expit

from lumpwatch.models.likelihood.lump import (
    FEATURES,
    WEIGHTS,
    LumpLikelihood,
    LumpObservation,
    expand,
    standardised,
)
from lumpwatch.models.likelihood.maps import GRAIN_PX, SUMS, VOTES, cell_shares, prepare
from lumpwatch.models.likelihood.net import REACH, STRIDE
from lumpwatch.models.likelihood.patterns import Patterns, no_patterns
from lumpwatch.models.roi import Roi, make_roi
from tests.models.helpers import boxes, whole_picture
from tests.models.net_helpers import drawn, nothing

Array = NDArray[np.float64]
M = len(FEATURES)
ROWS, COLUMNS = 30, 40
GRAY = np.zeros((ROWS * STRIDE, COLUMNS * STRIDE), np.uint8)
LUMP = boxes(1, 80, 60, 48, 40)
"""As large as the body of `ONE`."""
ONE = [(14, 10, 26, 20)]
TWO = [(14, 10, 20, 20), (20, 10, 26, 20)]


def likelihood(weights: Array | None = None, offset: float = 0.0, bound: float = np.inf) -> LumpLikelihood:
    weights = np.zeros(WEIGHTS) if weights is None else weights
    return LumpLikelihood(nothing, np.zeros(M), np.ones(M), weights, offset, 1.0, bound)


def observe(maps: NDArray[np.float32], roi: Roi | None = None) -> LumpObservation:
    view = (roi or whole_picture(GRAY)).view(GRAY)
    return likelihood().observe_maps(maps, view)


def named(seen: LumpObservation, states: Array) -> dict[str, float]:
    features, valid = seen.features(states)
    assert valid[0]
    return dict(zip(FEATURES, features[0], strict=True))


def noisy(seed: int) -> NDArray[np.float32]:
    """Maps of a body and of chance."""
    chance = np.random.default_rng(seed).normal(0, 1, (6, ROWS, COLUMNS))
    return (drawn((ROWS, COLUMNS), ONE) + chance).astype(np.float32)


def part(roi: Roi | None) -> Array:
    mask = np.ones(GRAY.shape) if roi is None else roi.mask
    return mask.reshape(ROWS, STRIDE, COLUMNS, STRIDE).mean(axis=(1, 3))


TRIANGLE = make_roi([(0, 0), (1, 0), (0.2, 1)], GRAY.shape[1], GRAY.shape[0], GRAY.shape[1])


def brute_cells(maps: NDArray[np.float32], shares: Array) -> tuple[Array, Array]:
    """What each cell adds to the sums (ROWS, COLUMNS, SUMS), and its votes (ROWS, COLUMNS, VOTES)."""
    body, edge = (shares * expit(maps[k].astype(float)) for k in (0, 1))
    left, upper, right, lower = np.exp(maps[2:].astype(float)) - REACH
    y, x = STRIDE * (np.mgrid[:ROWS, :COLUMNS] + 0.5)
    size = 0.5 * np.log(np.maximum(left + right, 1) * np.maximum(upper + lower, 1))
    votes = np.stack([body, x - left, y - upper, x + right, y + lower], axis=-1)
    votes[shares == 0] = 0.0
    return np.stack([shares, body, edge, body * size + (shares - body) * np.log(GRAIN_PX)], axis=-1), votes


@pytest.mark.parametrize("roi", [None, TRIANGLE])
def test_sums_and_votes(roi: Roi | None) -> None:
    maps, shares = noisy(1), part(roi)
    inside = (roi or whole_picture(GRAY)).inside
    assert cell_shares(inside) == pytest.approx(shares)
    sums, votes = (
        np.full((ROWS + 1, COLUMNS + 1, SUMS), 7.0),
        np.full((ROWS, COLUMNS, VOTES), 7.0, np.float32),
    )
    sums[0], sums[:, 0] = 0.0, 0.0
    prepare(maps, cell_shares(inside), sums, votes)
    cells, told = brute_cells(maps, shares)
    assert sums[1:, 1:] == pytest.approx(cells.cumsum(axis=0).cumsum(axis=1), rel=1e-4, abs=1e-3)
    assert votes == pytest.approx(told, rel=1e-4, abs=1e-2)


def cells_of(x: float, y: float, w: float, h: float, scale: float) -> tuple[slice, slice]:
    """Rows and columns of cells of a box, its edges on the nearest lines."""

    def line(at: float, most: int) -> int:
        return min(max(int(np.floor(at / STRIDE + 0.5)), 0), most)

    return (
        slice(line(y - scale * h / 2, ROWS), line(y + scale * h / 2, ROWS)),
        slice(line(x - scale * w / 2, COLUMNS), line(x + scale * w / 2, COLUMNS)),
    )


def brute_sides(inner: tuple[slice, slice], outer: tuple[slice, slice]) -> list[tuple[int, int, int, int]]:
    """First and last row and column of the cells between two boxes: left, upper, right, lower, without corners."""
    (a, b), (c, d) = inner, outer
    return [
        (a.start, a.stop, d.start, b.start),
        (c.start, a.start, b.start, b.stop),
        (a.start, a.stop, b.stop, d.stop),
        (a.stop, c.stop, b.start, b.stop),
    ]


def brute_quarters(box: tuple[slice, slice]) -> list[tuple[int, int, int, int]]:
    """The same of the four quarters of a box."""
    rows, columns = box
    y, x = (rows.start + rows.stop) // 2, (columns.start + columns.stop) // 2
    return [
        (*r, *c) for r in ((rows.start, y), (y, rows.stop)) for c in ((columns.start, x), (x, columns.stop))
    ]


def brute_least(cells: Array, parts: list[tuple[int, int, int, int]], channel: int) -> list[float]:
    """Means over those parts of which more than half lies in the polygon, the least first."""
    means = []
    for y0, y1, x0, x1 in parts:
        some = cells[y0:y1, x0:x1].reshape(-1, SUMS)
        if some[:, 0].sum() > 0.5 * len(some):
            means.append(some[:, channel].sum() / some[:, 0].sum())
    return sorted(means)


def brute_features(
    maps: NDArray[np.float32], shares: Array, x: float, y: float, w: float, h: float
) -> list[float]:
    """The features from sums over masks, and from the 21 cells asked one by one."""
    cells, votes = brute_cells(maps, shares)

    def total(scale: float) -> Array:
        return cells[cells_of(x, y, w, h, scale)].sum(axis=(0, 1))

    core, box, rim, ring, around = (total(scale) for scale in (0.6, 1.0, 1.12, 1.5, 3.0))

    def mean(sums: Array, channel: int) -> float:
        return float(sums[channel] / max(sums[0], 0.5))

    own = np.array([x - w / 2, y - h / 2, x + w / 2, y + h / 2])
    asked = []
    for i in range(5):
        for j in range(5):
            row, column = (y + h * (i - 2) / 5) // STRIDE, (x + w * (j - 2) / 5) // STRIDE
            if (i, j) in ((0, 0), (0, 4), (4, 0), (4, 4)):
                continue
            inside = 0 <= row < ROWS and 0 <= column < COLUMNS
            asked.append(votes[int(row), int(column)] if inside else np.zeros(VOTES))
    told, places = np.array(asked)[:, 0], np.array(asked)[:, 1:]
    off = (places - own) / np.array([w, h, w, h])
    total_off = np.abs(off).sum(axis=1)
    far, close = (float((told / (1 + (total_off / reach) ** 2)).sum()) for reach in (1.2, 0.4))
    clipped = (told[:, None] * np.clip(off, -0.6, 0.6)).sum(axis=0) / (told.sum() + 0.5)
    size = np.log(w * h) / 2
    usual = cells[..., 3].sum() / shares.sum()
    grain = np.log(GRAIN_PX)

    def of_bodies(sums: Array) -> float:
        return float(grain + (sums[3] - sums[0] * grain) / (sums[1] + 4.0))

    bodies = of_bodies(around - rim), of_bodies(cells.sum(axis=(0, 1)))
    inner, middle, outer = (cells_of(x, y, w, h, scale) for scale in (0.6, 1.0, 1.12))
    sides = brute_least(cells, brute_sides(inner, outer), 2) or [mean(rim - core, 2)]
    quarters = brute_least(cells, brute_quarters(middle), 1) or [mean(box, 1)]
    return [
        mean(box, 1), mean(core, 1), mean(ring - rim, 1),
        mean(core, 2), mean(rim - core, 2), mean(ring - rim, 2),
        sides[0], sides[1] if len(sides) > 1 else mean(rim - core, 2), quarters[0],
        far / 21, close / 21, far / (told.sum() + 0.5), *clipped,
        size - mean(around - rim, 3), size - mean(ring - rim, 3), size - usual,
        size - bodies[0], size - bodies[1],
        size - np.log(0.23 * GRAY.shape[0]), np.log(w / h),
    ]  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(
    st.floats(10, 150),
    st.floats(10, 110),
    st.floats(8, 70),
    st.floats(8, 70),
    st.sampled_from([None, TRIANGLE]),
)
def test_features_against_brute_force(x: float, y: float, w: float, h: float, roi: Roi | None) -> None:
    maps = noisy(2)
    features, valid = observe(maps, roi).features(boxes(1, x, y, w, h))
    if valid[0]:
        assert features[0] == pytest.approx(brute_features(maps, part(roi), x, y, w, h), rel=1e-3, abs=1e-3)
    else:
        assert np.array_equal(features[0], np.zeros(M))


def test_a_box_half_beside_its_body_has_a_weak_quarter_and_a_weak_side() -> None:
    maps = drawn((ROWS, COLUMNS), ONE)
    whole, half_beside = named(observe(maps), LUMP), named(observe(maps), boxes(1, 104, 60, 48, 40))
    assert whole["body_weakest"] > 0.9
    assert whole["edge_second"] >= whole["edge_weakest"] > 0.3
    assert half_beside["body_weakest"] < 0.1
    assert half_beside["edge_weakest"] < 0.1
    assert half_beside["body"] > 0.4  # which its mean does not show


def test_what_they_tell_of_one_body() -> None:
    seen = named(observe(drawn((ROWS, COLUMNS), ONE)), LUMP)
    assert seen["body"] > 0.9 > 0.1 > seen["body_ring"]
    assert seen["edge_rim"] > 0.3 > 0.05 > seen["edge_core"]
    assert max(abs(seen[side]) for side in ("left", "upper", "right", "lower")) < 0.02
    assert seen["agreement"] > 0.9
    assert seen["close_votes"] > 0.9
    assert seen["size_around"] == pytest.approx(np.log(np.sqrt(48 * 40) / GRAIN_PX), abs=0.05)


def test_two_bodies_that_touch_are_not_one() -> None:
    """They lie on bodies all over, but do not agree on their sides."""
    one, two = (named(observe(drawn((ROWS, COLUMNS), bodies)), LUMP) for bodies in (ONE, TWO))
    assert two["body"] == pytest.approx(one["body"], abs=0.02)
    assert two["close_votes"] < 0.5 < 0.9 < one["close_votes"]
    assert two["agreement"] < one["agreement"] - 0.1


@pytest.mark.parametrize("scale", [0.6, 1.7])
def test_a_box_of_another_size_disagrees_with_its_body(scale: float) -> None:
    state = LUMP.copy()
    state[:, 6:] *= scale
    seen = named(observe(drawn((ROWS, COLUMNS), ONE)), state)
    assert seen["close_votes"] < 0.4
    sign = -1.0 if scale < 1 else 1.0
    assert sign * seen["left"] > 0.1
    assert sign * seen["right"] < -0.1


def test_ground_without_a_body_agrees_with_any_box() -> None:
    seen = named(observe(drawn((ROWS, COLUMNS), [])), LUMP)
    assert max(abs(seen[side]) for side in ("left", "upper", "right", "lower")) < 0.2
    assert seen["body"] < 0.01


def test_size_is_relative_to_what_lies_around() -> None:
    """Among bodies as large as itself a lump is nothing special."""
    many = [(x, y, x + 12, y + 10) for x in (2, 14, 26) for y in (0, 10, 20)]
    alone, among = (named(observe(drawn((ROWS, COLUMNS), bodies)), LUMP) for bodies in (ONE, many))
    for feature in ("size_around", "size_ring", "size_usual", "bodies_around"):
        assert among[feature] < 0.35 < 0.7 < alone[feature]


def test_a_box_that_leaves_the_polygon_is_no_object() -> None:
    seen = observe(noisy(0), TRIANGLE)
    assert not seen.features(boxes(1, 150, 110, 30, 30))[1].any()
    assert seen.score(boxes(1, 150, 110, 30, 30))[0] == -np.inf


@pytest.mark.parametrize(("w", "h"), [(2.9, 20.0), (20.0, 2.9)])
def test_slivers_are_no_objects(w: float, h: float) -> None:
    assert not observe(noisy(0)).features(boxes(1, 60, 50, w, h))[1].any()


@pytest.mark.parametrize("count", [0, 3])
def test_score_is_the_logistic_of_the_features(count: int) -> None:
    rng = np.random.default_rng(1)
    patterns = Patterns(rng.normal(size=(count, M)), rng.normal(size=count))
    model = LumpLikelihood(
        lambda _: noisy(3),
        rng.normal(size=M),
        rng.uniform(0.5, 2, M),
        rng.normal(size=WEIGHTS + count),
        0.7,
        0.3,
        1.0,
        patterns=patterns,
        margin=0.5,
    )
    unbounded = replace(model, bound=np.inf)
    view = whole_picture(GRAY).view(GRAY)
    seen = model.observe(view)
    for state in (LUMP, boxes(1, 40, 40, 30, 30)):
        z = standardised(seen.features(state)[0], model.mean, model.scale)
        logit = float((expand(z, patterns) @ model.weights)[0]) + 0.7
        assert seen.score(state)[0] == pytest.approx(logit, abs=1e-5)
        assert seen.log_ratio(state)[0] == pytest.approx(min(max(0.3 * (logit - 0.5), -1.0), 1.0), abs=1e-5)
        assert unbounded.observe(view).log_ratio(state)[0] == pytest.approx(0.3 * (logit - 0.5), abs=1e-5)


def test_what_is_new_since_the_last_picture_counts() -> None:
    """Two looks a second: a fifth of a look after a tenth of a second, one look at most."""
    model = LumpLikelihood(
        nothing, np.zeros(M), np.ones(M), np.zeros(WEIGHTS), 1.5, 1.0, np.inf, looks_per_s=2.0
    )
    view = whole_picture(GRAY).view(GRAY)
    for dt, share in ((0.1, 0.2), (0.5, 1.0), (30.0, 1.0)):
        assert model.observe(view, dt).log_ratio(LUMP) == pytest.approx([1.5 * share])


def test_expand_by_hand() -> None:
    """(7 - 1) / 2 = 3 and its square 9; (100 - 0) / 1 is limited to 5, and 25; 3 - 5 - 2 = -4 gives -4 / 5."""
    z = standardised(np.array([[7.0, 100.0]]), np.array([1.0, 0.0]), np.array([2.0, 1.0]))
    assert np.array_equal(expand(z, no_patterns(2)), [[3.0, 5.0, 9.0, 25.0]])
    patterns = Patterns(np.array([[1.0, -1.0]]), np.array([-2.0]))
    assert np.array_equal(expand(z, patterns), [[3.0, 5.0, 9.0, 25.0, -0.8]])


def test_next_picture_replaces_the_last() -> None:
    """The reused memory keeps nothing of the picture before."""
    model = likelihood()
    view = whole_picture(GRAY).view(GRAY)
    for seed in range(3):
        reused = model.observe_maps(noisy(seed), view).features(LUMP)[0]
        assert np.array_equal(reused, observe(noisy(seed)).features(LUMP)[0])
