"""Cutting a region out of a frame's planes, so that only the region is ever converted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from lumpwatch.models.roi import Image, Roi, halved
from lumpwatch.service.core.frame import Frame


def luma_of(frame: Frame) -> Image:
    """Luma of all that the frame holds."""
    if frame.encoding == "bgr8":
        return np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return frame.data[: frame.window[3]] if frame.encoding == "i420" else frame.data


def working_luma(frame: Frame, roi: Roi) -> Image:
    """Luma of the region in working size (h, w)."""
    x, y, _, h = frame.window
    if frame.encoding == "bgr8":
        return np.asarray(cv2.cvtColor(roi.cut(frame.data, (x, y)), cv2.COLOR_BGR2GRAY), dtype=np.uint8)
    return roi.cut(frame.data[:h] if frame.encoding == "i420" else frame.data, (x, y), frame.reduction)


def working_colour(frame: Frame, roi: Roi) -> Image:
    """BGR of the region in working size (h, w, 3); a frame of luma only gives grey."""
    x, y, w, h = frame.window
    if frame.encoding == "bgr8":
        return roi.cut(frame.data, (x, y))
    if frame.encoding == "gray8":
        gray = roi.cut(frame.data, (x, y), frame.reduction)
        return np.asarray(cv2.cvtColor(gray, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    # I420 holds one chroma sample for 2 x 2 pixels: cut on even borders around the region.
    left, top = (roi.x - x) & ~1, (roi.y - y) & ~1
    right, bottom = min((roi.x - x + roi.width + 1) & ~1, w), min((roi.y - y + roi.height + 1) & ~1, h)
    if left < 0 or top < 0 or right <= left or bottom <= top:
        raise ValueError("the picture does not cover the region of interest")
    chroma = frame.data[h:].reshape(2, h // 2, w // 2)[:, top // 2 : bottom // 2, left // 2 : right // 2]
    part = np.concatenate([frame.data[top:bottom, left:right].ravel(), chroma.ravel()])
    bgr = cv2.cvtColor(part.reshape(-1, right - left), cv2.COLOR_YUV2BGR_I420)
    return roi.cut(np.asarray(bgr, dtype=np.uint8), (x + left, y + top))


def whole_bgr(frame: Frame) -> Image:
    """The camera's picture as BGR (h, w, 3), for people to look at; black where the frame holds nothing."""
    return to_bgr(whole_frame(frame))


def to_bgr(frame: Frame) -> Image:
    """The pixels that a frame holds as BGR."""
    if frame.encoding == "bgr8":
        return frame.data.copy()
    if frame.encoding == "i420":
        return np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_YUV2BGR_I420), dtype=np.uint8)
    return np.asarray(cv2.cvtColor(frame.data, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def reduced_frame(frame: Frame, rois: Sequence[Roi], margin_px: float = 0.0) -> Frame:
    """The part of a luma frame that the regions look at, halved as long as none of them needs more.

    `margin_px` more on each side is kept for regions that follow a camera that moved. What the regions
    cut from it afterwards is the same to the byte. Other encodings stay whole.
    """
    if frame.encoding != "gray8" or frame.crop is not None:
        return frame
    x0, y0 = min(roi.x for roi in rois), min(roi.y for roi in rois)
    x1, y1 = max(roi.x + roi.width for roi in rois), max(roi.y + roi.height for roi in rois)
    step = min(roi.step for roi in rois)
    # A region moves by its own steps: rounding may take it one of them further.
    margin = math.ceil(margin_px / step) * step + (max(roi.step for roi in rois) if margin_px else 0)
    x0, y0 = max(x0 - margin, 0), max(y0 - margin, 0)
    x1 = min(x1 + margin, x1 + (frame.width - x1) // step * step)
    y1 = min(y1 + margin, y1 + (frame.height - y1) // step * step)
    return replace(
        frame,
        data=halved(frame.data[y0:y1, x0:x1], step),
        crop=(x0, y0, x1 - x0, y1 - y0),
        reduction=step,
    )


def whole_frame(frame: Frame) -> Frame:
    """A luma frame that holds a part, in a picture of the camera's size, black elsewhere.

    What regions within the part cut from it is the same to the byte. Whole frames come back as they are.
    """
    if frame.crop is None and frame.reduction == 1:
        return frame
    x, y, w, h = frame.window
    enlarged = frame.data.repeat(frame.reduction, axis=0).repeat(frame.reduction, axis=1)
    # A last row or column that was no full block was left out; it repeats its neighbour.
    missing = ((0, h - enlarged.shape[0]), (0, w - enlarged.shape[1]))
    data = np.zeros((frame.height, frame.width), np.uint8)
    data[y : y + h, x : x + w] = np.pad(enlarged, missing, mode="edge")
    return replace(frame, data=data, crop=None, reduction=1)
