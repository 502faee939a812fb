"""Whether a lump comes for which an alarm that stands was not raised: it is announced too."""

from __future__ import annotations

from dataclasses import dataclass

from lumpwatch.service.core import DetectedObject, Detection
from lumpwatch.service.detection.overlap import SAME_PLACE, shared

STEADY_S = 0.5
"""How long it must be as sure as what raises an alarm: an alarm stands already, so there is time to be sure."""
FORGOTTEN_S = 2.0
"""How long after a lump was lost what is found at its place is taken for the same."""


@dataclass(slots=True)
class _Told:
    last_s: float
    found: DetectedObject


class NextLump:
    """Of one region; times are those of frames and rise."""

    def __init__(self) -> None:
        self._told: dict[int, _Told] = {}
        self._since_s: dict[int, float] = {}

    def raised(self, detection: Detection, time_s: float) -> None:
        """The alarm is raised for all that is there."""
        self._since_s.clear()
        self._told = {found.id: _Told(time_s, found) for found in detection.counted}

    def cleared(self) -> None:
        """The alarm is over."""
        self._told.clear()
        self._since_s.clear()

    def comes(self, detection: Detection, time_s: float, raise_above: float, certain: float) -> bool:
        """Whether one more lump is there while the alarm stands; said once of each."""
        new: set[int] = set()
        sure = [found for found in detection.counted if _alarms(found, raise_above, certain)]
        for found in detection.counted:
            if found.id in self._told or any(
                self._is_of(told, found, time_s) for told in self._told.values()
            ):
                self._told[found.id] = _Told(time_s, found)
            elif found in sure:
                new.add(found.id)
        self._since_s = {i: self._since_s.get(i, time_s) for i in new}
        due = [f for f in sure if time_s - self._since_s.get(f.id, time_s) >= STEADY_S - 1e-6]
        self._told.update({found.id: _Told(time_s, found) for found in due})
        self._told = {i: told for i, told in self._told.items() if time_s - told.last_s <= FORGOTTEN_S}
        return bool(due)

    @staticmethod
    def _is_of(told: _Told, found: DetectedObject, time_s: float) -> bool:
        """Whether it lies where that lump is, or was when it was lost, or would be by now."""
        since_s = time_s - told.last_s
        return any(_covers(told.found, found, t) >= SAME_PLACE for t in (0.0, since_s))


def _alarms(found: DetectedObject, raise_above: float, certain: float) -> bool:
    large = found.size is None or found.size.over_limit >= certain
    return large and found.existence > raise_above


def _covers(told: DetectedObject, found: DetectedObject, since_s: float) -> float:
    """What they share once the first has gone on for so long."""
    low = told.x + told.vx * since_s, told.y + told.vy * since_s
    return shared(low, (told.w, told.h), (found.x, found.y), (found.w, found.h))
