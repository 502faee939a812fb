"""Debounces the findings of the checks: each reason has a time to enter and a time to leave.

Pure; times are those of frames. Whatever the order of findings: once something has been found without a
break for the longest of the entry times, the ROI is BLIND.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from lumpwatch.service.core.decision import BlindReason

_ORDER = {reason: k for k, reason in enumerate(BlindReason)}
_ROUNDING_S = 1e-6  # times are multiples of a frame interval


@dataclass(frozen=True, slots=True)
class DebounceTimes:
    """How long a finding must last to count, and its absence to end it."""

    entry_s: float
    exit_s: float


@dataclass(slots=True)
class _Check:
    since_s: float | None = None
    """Since when the finding contradicts `active`."""
    active: bool = False


class ReasonDebouncer:
    """The reasons for which one ROI is BLIND."""

    def __init__(self, times: Mapping[BlindReason, DebounceTimes]) -> None:
        """Reasons without times are ignored."""
        self._times = dict(times)
        self._checks = {reason: _Check() for reason in times}
        self._unfit_since_s: float | None = None
        self.limit_s = max((limits.entry_s for limits in times.values()), default=0.0)
        """After so long with anything found the ROI is BLIND."""

    @property
    def reasons(self) -> Collection[BlindReason]:
        """All that are debounced."""
        return self._times.keys()

    @property
    def reason(self) -> BlindReason | None:
        """The first of the active reasons, in the order of `BlindReason`."""
        active = [reason for reason, check in self._checks.items() if check.active]
        return min(active, key=_ORDER.__getitem__, default=None)

    def step(self, time_s: float, found: Collection[BlindReason]) -> BlindReason | None:
        """The reason after the checks have found these at `time_s`; times never fall."""
        relevant = [reason for reason in found if reason in self._checks]
        if not relevant:
            self._unfit_since_s = None
        elif self._unfit_since_s is None:
            self._unfit_since_s = time_s
        unfit_s = 0.0 if self._unfit_since_s is None else time_s - self._unfit_since_s
        for reason, check in self._checks.items():
            if (reason in relevant) is check.active:
                check.since_s = None
                continue
            check.since_s = time_s if check.since_s is None else check.since_s
            times = self._times[reason]
            lasted, needed = time_s - check.since_s, times.exit_s if check.active else times.entry_s
            over_all = not check.active and unfit_s >= self.limit_s - _ROUNDING_S
            if lasted >= needed - _ROUNDING_S or over_all:
                check.active, check.since_s = not check.active, None
        return self.reason
