"""The lump likelihood of a ROI without a prior; made by `python -m tests.reproduction.defaults`."""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

DEFAULT_LUMP = LumpFit(
    mean=np.array(
        [
            0.16804,
            0.39183,
            -0.13984,
            -0.03781,
            0.02954,
            -0.07528,
            -0.17830,
            -0.14049,
        ]
    ),
    scale=np.array(
        [
            0.48241,
            0.32776,
            0.43083,
            0.24115,
            0.18389,
            0.24431,
            0.33800,
            0.25710,
        ]
    ),
    weights=np.array(
        [
            0.63127,
            0.02865,
            0.10254,
            -0.81546,
            0.16319,
            1.00131,
            -0.62022,
            -0.05050,
            -0.17220,
            0.10905,
            0.06655,
            0.05577,
            0.01672,
            0.01039,
            -0.45216,
            0.16427,
        ]
    ),
    offset=-0.98895,
)
