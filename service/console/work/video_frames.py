"""Single frames of a video by their number, as training will count them: in the order in which they are shown."""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self

import av
import cv2
from av import FFmpegError, VideoFrame
from av.container import InputContainer

from lumpwatch.service.console.work.errors import VideoError

_QUALITY = 90
_MOST_FRAMES = 200_000
_MOST_PIXELS = 8192 * 8192
_AHEAD = 60
"""Frames that are decoded and left out rather than sought past."""


@dataclass(frozen=True, slots=True)
class VideoFacts:
    """What labelling needs to know of a video."""

    frames: int
    width: int
    height: int
    fps: float


class VideoFrames:
    """An open video; not for several threads at once."""

    def __init__(self, path: Path, name: str) -> None:
        """Raises VideoError, naming the video by `name`, for what is no video or has no times."""
        self._name = name
        try:
            self._container: InputContainer = av.open(f"file:{path}", metadata_errors="replace")
        except (FFmpegError, OSError, ValueError) as error:
            raise VideoError(f"{name}: is not a video that can be read") from error
        try:
            self._times = self._index()
        except BaseException:
            self._container.close()
            raise
        self._decoded: Iterator[VideoFrame] = iter(())
        self._next = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._decoded = iter(())
        self._container.close()

    @property
    def facts(self) -> VideoFacts:
        """Number of frames, size and mean rate."""
        stream = self._container.streams.video[0]
        length_s = (self._times[-1] - self._times[0]) * Fraction(stream.time_base or 1)
        rate = (len(self._times) - 1) / float(length_s) if length_s else float(stream.average_rate or 25)
        return VideoFacts(len(self._times), stream.codec_context.width, stream.codec_context.height, rate)

    def jpeg(self, number: int) -> bytes:
        """Frame `number`, from 1. Raises KeyError where there is none and VideoError where it is damaged."""
        if not 1 <= number <= len(self._times):
            raise KeyError(f"{self._name}, frame {number}")
        try:
            frame = self._frame(number - 1)
            gray = frame.format.name.startswith("gray")
            pixels = frame.to_ndarray(format="gray" if gray else "bgr24")
        except (FFmpegError, ValueError) as error:
            raise VideoError(f"{self._name}, frame {number}: does not decode") from error
        ok, buffer = cv2.imencode(".jpg", pixels, (cv2.IMWRITE_JPEG_QUALITY, _QUALITY))
        if not ok:
            raise VideoError(f"{self._name}, frame {number}: cannot be shown")
        return buffer.tobytes()

    def _index(self) -> list[int]:
        if not self._container.streams.video:
            raise VideoError(f"{self._name}: holds no video")
        stream = self._container.streams.video[0]
        stream.thread_type = "NONE"
        if stream.codec_context.width * stream.codec_context.height > _MOST_PIXELS:
            raise VideoError(f"{self._name}: its picture is too large")
        times: list[int] = []
        try:
            for packet in self._container.demux(stream):
                if packet.size == 0 or packet.is_discard:
                    continue
                if packet.pts is None:
                    raise VideoError(f"{self._name}: its frames have no times; convert it to MP4 or Matroska")
                if packet.is_corrupt:
                    raise VideoError(f"{self._name}: is cut off or damaged")
                times.append(packet.pts)
                if len(times) > _MOST_FRAMES:
                    raise VideoError(f"{self._name}: has more than {_MOST_FRAMES} frames; cut it")
        except FFmpegError as error:
            raise VideoError(f"{self._name}: is cut off or damaged") from error
        times.sort()
        if not times or len(set(times)) != len(times):
            raise VideoError(f"{self._name}: holds no frames, or several at one time")
        return times

    def _frame(self, index: int) -> VideoFrame:
        if not self._next <= index < self._next + _AHEAD or self._next < 0:
            self._seek(index)
        for _ in range(2):
            for frame in self._decoded:
                if frame.pts is None:
                    continue
                self._next = bisect.bisect_left(self._times, frame.pts) + 1
                if frame.pts == self._times[index]:
                    return frame
                if frame.pts > self._times[index]:
                    break
            self._seek(0)  # sought too far, or damaged on the way: once more from the beginning
        raise ValueError("the frame does not come")

    def _seek(self, index: int) -> None:
        stream = self._container.streams.video[0]
        self._container.seek(self._times[index] if index else self._times[0], stream=stream, backward=True)
        self._decoded = self._container.decode(stream)
        self._next = 0 if index == 0 else -1


def facts_of(path: Path, name: str) -> VideoFacts:
    """What a video is. Raises VideoError."""
    with VideoFrames(path, name) as video:
        video.jpeg(1)  # what the header promises may be something that does not decode
        return video.facts
