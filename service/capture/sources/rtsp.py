"""An RTSP stream as a source of frames.

Frames that cannot be used are dropped and counted under their fault: `corrupt` (does not decode),
`stale` (arrived more than `max_age_s` after its capture) and `frozen_pts` (its time stamp did not
advance). The stream goes on; when nothing usable has come for `read_timeout_s`, `read` raises with
the last such fault, or with `read_timeout` where nothing came at all. What cannot be decoded before the first key
frame is no damage (`no_key_frame`): while data comes, the next key frame is waited for, `key_frame_timeout_s` at
most, for a camera may send one in 20 s only.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator

import av.error
from av import FFmpegError, VideoFrame
from av.container import InputContainer
from av.packet import Packet
from av.video.stream import VideoStream

from lumpwatch.service.capture.sources.assemble import Assembler
from lumpwatch.service.capture.sources.base import Fault, SourceError
from lumpwatch.service.capture.sources.decoding import PacketDecoder
from lumpwatch.service.capture.sources.faults import fault_of, frame_rate, source_error, video_stream
from lumpwatch.service.capture.sources.pacing import Times
from lumpwatch.service.capture.sources.pixels import SourceEncoding
from lumpwatch.service.capture.sources.rtsp_open import RtspOpener
from lumpwatch.service.capture.sources.shown import usable_aspect
from lumpwatch.service.config import SourceConfig
from lumpwatch.service.core import CameraClock, Frame

_log = logging.getLogger(__name__)

# FFmpeg's parser keeps the last picture until the next begins. A read that is interrupted hands
# it out first and fails at the second time only: that is why a time-out passed as it is lasts
# twice as long. So reads are interrupted often, and the clock decides.
_POLLS = 4


class RtspSource:
    """H.264, H.265 or MJPEG over RTSP; see `Source` for the contract.

    `open` ends within `open_timeout_s` and a silent stream within `read_timeout_s`, each plus what
    FFmpeg takes to notice (some 0.2 s). `read_timeout_s` should be more than two frame intervals.
    """

    def __init__(
        self,
        config: SourceConfig,
        camera_id: str,
        encoding: SourceEncoding,
        *,
        count: Callable[[str], None],
        monotonic: Callable[[], float],
        wall: Callable[[], float],
    ) -> None:
        self._config = config
        self._name = f"camera {camera_id}: {config.redacted}"
        self._count = count
        self._monotonic = monotonic
        self._wall = wall
        self._assembler = Assembler(encoding, config.levels)
        self._opener = RtspOpener(config, self._name, monotonic)
        # Before the pictures that it costs would be taken for a dead stream, whose next one would begin the same way.
        self._clock = CameraClock(config.read_timeout_s / 2)
        self._container: InputContainer | None = None
        self._stream: VideoStream | None = None
        self._decoder: PacketDecoder | None = None
        self._packets: Iterator[Packet[VideoStream]] = iter(())
        self._pictures: deque[VideoFrame] = deque()
        self._pts: int | None = None
        self._arrived_s = 0.0
        self._good_s = 0.0
        self._left_s = 0.0
        self._heard_s = 0.0
        self._keys = 0
        """Key frames since the last usable picture."""
        self._seen_key = False
        """Whether one has come on this connection."""
        self._trouble = Fault.READ_TIMEOUT

    @property
    def nominal_fps(self) -> float | None:
        """As the server states it."""
        return frame_rate(self._stream) if self._stream else None

    @property
    def length(self) -> None:
        """A stream has no end."""
        return

    def open(self) -> None:
        """Connect and probe; raises SourceError."""
        self.close()
        self._container = self._opener.open(self._config.read_timeout_s / _POLLS)
        self._stream = video_stream(self._container, self._name)
        self._decoder = PacketDecoder(self._stream)
        self._assembler.aspect = usable_aspect(self._stream.sample_aspect_ratio)
        self._packets = self._container.demux(self._stream)
        self._clock.restart()
        self._pts = None
        self._good_s = self._left_s = self._heard_s = self._monotonic()
        self._keys, self._seen_key = 0, False
        self._trouble = Fault.READ_TIMEOUT

    def close(self) -> None:
        """Disconnect; idempotent."""
        self._packets = iter(())
        self._pictures.clear()
        self._stream = None
        if self._container:
            self._container.close()
            self._container = None
        self._opener.close()

    def read(self) -> Frame:
        """The next usable frame; raises SourceError."""
        if not self._container:
            raise RuntimeError("read of a source that is not open")
        # The time that the caller spent elsewhere is not the stream's fault.
        elsewhere_s = self._monotonic() - self._left_s
        self._good_s, self._heard_s = self._good_s + elsewhere_s, self._heard_s + elsewhere_s
        while True:
            while self._pictures:
                if frame := self._usable(self._pictures.popleft()):
                    self._left_s = self._monotonic()
                    return frame
            if (silent := self._monotonic() - self._good_s) >= self._limit_s():
                raise SourceError(
                    self._trouble, f"{self._name}: no usable picture for {silent:.1f} s ({self._trouble})"
                )
            self._receive()

    def _limit_s(self) -> float:
        """How long no usable picture may come: longer while data comes and a key frame is due."""
        config = self._config
        comes = self._monotonic() - self._heard_s < config.read_timeout_s
        due = self._trouble in (Fault.NO_KEY_FRAME, Fault.CORRUPT) and not self._keys and comes
        return max(config.key_frame_timeout_s, config.read_timeout_s) if due else config.read_timeout_s

    def _receive(self) -> None:
        """Wait for one packet, or for a part of the read time-out, and decode it."""
        assert self._container
        assert self._stream
        began = self._monotonic()
        failure: SourceError | None = None
        try:
            packet = next(self._packets)
        except StopIteration:
            failure = SourceError(Fault.ENDED, f"{self._name}: the server ended the stream")
        except (av.error.ExitError, av.error.TimeoutError):
            self._packets = self._container.demux(self._stream)
            return
        except FFmpegError as error:
            failure = source_error(self._name, fault_of(error, Fault.UNREACHABLE), error)
        if failure:
            raise failure
        now = self._monotonic()
        # A packet that an interrupted read handed out had come before; when it began, at the earliest.
        interrupted = now - began >= self._config.read_timeout_s / _POLLS
        self._arrived_s = began if interrupted else now
        if packet.size:
            self._heard_s = now
            self._keys += packet.is_keyframe
            self._seen_key |= packet.is_keyframe
        assert self._decoder
        pictures = self._decoder.decode(packet)
        wrong = Fault.CORRUPT if self._seen_key else Fault.NO_KEY_FRAME
        if pictures is None:
            self._drop(wrong)
            return
        self._pictures.extend(pictures)
        if not self._pictures:
            # Not yet wrong, but if it goes on, data came and no picture.
            self._trouble = wrong

    def _usable(self, picture: VideoFrame) -> Frame | None:
        received = self._monotonic()
        if picture.is_corrupt:
            self._drop(Fault.CORRUPT if self._seen_key else Fault.NO_KEY_FRAME)
            return None
        if picture.pts is not None and picture.pts == self._pts and not self._clock.by_arrival:
            self._clock.repeated(received)
            self._tell()
            self._drop(Fault.FROZEN_PTS)
            return None
        self._pts = picture.pts
        capture, jumped = self._clock.stamp(picture.time, received)
        self._tell()
        if jumped:
            self._count("pts_jump")
        if received - capture > self._config.max_age_s:
            self._drop(Fault.STALE)
            return None
        self._assembler.check_size(picture, self._name)
        self._good_s, self._trouble, self._keys = self._arrived_s, Fault.READ_TIMEOUT, 0
        return self._assembler.make(picture, Times(capture, received, self._wall()))

    def _tell(self) -> None:
        """What has just been found to be wrong with the camera's clock."""
        if self._clock.news is not None:
            self._count("clock")
            _log.warning("%s: %s", self._name, self._clock.news)
            self._clock.news = None

    def _drop(self, fault: Fault) -> None:
        self._trouble = fault
        self._count(fault)
