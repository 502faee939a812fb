"""How much a region must have looked at before nothing found means that nothing is there."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.base import Delay, PositiveSeconds, Strict


class SightConfig(Strict):
    """How many judged frames CLEAR needs; with fewer a ROI is BLIND (`starting`, `few_frames`).

    A lump is found over many frames. The defaults are what one on a belt at 0.6 m/s takes: it was announced in time at
    4 judged frames a second, late at 3, never at 2.
    """

    least_frames: Annotated[int, Field(ge=1, le=1000)] = 20
    """So many judged frames within `within_s` are needed to find a lump."""
    within_s: PositiveSeconds = 5.0
    """The time in which they must have been judged; shorter on a calibrated belt whose `speed_m_s` carries a lump
    across the region in less."""
    warm_up_s: Delay = 2.0
    """A filter that began anew must have judged frames for so long, too."""
    longest_gap_s: PositiveSeconds = 1.0
    """After a longer time without a judged frame it begins anew."""

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.warm_up_s > self.within_s:
            raise ValueError(
                f"warm_up_s ({self.warm_up_s:g}) must not be longer than within_s ({self.within_s:g})"
            )
        return self
