"""Numbers the frames of one source and watches over their size."""

from __future__ import annotations

from av import VideoFrame

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.pacing import Times
from lumpwatch.service.capture.sources.pixels import SourceEncoding, extract
from lumpwatch.service.core import Frame


class Assembler:
    """Makes `Frame`s; lives as long as its source object, over all reconnects."""

    def __init__(self, encoding: SourceEncoding) -> None:
        self._encoding: SourceEncoding = encoding
        self._seq = 0
        self._size: tuple[int, int] | None = None

    def check_size(self, picture: VideoFrame, name: str) -> None:
        """Raise SourceError(SIZE_CHANGED), once: from then on the new size is the right one."""
        size = (picture.width, picture.height)
        before, self._size = self._size or size, size
        if size != before:
            raise SourceError(
                Fault.SIZE_CHANGED,
                f"{name}: the picture is {size[0]}x{size[1]} now, it was {before[0]}x{before[1]}",
            )

    def make(self, picture: VideoFrame, times: Times) -> Frame:
        """The next frame."""
        data = extract(picture, self._encoding)
        height, width = data.shape
        if self._encoding == "i420":
            height = height * 2 // 3
        frame = Frame(self._seq, *times, width=width, height=height, encoding=self._encoding, data=data)
        self._seq += 1
        return frame
