"""A video file as a source of frames.

Packets that do not decode are skipped and counted (`corrupt`). At the end of the file stands None,
or SourceError(CORRUPT) where the file was cut off and its container shows it: an MP4 or MOV whose
index names bytes beyond the end, or a last packet that is only partly there. A Matroska or transport
stream that is cut off at a packet ends like a whole one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

import av
from av import FFmpegError, VideoFrame
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from lumpwatch.service.capture.sources.assemble import Assembler
from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.decoding import PacketDecoder
from lumpwatch.service.capture.sources.faults import fault_of, frame_rate, source_error, video_stream
from lumpwatch.service.capture.sources.files import check_file
from lumpwatch.service.capture.sources.pacing import Pacer
from lumpwatch.service.capture.sources.pixels import SourceEncoding
from lumpwatch.service.capture.sources.shown import usable_aspect
from lumpwatch.service.config import SourceConfig
from lumpwatch.service.core import Frame, MediaClock

_DEFAULT_FPS = 25.0


class VideoSource:
    """Plays a file at its own speed or as fast as it is read, once or in a loop; see `Source`."""

    def __init__(
        self,
        config: SourceConfig,
        camera_id: str,
        encoding: SourceEncoding,
        *,
        count: Callable[[str], None],
        pacer: Pacer,
    ) -> None:
        self._config = config
        self._name = f"camera {camera_id}: {config.path}"
        self._count = count
        self._pacer = pacer
        self._assembler = Assembler(encoding, config.levels)
        self._clock = MediaClock(1 / _DEFAULT_FPS)
        self._container: InputContainer | None = None
        self._stream: VideoStream | None = None
        self._decoder: PacketDecoder | None = None
        self._packets: Iterator[Packet[VideoStream]] = iter(())
        self._pictures: deque[VideoFrame] = deque()
        self._bytes = 0
        self._cut_off = False
        self._lap_frames = 0

    @property
    def nominal_fps(self) -> float | None:
        """As the file states it."""
        return frame_rate(self._stream) if self._stream else None

    @property
    def length(self) -> int | None:
        """Frames from `start_s` on, as the file states them; None for a loop."""
        if not self._stream or not self._stream.frames or self._config.loop:
            return None
        skipped = round(self._config.start_s * (self.nominal_fps or _DEFAULT_FPS))
        return max(self._stream.frames - skipped, 0)

    def open(self) -> None:
        """Open the file at `start_s`; raises SourceError."""
        self._start()
        self._clock = MediaClock(1 / (self.nominal_fps or _DEFAULT_FPS))
        self._pacer.restart()

    def close(self) -> None:
        """Close the file; idempotent."""
        self._packets = iter(())
        self._pictures.clear()
        self._stream = None
        if self._container:
            self._container.close()
            self._container = None

    def read(self) -> Frame | None:
        """The next frame, when it is due; None at the end; raises SourceError."""
        if not self._container:
            raise RuntimeError("read of a source that is not open")
        while (picture := self._next()) is None:
            if self._lap_frames == 0:
                raise SourceError(
                    Fault.EMPTY, f"{self._name}: holds no picture from {self._config.start_s:g} s on"
                )
            if not self._config.loop:
                return None
            self._start()
            self._clock.lap()
        self._lap_frames += 1
        if self._assembler.is_new_size(picture, self._name):
            self._count(Fault.SIZE_CHANGED)
        media_s, jumped = self._clock.stamp(picture.time)
        if jumped:
            self._count("pts_jump")
        return self._assembler.make(picture, self._pacer.wait(media_s))

    def _start(self) -> None:
        self.close()
        self._bytes = check_file(self._config.path, self._name)
        failure: SourceError | None = None
        try:
            # The prefix keeps FFmpeg from taking a colon in the path for a protocol.
            self._container = av.open(f"file:{self._config.path}", metadata_errors="replace")
        except FFmpegError as error:
            failure = source_error(self._name, fault_of(error, Fault.CORRUPT), error)
        if failure:
            raise failure
        assert self._container
        self._stream = video_stream(self._container, self._name)
        self._decoder = PacketDecoder(self._stream)
        self._assembler.aspect = usable_aspect(self._stream.sample_aspect_ratio)
        self._packets = self._container.demux(self._stream)
        self._cut_off = False
        self._lap_frames = 0
        if self._config.start_s:
            self._seek(self._container)

    def _seek(self, container: InputContainer) -> None:
        start = (container.start_time or 0) + round(self._config.start_s * av.time_base)
        try:
            container.seek(start)  # to the key frame before; `_next` skips the rest
        except FFmpegError:
            return  # no index: everything is read and skipped

    def _next(self) -> VideoFrame | None:
        """The next picture from `start_s` on; None at the end of the file."""
        while True:
            while self._pictures:
                picture = self._pictures.popleft()
                if picture.is_corrupt:
                    self._count(Fault.CORRUPT)
                elif not self._before_start(picture):
                    return picture
            packet = self._demux()
            if packet is None:
                return None
            if packet.is_corrupt:
                self._cut_off = True
                self._count(Fault.CORRUPT)
                continue
            self._cut_off &= packet.size == 0  # the packet that flushes the decoder is empty
            assert self._decoder
            pictures = self._decoder.decode(packet)
            if pictures is None:
                self._count(Fault.CORRUPT)
            else:
                self._pictures.extend(pictures)

    def _before_start(self, picture: VideoFrame) -> bool:
        assert self._container
        first = (self._container.start_time or 0) / av.time_base
        return picture.time is not None and picture.time - first < self._config.start_s - 1e-6

    def _demux(self) -> Packet[VideoStream] | None:
        damaged = False
        try:
            if packet := next(self._packets, None):
                return packet
        except FFmpegError:
            damaged = True
        if damaged or self._cut_off or self._index_reaches_beyond():
            raise SourceError(Fault.CORRUPT, f"{self._name}: the file is cut off or damaged at the end")
        return None

    def _index_reaches_beyond(self) -> bool:
        assert self._stream
        index = self._stream.index_entries
        return bool(len(index)) and index[-1].pos + index[-1].size > self._bytes
