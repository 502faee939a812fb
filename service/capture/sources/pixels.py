"""From a decoded picture to the planes that the rest of the program works on.

Luma is passed as it was coded; `assemble` puts what says that it is of limited range (16-235) into full range. Only
pictures without an 8-bit luma plane are converted: RGB, palettes and deep gray to
full-range luma (BT.601), YUV of more bits to 8 bits of the same range.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from av import VideoFrame
from av.video.plane import VideoPlane
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

SourceEncoding = Literal["gray8", "i420"]

_I420 = frozenset({"yuv420p", "yuvj420p"})
_LUMA_FIRST = _I420 | {
    "gray", "yuv422p", "yuvj422p", "yuv444p", "yuvj444p", "yuv440p", "yuvj440p", "yuv411p", "yuvj411p",
    "yuv410p", "yuva420p", "nv12", "nv21", "nv16", "nv24",
}  # fmt: skip


def extract(frame: VideoFrame, encoding: SourceEncoding) -> NDArray[np.uint8]:
    """The picture as uint8: (h, w) for gray8, (h * 3 / 2, w) for i420; not writable.

    gray8 is a view of the decoder's own plane where there is one. i420 needs even sides: an odd
    last row or column is left out.
    """
    if encoding == "gray8":
        if frame.format.name not in _LUMA_FIRST:
            frame = _to_i420(frame)
        return _plane(frame.planes[0])
    if frame.format.name not in _I420:
        frame = _to_i420(frame)
    width, height = frame.width & ~1, frame.height & ~1
    packed = np.empty((height * 3 // 2, width), np.uint8)
    packed[:height] = _plane(frame.planes[0])[:height, :width]
    chroma = packed[height:].reshape(2, height // 2, width // 2)
    for target, plane in zip(chroma, frame.planes[1:], strict=True):
        target[:] = _plane(plane)[: height // 2, : width // 2]
    packed.flags.writeable = False
    return packed


def _to_i420(frame: VideoFrame) -> VideoFrame:
    layout = frame.format
    if layout.is_rgb or layout.has_palette or len(layout.components) < 3:
        return frame.reformat(format="yuv420p", dst_color_range=ColorRange.JPEG)
    return frame.reformat(format="yuv420p")


def _plane(plane: VideoPlane) -> NDArray[np.uint8]:
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
    picture = rows[: plane.height, : plane.width]
    # The decoder may still predict later pictures from this one.
    picture.flags.writeable = False
    return picture
