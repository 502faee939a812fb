"""The Markov chain of existence in continuous time (Eq. 5)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from lumpwatch.models.jdt.existence import ExistenceChain

rates = st.floats(1e-4, 50.0)
times = st.floats(1e-4, 20.0)


def transition(chain: ExistenceChain, dt: float) -> NDArray[np.float64]:
    """The matrix T of Eq. 5."""
    birth, death = chain.probabilities(dt)
    return np.array([[1 - birth, birth], [death, 1 - death]])


@given(rates, rates, times, times)
def test_two_steps_equal_one(birth: float, death: float, first: float, second: float) -> None:
    chain = ExistenceChain(birth, death)
    together = transition(chain, first) @ transition(chain, second)
    assert np.allclose(together, transition(chain, first + second), atol=1e-12)


@given(rates, rates, times)
def test_matrix_exponential_of_the_rates(birth: float, death: float, dt: float) -> None:
    generator = np.array([[-birth, birth], [death, -death]])
    assert np.allclose(transition(ExistenceChain(birth, death), dt), expm(generator * dt), atol=1e-10)


def test_hand_values() -> None:
    """b = 1, d = 3, dt = ln 2 / 4: exp(-4 dt) = 1/2, so P_b = 1/4 * 1/2 and P_d = 3/4 * 1/2."""
    birth, death = ExistenceChain(1.0, 3.0).probabilities(math.log(2) / 4)
    assert birth == pytest.approx(0.125, rel=1e-12)
    assert death == pytest.approx(0.375, rel=1e-12)


def test_short_steps_are_rate_times_time() -> None:
    birth, death = ExistenceChain(0.05, 0.4).probabilities(1e-9)
    assert birth == pytest.approx(5e-11, rel=1e-8)
    assert death == pytest.approx(4e-10, rel=1e-8)


def test_long_steps_forget_the_start() -> None:
    """After a long time an object exists with b / (b + d) = 0.2, whatever was before."""
    birth, death = ExistenceChain(0.5, 2.0).probabilities(1e4)
    assert birth == pytest.approx(0.2, rel=1e-12)
    assert 1 - death == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.inf, math.nan])
def test_bad_rates_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="positive and finite"):
        ExistenceChain(bad, 1.0)
    with pytest.raises(ValueError, match="positive and finite"):
        ExistenceChain(1.0, bad)
