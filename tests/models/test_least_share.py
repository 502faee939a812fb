"""A least share of particles for every motion model changes the particles, not the law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lumpwatch.models.jdt.existence import ExistenceChain
from lumpwatch.models.jdt.filter import Form
from tests.models.filters import DT, belief_of, both_forms, make_filter
from tests.models.helpers import flat

RARE = [[0.99, 0.01], [0.99, 0.01]]


@both_forms
def test_the_law_of_the_labels_stays(form: Form) -> None:
    """The second model has probability 0.01, whatever share of the particles tries it."""
    chain = ExistenceChain(1e-9, 1e-9)
    spread = {}
    for least in (0.0, 0.3):
        jdt = replace(make_filter(RARE, chain=chain, particles=4000, form=form), least_share=least)
        shares = []
        for seed in range(20):
            step = jdt.step(belief_of(jdt, 1.0), flat(0.0), DT, np.random.default_rng(seed))
            assert step.estimate is not None
            shares.append(step.estimate.model_shares[1])
        spread[least] = np.std(shares)
        assert np.mean(shares) == pytest.approx(0.01, abs=4 * spread[least] / np.sqrt(20) + 1e-6)
    # With 1,200 particles instead of some 40 the share is known far better.
    assert spread[0.3] < 0.5 * spread[0.0]


@both_forms
def test_existence_stays(form: Form) -> None:
    """No evidence: existence of 0.9 stays 0.9."""
    chain = ExistenceChain(1e-9, 1e-9)
    jdt = replace(make_filter(RARE, chain=chain, particles=4000, form=form), least_share=0.3)
    values = [
        jdt.step(belief_of(jdt, 0.9), flat(0.0), DT, np.random.default_rng(seed)).belief.existence
        for seed in range(20)
    ]
    assert np.mean(values) == pytest.approx(0.9, abs=4 * np.std(values) / np.sqrt(20) + 1e-3)


def test_a_share_that_is_too_large_is_refused() -> None:
    with pytest.raises(ValueError, match="least_share"):
        replace(make_filter(RARE), least_share=0.6)
