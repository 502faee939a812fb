"""Writes net and score as they ship."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning import LumpFit
from lumpwatch.service.storage import encode_fit


def rounded(weights: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float16]]:
    """A net's weights in half as many digits, as they ship: the score is fitted to what they then say."""
    return {key: value.astype(np.float16) for key, value in weights.items()}


def write(file: Path, weights: dict[str, NDArray[np.float16]], fit: LumpFit) -> None:
    """The file that `lumpwatch.service.detection.shipped_likelihood` reads."""
    arrays = {name: array.astype(np.float32) for name, array in encode_fit(fit).items()}
    for default in ("fit_looks", "fit_margin", "fit_net"):  # a prior's own
        arrays.pop(default, None)
    np.savez(file, allow_pickle=False, **arrays, **{f"net_{key}": value for key, value in weights.items()})
