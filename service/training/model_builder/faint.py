"""Bodies that a picture does not show: too little light, too much dust or noise. They are nothing to learn from.

To call what nobody can see a body teaches the net to see bodies in every blotch.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy import ndimage

from lumpwatch.service.training.model_builder.stock import SOFT, Bytes, Ids

_LEAST_PX = 60
"""Smaller bodies are ore, or not known, anyway."""
_RIM, _BESIDE = 3, 8
"""How wide the rim of a body is, and how far around it counts for what lies beside, px."""
_EDGE, _TONE, _TEXTURE = 1.2, 0.5, 0.35
"""What shows a body: gradient along its outline against that on both sides of it; difference of brightness in standard
deviations of what lies beside; log ratio of the two standard deviations."""


def without_faint(grey: Bytes, ids: Ids) -> Ids:
    """`ids` (h, w) with SOFT in place of bodies that `grey` (h, w) does not show."""
    out = ids.copy()
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 0.8)
    slope = np.hypot(cv2.Sobel(smooth, -1, 1, 0), cv2.Sobel(smooth, -1, 0, 1))
    for number, window in enumerate(ndimage.find_objects(np.maximum(ids, 0)), start=1):
        if window is None:
            continue
        part = tuple(
            slice(max(side.start - _BESIDE, 0), min(side.stop + _BESIDE, most))
            for side, most in zip(window, ids.shape, strict=True)
        )
        body = (ids[part] == number).astype(np.uint8)
        if int(body.sum()) < _LEAST_PX:
            continue
        wide, narrow = (
            cv2.dilate(body, np.ones((2 * _BESIDE - 3,) * 2, np.uint8)),
            cv2.erode(body, np.ones((_RIM,) * 2, np.uint8)),
        )
        outer = cv2.dilate(body, np.ones((_RIM,) * 2, np.uint8))
        rim, inside, beside = (outer > narrow), narrow > 0, wide > outer
        if inside.sum() < 12 or beside.sum() < 12:
            continue
        level, steep = smooth[part], slope[part]
        apart = float(level[beside].std()) + 1.0
        edge = float(steep[rim].mean()) / (float(steep[inside | beside].mean()) + 1.0)
        tone = abs(float(level[inside].mean() - level[beside].mean())) / apart
        texture = abs(float(np.log((level[inside].std() + 1.0) / apart)))
        if edge < _EDGE and tone < _TONE and texture < _TEXTURE:
            out[part][body > 0] = SOFT
    return out
