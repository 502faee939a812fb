"""The annotated still: the frame that raised the alarm with polygon, boxes, existence and size."""

from __future__ import annotations

import cv2
import numpy as np

from lumpwatch.models.roi import Image
from lumpwatch.service.config import RoiConfig
from lumpwatch.service.core import COLOURS, NOT_COUNTED, label_of, to_bgr
from lumpwatch.service.evidence.recorder import Moment, Trigger

_FONT = cv2.FONT_HERSHEY_SIMPLEX
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
    for found in result.detection.objects if result.detection else ():
        low = at(found.x, found.y)
        ink = colour if found.counts else NOT_COUNTED
        high = at(found.x + found.w, found.y + found.h)
        cv2.rectangle(canvas, low, high, ink, 2 if found.counts else 1, cv2.LINE_AA)
        words = f"{label_of(found)} P {found.existence:.2f}"
        cv2.putText(canvas, words, (low[0], max(low[1] - 7, 12)), _FONT, 0.45, ink, 1, cv2.LINE_AA)
    text = f"{trigger.alarm_class.value} {trigger.sequence}  {result.decision.value} {result.existence:.3f}"
    strip = canvas[-22:]
    strip[:] = strip // 4
    cv2.putText(canvas, text, (6, canvas.shape[0] - 7), _FONT, 0.45, colour, 1, cv2.LINE_AA)
    done, coded = cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise ValueError("the still cannot be encoded")
    return coded.tobytes()
