"""The lump likelihood of a ROI without a prior; made by `python -m tests.reproduction.defaults`."""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

DEFAULT_LUMP = LumpFit(
    mean=np.array(
        [
            0.16214,
            0.38812,
            -0.14610,
            -0.05333,
            0.04078,
            -0.08143,
            -0.08248,
            -0.02915,
        ]
    ),
    scale=np.array(
        [
            0.47962,
            0.32510,
            0.42787,
            0.25152,
            0.19080,
            0.24232,
            0.34968,
            0.26215,
        ]
    ),
    weights=np.array(
        [
            0.65330,
            0.00574,
            0.08024,
            -0.93328,
            0.20193,
            0.96097,
            -0.68124,
            -0.01332,
            -0.16308,
            0.11027,
            0.06395,
            0.07541,
            -0.00403,
            0.00336,
            -0.50122,
            0.19763,
        ]
    ),
    offset=-1.16507,
)
