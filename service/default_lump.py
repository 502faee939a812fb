"""The lump likelihood of a ROI without a prior; made by `python -m tests.reproduction.defaults`."""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

DEFAULT_LUMP = LumpFit(
    mean=np.array(
        [
            0.16379,
            0.38864,
            -0.14528,
            -0.05351,
            0.04101,
            -0.08095,
            -0.08248,
            -0.02897,
        ]
    ),
    scale=np.array(
        [
            0.47994,
            0.32578,
            0.42850,
            0.25185,
            0.19110,
            0.24236,
            0.34961,
            0.26200,
        ]
    ),
    weights=np.array(
        [
            0.64628,
            0.01058,
            0.07713,
            -0.93630,
            0.19383,
            0.95662,
            -0.68082,
            -0.00850,
            -0.15980,
            0.10773,
            0.06326,
            0.07458,
            -0.00524,
            0.00443,
            -0.49812,
            0.19828,
        ]
    ),
    offset=-1.16103,
)
