"""A small writer of H.264, H.265 and MJPEG files with exact timestamps."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Literal, Self, cast

import av
import numpy as np
from av.video.reformatter import ColorRange
from av.video.stream import VideoStream
from numpy.typing import NDArray

Codec = Literal["h264", "h265", "mjpeg"]
_ENCODERS = {"h264": "libx264", "h265": "libx265", "mjpeg": "mjpeg"}


def frame_rate(fps: float) -> Fraction:
    """The rate as a fraction that timestamps are exact in: 29.97 -> 2997/100."""
    if not 0.01 <= fps <= 1000:
        raise ValueError(f"fps must be within 0.01 and 1000, found {fps:g}")
    return Fraction(fps).limit_denominator(10_000)


class VideoWriter:
    """Writes uint8 pictures, (h, w) gray or (h, w, 3) BGR; the suffix of `path` chooses the container.

    Frame i is presented at exactly i / fps in mp4, mov and (MJPEG only) avi; Matroska rounds to 1 ms.
    Pixels are stored in full range: the decoded luma of a gray picture is the picture, but for compression.
    `gop` is the distance of key frames (default: one second). Without B-frames, so that packets
    lie in the order of presentation. Raises ValueError for odd sizes, an unknown codec, a bad rate
    and pictures of another shape; av.error.FFmpegError where the file cannot be written.
    """

    def __init__(
        self,
        path: Path | str,
        width: int,
        height: int,
        fps: float,
        codec: Codec = "h264",
        gop: int | None = None,
        crf: int = 20,
    ) -> None:
        if codec not in _ENCODERS:
            raise ValueError(f"codec must be one of {', '.join(_ENCODERS)}, found {codec!r}")
        if width < 2 or height < 2 or width % 2 or height % 2:
            raise ValueError(f"width and height must be even and at least 2, found {width}x{height}")
        rate = frame_rate(fps)
        options = {"crf": str(crf), "preset": "veryfast"}
        if codec == "h265":
            options["x265-params"] = "log-level=error"
        elif codec == "mjpeg":
            # MJPEG has no crf: a constant quantiser, 2 (best) to 31, that looks about the same.
            quantiser = str(min(max(crf // 6, 2), 31))
            options = {"qmin": quantiser, "qmax": quantiser}
        self._shape = (height, width)
        self._written = 0
        self._closed = False
        self._container = av.open(str(path), "w")
        stream = cast(VideoStream, self._container.add_stream(_ENCODERS[codec], rate=rate, options=options))
        stream.width, stream.height = width, height
        stream.pix_fmt = "yuv420p"
        stream.time_base = stream.codec_context.time_base = 1 / rate
        stream.codec_context.color_range = ColorRange.JPEG.value
        stream.codec_context.thread_count = 2  # fixed: the bytes depend on it
        if codec != "mjpeg":
            stream.codec_context.gop_size = gop if gop is not None else max(round(rate), 1)
            stream.codec_context.max_b_frames = 0
        self._stream = stream

    def write(self, image: NDArray[np.uint8]) -> None:
        """Append one picture."""
        if image.dtype != np.uint8 or image.shape not in (self._shape, (*self._shape, 3)):
            height, width = self._shape
            raise ValueError(
                f"expected uint8, {width}x{height}, gray or BGR, found {image.dtype} of shape {image.shape}"
            )
        if image.ndim == 2:
            # The picture is the luma plane itself; swscale would squeeze it to 16-235 and back.
            chroma = np.full((image.shape[0] // 2, image.shape[1]), 128, np.uint8)
            frame = av.VideoFrame.from_ndarray(np.vstack((image, chroma)), format="yuv420p")
        else:
            frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(
                format="yuv420p", dst_color_range=ColorRange.JPEG
            )
        frame.color_range = ColorRange.JPEG.value
        frame.pts = self._written
        frame.time_base = self._stream.codec_context.time_base
        self._written += 1
        self._container.mux(self._stream.encode(frame))

    def close(self) -> None:
        """Flush and finish the file; idempotent."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._written:
                self._container.mux(self._stream.encode(None))
        finally:
            self._container.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
