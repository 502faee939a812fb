"""How much time the shadows of a camera may take: what is left of the interval between frames.

The filters of the priors in use and those in shadow together use at most `SHARE` of the time between two
frames of the camera. What the former leave of it is saved up, for hardly more than one round of all
shadows, and a shadow runs once its cost has been saved. So a shadow that costs twice what is left runs on every
second frame, and one on a machine that is busy anyway does not run at all.
"""

from __future__ import annotations

SHARE = 0.8
_MOST_DEBT_S = 1.0
_WEIGHT = 0.2


class Budget:
    """Saved time and what each shadow costs; names are those of ROIs."""

    def __init__(self) -> None:
        self._saved_s = 0.0
        self._cost_s: dict[str, float] = {}

    def earn(self, interval_s: float, spent_s: float) -> None:
        """A frame has come `interval_s` after the last one; the priors in use took `spent_s` for it."""
        left_s = max(0.0, SHARE * interval_s - spent_s)
        self._saved_s = min(self._saved_s, sum(self._cost_s.values())) + left_s

    def allows(self, roi: str) -> bool:
        """Whether the shadow of that ROI may run now."""
        return self._saved_s > 0.0 and self._saved_s >= self._cost_s.get(roi, 0.0)

    def spend(self, roi: str, seconds: float) -> None:
        """A shadow has run."""
        before = self._cost_s.get(roi, seconds)
        self._cost_s[roi] = before + _WEIGHT * (seconds - before)
        # A hiccup, such as a process that was stopped, must not keep the shadow away for long.
        self._saved_s = max(self._saved_s - seconds, -_MOST_DEBT_S)

    def forget(self, roi: str) -> None:
        """There is no shadow on that ROI any more."""
        self._cost_s.pop(roi, None)
