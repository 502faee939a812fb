"""When a ROI raises and clears its alarms, and what may keep them from being announced."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from lumpwatch.service.config.base import Delay, PositiveSeconds, Probability, Strict
from lumpwatch.service.core import Priority


class AnnunciationConfig(Strict):
    """What both classes of alarm have."""

    priority: Priority = "high"
    """How soon an operator must respond."""
    re_alarm_s: PositiveSeconds | None = None
    """An alarm that nobody acknowledged is announced again after this long; left out: never."""
    shelve_max_s: PositiveSeconds = 28_800.0
    """The longest time for which it may be shelved at once."""
    suppress_max_s: PositiveSeconds = 3_600.0
    """The longest validity that a plant signal may claim for its suppression."""
    needs_reset: bool = False
    """After it is over and acknowledged, stay LATCHED until someone resets it."""


class ConditionAlarmConfig(AnnunciationConfig):
    """An alarm whose condition holds or does not."""

    on_delay_s: Delay = 0.0
    """How long the condition must hold without a break."""
    off_delay_s: Delay = 2.0
    """How long it must be over without a break."""
    latch: bool = False
    """After it is over, stay in RETURNED until someone acknowledges."""

    @property
    def raise_above(self) -> float:
        """A condition that holds counts as 1, one that does not as 0."""
        return 0.5

    @property
    def clear_below(self) -> float:
        """See `raise_above`."""
        return 0.5


class BlindAlarmConfig(ConditionAlarmConfig):
    """The alarm that a ROI cannot judge: class `blind`."""

    on_delay_s: Delay = 5.0
    """How long the ROI must be BLIND in all within `window_s`; the state says so at once."""
    window_s: PositiveSeconds | None = None
    """The time over which that is summed up. The alarm stands as long as the ROI went blind more than once in it. Left
    out: 30 s, or as long as `on_delay_s` where that is longer."""

    @property
    def summed_over_s(self) -> float:
        """`window_s`, or its default."""
        return max(30.0, self.on_delay_s) if self.window_s is None else self.window_s

    @model_validator(mode="after")
    def _within(self) -> Self:
        if self.summed_over_s < self.on_delay_s:
            raise ValueError(
                f"window_s ({self.window_s:g}) must not be shorter than on_delay_s ({self.on_delay_s:g})"
            )
        return self


class SystemAlarmConfig(ConditionAlarmConfig):
    """The alarm that decisions come too late, or that a proof test failed or is overdue: class `system`."""

    priority: Priority = "medium"
    """How soon an operator must respond."""


class BlockedAlarmConfig(ConditionAlarmConfig):
    """The alarm that a mouth is blocked: class `blocked`, of regions with `watch: mouth`."""

    on_delay_s: Delay = 8.0
    """How long material must stand in the mouth without a break while the feed runs."""
    latch: bool = True
    """After the mouth is free, stay in RETURNED until someone acknowledges."""


class AlarmConfig(AnnunciationConfig):
    """Hysteresis and delays between the probability of existence and the alarm of class `lump`."""

    raise_above: Probability = 0.9
    """Existence must exceed this to raise the alarm; left out with the lump likelihood: 0.999."""
    clear_below: Probability = 0.5
    """Existence must fall below this to clear the alarm."""
    oversize_above: Probability = 0.6
    """On a calibrated belt with a limit: a lump counts from this probability of being above the limit."""
    on_delay_s: Delay = 0.2
    """How long existence must stay above `raise_above` without a break; left out with the lump likelihood: 0.5 s."""
    off_delay_s: Delay = 2.0
    """How long existence must stay below `clear_below` without a break."""
    latch: bool = True
    """After the lump has gone, stay in RETURNED until someone acknowledges."""
    blind: BlindAlarmConfig = BlindAlarmConfig()
    """The alarm that the ROI cannot judge."""
    system: SystemAlarmConfig = SystemAlarmConfig()
    """The alarm that the ROI does not judge as well as it must."""
    blocked: BlockedAlarmConfig = BlockedAlarmConfig()
    """The alarm that material stands in the mouth that the ROI watches."""

    def of_class(self, alarm_class: str) -> AlarmConfig | ConditionAlarmConfig:
        """The rules of one class of alarm."""
        if alarm_class == "lump":
            return self
        rules: ConditionAlarmConfig = getattr(self, alarm_class)
        return rules

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.clear_below < self.raise_above:
            raise ValueError(
                f"clear_below ({self.clear_below:g}) must be smaller than raise_above ({self.raise_above:g})"
            )
        return self
