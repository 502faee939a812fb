"""Learning while running: footage to refine a prior with, and the trial of the result in shadow."""

from __future__ import annotations

from pydantic import Field

from lumpwatch.service.config.base import PositiveSeconds, Strict


class LearningConfig(Strict):
    """Refining a prior while the daemon runs; nothing of it decides before it is promoted by command."""

    footage_mb: int = Field(default=0, ge=0, le=1_000_000)
    """How much labelled footage `train` and `refine` keep for the next refinement, in megabytes; 0: none."""
    shadow_match_s: PositiveSeconds = 5.0
    """Alarms of the prior in use and of that in shadow are the same one within this time."""
