"""Numbers the frames of one source and watches over their size."""

from __future__ import annotations

import logging

import numpy as np
from av import VideoFrame
from numpy.typing import NDArray

from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.pacing import Times
from lumpwatch.service.capture.sources.pixels import SourceEncoding, extract
from lumpwatch.service.capture.sources.shown import full_range, is_limited, squared, squared_i420
from lumpwatch.service.capture.sources.turning import (
    UPRIGHT,
    Matrix,
    matrix_of,
    one_field,
    turned,
    turned_i420,
)
from lumpwatch.service.config import Levels
from lumpwatch.service.core import Frame

log = logging.getLogger(__name__)


class Assembler:
    """Makes `Frame`s; lives as long as its source object, over all reconnects."""

    def __init__(self, encoding: SourceEncoding, levels: Levels = "full") -> None:
        self._encoding: SourceEncoding = encoding
        self._levels: Levels = levels
        self._seq = 0
        self._size: tuple[int, int] | None = None
        self._matrix: Matrix = UPRIGHT
        self.aspect = 1.0
        """Width of the source's pixels over their height."""
        self._told: set[str] = set()

    def check_size(self, picture: VideoFrame, name: str) -> None:
        """Look at a picture before `make`; raises SourceError(SIZE_CHANGED), once, and what `is_new_size` raises."""
        before = self._size
        if self.is_new_size(picture, name) and before is not None:
            raise SourceError(
                Fault.SIZE_CHANGED,
                f"{name}: the picture is {picture.width}x{picture.height} now, it was {before[0]}x{before[1]}",
            )

    def is_new_size(self, picture: VideoFrame, name: str, matrix: Matrix | None = None) -> bool:
        """Look at a picture before `make`: whether it has another size than the one before, said once.

        `matrix` says how to turn it, None: it does so itself. Raises SourceError(CODEC) where it cannot be turned.
        """
        try:
            self._matrix = matrix_of(picture) if matrix is None else matrix
        except ValueError as error:
            raise SourceError(Fault.CODEC, f"{name}: {error}") from error
        if self._matrix != UPRIGHT:
            self._tell(name, "its pictures are turned or mirrored, as they ask for")
        if self.aspect != 1.0:
            self._tell(name, f"its pixels are {self.aspect:.3g} times as wide as high; they are made square")
        if picture.interlaced_frame:
            self._tell(name, "its pictures are interlaced: one field is used, at half the height's detail")
        size = (picture.width, picture.height)
        before, self._size = self._size or size, size
        return size != before

    def make(self, picture: VideoFrame, times: Times) -> Frame:
        """The next frame."""
        data = extract(picture, self._encoding)
        if is_limited(picture, self._levels):
            data = self._in_full_range(data)
        if picture.interlaced_frame:
            data = self._deinterlaced(data)
        if self.aspect != 1.0:
            data = (squared if self._encoding == "gray8" else squared_i420)(data, self.aspect)
        if self._matrix != UPRIGHT:
            data = (turned if self._encoding == "gray8" else turned_i420)(data, self._matrix)
        height, width = data.shape
        if self._encoding == "i420":
            height = height * 2 // 3
        frame = Frame(self._seq, *times, width=width, height=height, encoding=self._encoding, data=data)
        self._seq += 1
        return frame

    def _in_full_range(self, data: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self._encoding == "gray8":
            return full_range(data)
        height = data.shape[0] * 2 // 3
        return np.concatenate([full_range(data[:height]), data[height:]])

    def _deinterlaced(self, data: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self._encoding == "gray8":
            return one_field(data)
        height = data.shape[0] * 2 // 3
        return np.concatenate([one_field(data[:height]), data[height:]])

    def _tell(self, name: str, what: str) -> None:
        if what not in self._told:
            self._told.add(what)
            log.warning("%s: %s", name, what)
