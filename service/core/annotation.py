"""Colours and words of what is drawn into a picture."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.core.decision import Decision, RoiResult
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
    words = [found.model, f"P {found.existence:.2f}"]
    if found.size is not None and found.size.longest_mm is not None:
        words.append(f"{found.size.longest_mm:.0f} mm")
    if found.size is not None and found.size.lip_s is not None:
        words.append(f"lip in {found.size.lip_s:.1f} s")
    if found.wrong_way:
        words.append("WRONG WAY")
    if found.not_counted is not None:
        words.append(found.not_counted.replace("_", " "))
    return " ".join(words)


def state_of(result: RoiResult) -> str:
    """The decision with its reason."""
    why = (
        f" ({result.reason.value})" if result.decision is Decision.BLIND and result.reason is not None else ""
    )
    return f"{result.decision.value}{why}"


_FONT, _SCALE, _PAD = cv2.FONT_HERSHEY_SIMPLEX, 0.5, 3


def write_words(
    canvas: NDArray[np.uint8], words: str, at: tuple[int, int], ink: tuple[int, int, int]
) -> None:
    """Words on a dark ground, lower left corner `at`; moved as far as needed to lie within the picture."""
    (width, height), base = cv2.getTextSize(words, _FONT, _SCALE, 1)
    left = max(min(at[0], canvas.shape[1] - width - 2 * _PAD), 0)
    low = max(min(at[1], canvas.shape[0]), height + base + 2 * _PAD)
    corner = (left, low - height - base - 2 * _PAD)
    cv2.rectangle(canvas, corner, (left + width + 2 * _PAD, low), (25, 25, 25), -1)
    cv2.putText(canvas, words, (left + _PAD, low - base - _PAD), _FONT, _SCALE, ink, 1, cv2.LINE_AA)


def label_object(
    canvas: NDArray[np.uint8],
    words: str,
    low: tuple[int, int],
    high: tuple[int, int],
    ink: tuple[int, int, int],
) -> None:
    """Words outside the box `low` to `high`: above it, or below where above is no room."""
    above = low[1] - 8
    write_words(canvas, words, (low[0], above if above > 24 else high[1] + 26), ink)


def draw_lip(
    canvas: NDArray[np.uint8],
    ends: tuple[tuple[int, int], tuple[int, int]],
    ink: tuple[int, int, int] = (255, 255, 255),
) -> None:
    """The line at which lumps leave the belt."""
    cv2.line(canvas, *ends, (25, 25, 25), 4, cv2.LINE_AA)
    cv2.line(canvas, *ends, ink, 2, cv2.LINE_AA)
    write_words(canvas, "lip", (ends[0][0], ends[0][1] - 4), ink)
