"""How long something held of late, in all: what comes and goes does not begin anew each time.

Pure; times are seconds on one clock that never goes back.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Spells:
    """When a condition held, as far as a sliding window reaches back."""

    past: tuple[tuple[float, float], ...] = ()
    """Spells that are over: begin and end, in order."""
    since_s: float | None = None
    """Since when it has held; None: it does not."""
    free_s: float | None = None
    """Since when it has not held; None: it holds, or nothing is known yet."""

    def step(self, time_s: float, *, holds: bool, window_s: float) -> Spells:
        """After it was seen to hold or not at `time_s`; what lies before the window is forgotten."""
        past = tuple(spell for spell in self.past if spell[1] > time_s - window_s)
        if holds:
            since_s = time_s if self.since_s is None else self.since_s
            return Spells(past, since_s, None)
        if self.since_s is not None:
            past = (*past, (self.since_s, time_s))
        return Spells(past, None, time_s if self.free_s is None else self.free_s)

    def total_s(self, time_s: float, window_s: float) -> float:
        """For how long in all it has held within the window that ends at `time_s`."""
        begin_s = time_s - window_s
        spells = self.past if self.since_s is None else (*self.past, (self.since_s, time_s))
        return sum(max(0.0, min(end, time_s) - max(begin, begin_s)) for begin, end in spells)

    def free_for_s(self, time_s: float) -> float:
        """For how long it has not held without a break."""
        return 0.0 if self.free_s is None else time_s - self.free_s

    @property
    def many(self) -> bool:
        """Whether it came more than once within the window."""
        return len(self.past) + (self.since_s is not None) > 1
