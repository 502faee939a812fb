"""What the shadow would have done otherwise: seconds and alarms, counted as time goes by.

Two alarms are the same one where they were raised within `match_s` of each other; each takes part in one
pair only, the earliest first, which makes as many pairs as can be made. An alarm that has found no
partner after `match_s` is one of its side alone. Compared is the condition with its delays: what an
operator shelves, suppresses or acknowledges plays no part.

Counting begins with the first frame on which the prior in use has no alarm, so that an alarm that stood
already when the shadow began is held against neither.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

from lumpwatch.service.protocol import Counts, Side

_MARGIN_S = 1e-6
"""Time stamps are multiples of a frame interval: rounding must not decide."""


@dataclass(frozen=True, slots=True)
class Difference:
    """An alarm whose partner was found, or is not to be found any more."""

    side: Side
    time_s: float
    """When it was raised; of a pair, the earlier time."""
    lead_s: float = 0.0
    """Of a pair: how much earlier the shadow was."""


class Differences:
    """Counts one pair of deciders; times ascend."""

    def __init__(self, match_s: float, longest_s: float, counts: Counts | None = None) -> None:
        """After more than `longest_s` without a decision counting begins anew."""
        self.counts = counts or Counts()
        self._match_s = match_s
        self._longest_s = longest_s
        self._last: tuple[float, bool, bool] | None = None
        self._waiting: deque[tuple[float, bool]] = deque()
        """Alarms without a partner, oldest first, all of one side: time, and whether the shadow's."""

    def step(self, time_s: float, current: bool, shadow: bool) -> tuple[Difference, ...]:
        """Whether either has an alarm from this time on; returns what became clear by now."""
        if self._last is not None and time_s - self._last[0] > self._longest_s:
            self.interrupt()
        if self._last is None:
            if not current:
                self._last = (time_s, current, shadow)
            return ()
        before_s, was_current, was_shadow = self._last
        self._last = (time_s, current, shadow)
        self._spent(time_s - before_s, was_current, was_shadow)
        found = self._expired(time_s)
        if current and not was_current:
            found += self._raised(time_s, of_shadow=False)
        if shadow and not was_shadow:
            found += self._raised(time_s, of_shadow=True)
        for difference in found:
            self._add(difference)
        return found

    def interrupt(self) -> None:
        """One of the two cannot decide any more; counting begins anew with the next step."""
        self._last = None
        self._waiting.clear()

    def _spent(self, seconds: float, current: bool, shadow: bool) -> None:
        counts = self.counts
        if current == shadow:
            self.counts = replace(counts, agree_s=counts.agree_s + seconds)
        elif current:
            self.counts = replace(counts, only_current_s=counts.only_current_s + seconds)
        else:
            self.counts = replace(counts, only_shadow_s=counts.only_shadow_s + seconds)

    def _raised(self, time_s: float, of_shadow: bool) -> tuple[Difference, ...]:
        if not self._waiting or self._waiting[0][1] == of_shadow:
            self._waiting.append((time_s, of_shadow))
            return ()
        partner_s, _ = self._waiting.popleft()
        lead_s = partner_s - time_s if of_shadow else time_s - partner_s
        return (Difference("both", partner_s, lead_s),)

    def _expired(self, time_s: float) -> tuple[Difference, ...]:
        found: tuple[Difference, ...] = ()
        while self._waiting and time_s - self._waiting[0][0] > self._match_s + _MARGIN_S:
            raised_s, of_shadow = self._waiting.popleft()
            found += (Difference("only_shadow" if of_shadow else "only_current", raised_s),)
        return found

    def _add(self, found: Difference) -> None:
        counts = self.counts
        if found.side == "both":
            self.counts = replace(counts, both=counts.both + 1, lead_s=counts.lead_s + found.lead_s)
        elif found.side == "only_current":
            self.counts = replace(counts, only_current=counts.only_current + 1)
        else:
            self.counts = replace(counts, only_shadow=counts.only_shadow + 1)
