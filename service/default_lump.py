"""The lump likelihood of a ROI without a prior: fitted on simulated feeds, see docs/training.md."""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

DEFAULT_LUMP = LumpFit(np.zeros(8), np.ones(8), np.zeros(16), -1.0)
