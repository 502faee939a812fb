"""The largest lump of an alarm, as it was measured last: when an alarm is raised its size is a first estimate."""

from __future__ import annotations

from lumpwatch.service.core import LumpSize, RoiResult


class LargestLump:
    """Follows the sizes of one ROI's objects while its lump alarm is active."""

    def __init__(self) -> None:
        self._sizes: dict[int, LumpSize] = {}
        self._active = False

    def observe(self, result: RoiResult) -> None:
        """A result of that ROI, before its changes are announced."""
        active = result.alarm.active
        if active and not self._active:
            self._sizes.clear()
        self._active = active
        if result.detection is not None and active:
            known = (found for found in result.detection.counted if found.size is not None)
            self._sizes |= {
                found.id: found.size for found in known if found.size and found.size.longest_mm is not None
            }

    def details(self) -> dict[str, float | str | None]:
        """Longest diameter in mm and the interval that holds it with 90 %; empty where none is known."""
        if not self._sizes:
            return {}
        largest = max(self._sizes.values(), key=lambda size: size.longest_mm or 0.0)
        names = ("longest_mm", "low_mm", "high_mm")
        values = {name: getattr(largest, name) for name in names}
        return {name: None if value is None else round(value) for name, value in values.items()}
