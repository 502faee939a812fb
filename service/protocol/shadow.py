"""The state of a shadow, on the bus and in the store."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from pydantic import Field

from lumpwatch.service.protocol.messages import Record

Side = Literal["both", "only_current", "only_shadow"]
SIDES: tuple[Side, ...] = ("both", "only_current", "only_shadow")
"""Who raised an alarm."""


@dataclass(frozen=True, slots=True)
class Counts:
    """What was counted so far."""

    agree_s: float = 0.0
    """Seconds in which both decided the same."""
    only_current_s: float = 0.0
    """Seconds in which only the prior in use saw a lump."""
    only_shadow_s: float = 0.0
    both: int = 0
    """Alarms that both raised."""
    only_current: int = 0
    only_shadow: int = 0
    lead_s: float = 0.0
    """By how much the shadow was earlier, summed over the alarms that both raised."""
    frames: int = 0
    """Frames that the shadow filtered."""
    skipped: int = 0
    """Frames that it left out for want of time."""

    @property
    def judged_s(self) -> float:
        """Seconds in which both decided."""
        return self.agree_s + self.only_current_s + self.only_shadow_s


class ShadowState(Record):
    """A prior that runs in shadow on a ROI, and how its decisions differ from those of the prior in use."""

    camera: str
    """Camera id."""
    roi: str
    """ROI id."""
    version: int
    """Version that runs in shadow."""
    current: int
    """Version in use that it is compared with; 0: the stated defaults."""
    since: datetime
    """Since when the two have been compared (UTC); restarts do not begin anew."""
    time: datetime
    """When this was written (UTC)."""
    failed: str | None = None
    """Why it does not run any more; null: it runs."""
    existence: float | None = Field(default=None, ge=0.0, le=1.0)
    """Probability of a lump by the shadow; null before its first frame."""
    lump: bool = False
    """Whether the shadow would have an alarm now."""
    agree_s: float = 0.0
    """Seconds in which both decided the same."""
    only_current_s: float = 0.0
    """Seconds in which only the prior in use had an alarm."""
    only_shadow_s: float = 0.0
    """Seconds in which only the shadow would have had one."""
    both: int = 0
    """Alarms of both, raised within `learning.shadow_match_s` of each other."""
    only_current: int = 0
    """Alarms that only the prior in use raised."""
    only_shadow: int = 0
    """Alarms that only the shadow would have raised."""
    lead_s: float = 0.0
    """How much earlier the shadow was, summed over the alarms of both."""
    frames: int = 0
    """Frames that the shadow filtered."""
    skipped: int = 0
    """Frames that it left out because the time was needed otherwise."""

    @property
    def counts(self) -> Counts:
        """To go on counting."""
        return Counts(
            self.agree_s,
            self.only_current_s,
            self.only_shadow_s,
            self.both,
            self.only_current,
            self.only_shadow,
            self.lead_s,
            self.frames,
            self.skipped,
        )


def summary(state: ShadowState) -> list[str]:
    """The state in lines for people."""
    counts = state.counts
    judged_s = max(counts.judged_s, 1e-9)
    rival = f"version {state.current}" if state.current else "the stated defaults"
    looked = counts.frames + counts.skipped
    lines = [
        f"{state.camera}/{state.roi}: version {state.version} in shadow of {rival}",
        f"  since {state.since:%Y-%m-%d %H:%M:%S} UTC, told {state.time:%Y-%m-%d %H:%M:%S} UTC",
        f"  compared   {counts.judged_s / 3600:.2f} h, the same decision in "
        f"{100 * counts.agree_s / judged_s:.2f} %",
        f"  alarm of   both {counts.both}, only the one in use {counts.only_current}, "
        f"only the shadow {counts.only_shadow}",
        f"  seconds of only the one in use {counts.only_current_s:.1f}, only the shadow "
        f"{counts.only_shadow_s:.1f}",
        f"  frames     {counts.frames} looked at, {counts.skipped} left out "
        f"({100 * counts.skipped / max(looked, 1):.0f} %)",
    ]
    if counts.both:
        lines.append(f"  the shadow was earlier by {counts.lead_s / counts.both:+.2f} s on average")
    if state.failed is not None:
        lines.append(f"  ended: {state.failed}")
    return lines
