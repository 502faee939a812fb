"""The report explains every feature."""

from __future__ import annotations

from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.service.training.report import _WORDS


def test_every_feature_has_its_words() -> None:
    assert set(_WORDS) == set(FEATURES)
