"""The annotated still: the frame that raised the alarm with polygon, boxes, existence and size."""

from __future__ import annotations

from datetime import UTC, datetime

import cv2
import numpy as np

from lumpwatch.models.roi import Image
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import (
    COLOURS,
    NOT_COUNTED,
    draw_lip,
    label_object,
    label_of,
    state_of,
    to_bgr,
    write_words,
)
from lumpwatch.service.evidence.recorder import Moment, Trigger

_QUALITY = 88
_LEAST_WIDTH = 480
"""Small pictures are enlarged to this, so that the text fits."""


def still(kept: Moment, roi: RoiConfig, trigger: Trigger) -> bytes:
    """JPEG of the part of the picture that the frame holds. Raises ValueError."""
    frame, result = kept.frame, kept.result(roi.id)
    left, top, width, height = frame.window
    # Drawn at the picture's own scale, or larger, whatever the filter needed.
    scale = max(1.0, _LEAST_WIDTH / width)
    size = (round(width * scale), round(height * scale))
    canvas: Image = np.asarray(cv2.resize(to_bgr(frame), size, interpolation=cv2.INTER_LINEAR), np.uint8)

    def at(x: float, y: float) -> tuple[int, int]:
        return round((x - left) * scale), round((y - top) * scale)

    colour = COLOURS[result.decision]
    corners = np.array([at(x * frame.width, y * frame.height) for x, y in roi.polygon], np.int32)
    cv2.polylines(canvas, [corners], isClosed=True, color=colour, thickness=2, lineType=cv2.LINE_AA)
    if roi.calibration is not None:
        first, last = (at(x * frame.width, y * frame.height) for x, y in roi.calibration.lip)
        draw_lip(canvas, (first, last))
    for found in result.detection.objects if result.detection else ():
        low = at(found.x, found.y)
        ink = colour if found.counts else NOT_COUNTED
        high = at(found.x + found.w, found.y + found.h)
        cv2.rectangle(canvas, low, high, ink, 2 if found.counts else 1, cv2.LINE_AA)
        label_object(canvas, label_of(found), low, high, ink)
    when = f"{datetime.fromtimestamp(frame.wall_s, UTC):%Y-%m-%d %H:%M:%S} UTC"
    text = (
        f"{trigger.alarm_class.value} {trigger.sequence}  {state_of(result)} {result.existence:.3f}  {when}"
    )
    write_words(canvas, text, (0, canvas.shape[0]), colour)
    done, coded = cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise ValueError("the still cannot be encoded")
    return coded.tobytes()
