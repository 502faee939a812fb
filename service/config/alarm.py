"""When a ROI raises and clears its alarm."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from service.config.base import Delay, Probability, Strict


class AlarmConfig(Strict):
    """Hysteresis and delays between the probability of existence and the alarm."""

    raise_above: Probability = 0.9
    """Existence must exceed this to raise the alarm."""
    clear_below: Probability = 0.5
    """Existence must fall below this to clear the alarm."""
    on_delay_s: Delay = 0.2
    """How long existence must stay above `raise_above` without a break."""
    off_delay_s: Delay = 2.0
    """How long existence must stay below `clear_below` without a break."""
    latch: bool = True
    """After the lump has gone, stay in RETURNED until someone acknowledges."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.clear_below < self.raise_above:
            raise ValueError(
                f"clear_below ({self.clear_below:g}) must be smaller than raise_above ({self.raise_above:g})"
            )
        return self
