"""How many independent looks a second of frames holds, on series whose correlation is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.learning.tempering import DEFAULT, LEAST, MOST, looks_per_second

FPS = 20


def series(n: int, correlation: float, between: float, seed: int) -> list[NDArray[np.float64]]:
    """Objects of 10 s: a mean of their own and an AR(1) process of unit variance around it."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(n):
        noise = rng.standard_normal(10 * FPS)
        for k in range(1, len(noise)):
            noise[k] = correlation * noise[k - 1] + np.sqrt(1 - correlation**2) * noise[k]
        out.append(noise + between * rng.standard_normal())
    return out


def looks(tracks: list[NDArray[np.float64]], fps: float = FPS) -> float:
    return looks_per_second([(np.arange(len(one)) / fps, one) for one in tracks])


@pytest.mark.parametrize(("correlation", "between"), [(0.5, 0.0), (0.8, 0.0), (0.6, 0.5), (0.9, 1.0)])
def test_looks_are_what_the_correlation_leaves(correlation: float, between: float) -> None:
    """Var(mean of K) of an AR(1): the sum of all K x K correlations over K^2."""
    lags = np.abs(np.subtract.outer(np.arange(FPS), np.arange(FPS)))
    of_mean = (correlation**lags).mean() + between**2
    assert looks(series(400, correlation, between, 1)) == pytest.approx((1 + between**2) / of_mean, rel=0.08)


def test_independent_frames_all_count_and_repeated_ones_count_once() -> None:
    rng = np.random.default_rng(2)
    assert looks([rng.standard_normal(200) for _ in range(50)]) == MOST
    repeated = [np.repeat(rng.standard_normal(10), FPS) for _ in range(50)]
    assert looks(repeated) == pytest.approx(1.0)


def test_looks_do_not_depend_on_the_frame_rate() -> None:
    tracks = series(200, 0.97, 0.5, 3)
    assert looks([one[::4] for one in tracks], FPS / 4) == pytest.approx(looks(tracks), rel=0.05)


def test_too_little_to_learn_from_leaves_the_default() -> None:
    assert looks([]) == DEFAULT
    (one,) = series(1, 0.5, 0.0, 4)
    assert looks([one[: 7 * FPS]]) == DEFAULT
    assert looks([one[: 8 * FPS]]) != DEFAULT


@given(st.lists(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=60), max_size=12))
def test_any_series_give_a_rate_in_its_bounds(tracks: list[list[float]]) -> None:
    assert LEAST <= looks([np.array(one) for one in tracks]) <= MOST
