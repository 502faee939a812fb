"""What the report says in words."""

from __future__ import annotations

import pytest

from lumpwatch.models.learning.validation import Bin
from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.service.training.report import _WORDS, reliable


def test_every_feature_has_its_words() -> None:
    assert set(_WORDS) == set(FEATURES)


def bins(*pairs: tuple[float, float]) -> list[Bin]:
    return [Bin(predicted, observed, 10, 10) for predicted, observed in pairs]


@pytest.mark.parametrize(
    ("curve", "verdict"),
    [
        (((0.1, 0.12), (0.5, 0.47), (0.9, 0.91)), "it can be trusted; on average it is 2% off"),
        # U-shaped: what it claims too little at both ends and too much between must not cancel out.
        (((0.1, 0.4), (0.5, 0.1), (0.9, 0.99)), "do not read it as a probability; on average it is 26% off"),
        (
            ((0.1, 0.2), (0.5, 0.6), (0.8, 0.9)),
            "use it with care; on average it is 10% off and claims less than",
        ),
        (((0.3, 0.2), (0.6, 0.5), (0.9, 0.8)), "claims more than it may"),
    ],
)
def test_deviations_from_the_diagonal_count_by_their_size(
    curve: tuple[tuple[float, float], ...], verdict: str
) -> None:
    assert verdict in reliable(bins(*curve))
