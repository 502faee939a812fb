"""Colours and words of what is drawn into a picture."""

from __future__ import annotations

from lumpwatch.service.core.decision import Decision
from lumpwatch.service.core.detection import DetectedObject

COLOURS = {
    Decision.CLEAR: (110, 200, 90),
    Decision.LUMP: (60, 60, 235),
    Decision.BLIND: (0, 190, 240),
    Decision.BLOCKED: (60, 60, 235),
}
"""Of a decision, blue, green and red."""
NOT_COUNTED = (150, 150, 150)
"""Of an object that does not count for the alarm."""


def label_of(found: DetectedObject) -> str:
    """Model, size and seconds to the lip in a few words."""
    words = [found.model]
    if found.size is not None and found.size.longest_mm is not None:
        words.append(f"{found.size.longest_mm:.0f} mm")
    if found.size is not None and found.size.lip_s is not None:
        words.append(f"{found.size.lip_s:.1f} s")
    if found.wrong_way:
        words.append("WRONG WAY")
    if found.not_counted is not None:
        words.append(found.not_counted.replace("_", " "))
    return " ".join(words)
