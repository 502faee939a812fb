"""H.264 there and back: the blocks and smears that a thin link leaves in the pictures."""

from __future__ import annotations

from fractions import Fraction

import av
import numpy as np
from av.video.reformatter import ColorRange
from numpy.typing import NDArray

from lumpwatch.service.core import frame_rate
from lumpwatch.service.simulator.spec import FeedSpec


class ThinLink:
    """Codes and decodes picture after picture at the constant quality `spec.h264_crf`.

    Key frames come each second, and after pictures were passed over; coder and decoder begin anew
    there, so a picture depends on nothing before its key frame.
    """

    def __init__(self, spec: FeedSpec) -> None:
        self._spec = spec
        self._rate = frame_rate(spec.fps)
        self._gop = max(round(spec.fps), 1)
        self._frame = -1

    def through(self, picture: NDArray[np.uint8], frame: int) -> NDArray[np.uint8]:
        """Picture number `frame`, (h, w) or (h, w, 3) BGR, as it arrives."""
        if frame % self._gop == 0 or frame != self._frame + 1:
            self._open()
        self._frame = frame
        coded = _to_frame(picture)
        coded.pts = frame % self._gop
        # Without B-frames and look-ahead each picture comes out at once.
        (arrived,) = (out for packet in self._encoder.encode(coded) for out in self._decoder.decode(packet))
        return _luma(arrived) if picture.ndim == 2 else _bgr(arrived)

    def _open(self) -> None:
        encoder = av.CodecContext.create("libx264", "w")
        encoder.width, encoder.height = self._spec.width, self._spec.height
        encoder.pix_fmt = "yuv420p"
        encoder.framerate, encoder.time_base = self._rate, Fraction(1) / self._rate
        encoder.color_range = ColorRange.JPEG.value
        encoder.gop_size, encoder.max_b_frames = self._gop, 0
        encoder.options = {"crf": str(self._spec.h264_crf), "preset": "veryfast", "tune": "zerolatency"}
        decoder = av.CodecContext.create("h264", "r")
        encoder.thread_count = decoder.thread_count = 1
        self._encoder, self._decoder = encoder, decoder


def _to_frame(picture: NDArray[np.uint8]) -> av.VideoFrame:
    if picture.ndim == 2:
        chroma = np.full((picture.shape[0] // 2, picture.shape[1]), 128, np.uint8)
        frame = av.VideoFrame.from_ndarray(np.vstack((picture, chroma)), format="yuv420p")
    else:
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24").reformat(
            format="yuv420p", dst_color_range=ColorRange.JPEG
        )
    frame.color_range = ColorRange.JPEG.value
    return frame


def _luma(frame: av.VideoFrame) -> NDArray[np.uint8]:
    plane = frame.planes[0]
    rows = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
    return rows[: frame.height, : frame.width].copy()


def _bgr(frame: av.VideoFrame) -> NDArray[np.uint8]:
    picture = frame.reformat(format="bgr24", src_color_range=ColorRange.JPEG).to_ndarray()
    return np.asarray(picture, np.uint8)
