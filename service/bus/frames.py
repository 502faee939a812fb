"""Frames on the bus: a publisher that drops rather than waits, and an inbox that holds the newest only."""

from __future__ import annotations

import threading
import time
import uuid
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import zenoh

from lumpwatch.service.bus import codec
from lumpwatch.service.bus.errors import BusClosed, Malformation, MalformedMessage
from lumpwatch.service.bus.handles import Handle
from lumpwatch.service.core import Frame

SHARED_MEMORY_MIB = 36
"""What the two processes of one camera take of shared memory."""
HANDOVER_S = 2.0
"""A publisher that has been silent for so long gives way to another one of the same key."""


@dataclass(frozen=True, slots=True)
class JpegPicture:
    """A picture of a JPEG key."""

    frame: int
    """Number of the frame."""
    width: int
    height: int
    jpeg: bytes
    capture_s: float
    """On the monotonic clock of the host that sent it."""


class FramePublisher(Handle):
    """Publishes the frames of one camera; made by `Bus.frame_publisher`."""

    def __init__(
        self, frames: zenoh.Publisher, pictures: zenoh.Publisher | None, clock: str, jpeg_quality: int
    ) -> None:
        super().__init__()
        self.name = uuid.uuid4().hex[:16]
        """Tells this publisher from all others of the key."""
        self._frames = frames
        self._pictures = pictures
        self._clock = clock
        self._quality = jpeg_quality

    @property
    def picture_wanted(self) -> bool:
        """Whether anyone listens to the JPEG key now."""
        if self._pictures is None:
            return False
        # The stubs say bool, but it is an object that is always true.
        return cast("zenoh.MatchingStatus", self._pictures.matching_status).matching

    def publish(
        self, frame: Frame, wire_encoding: codec.WireEncoding = "raw", picture: Frame | None = None
    ) -> None:
        """Send the frame, and where someone listens to the JPEG key `picture` (default: the frame) as JPEG.

        Never waits for a slow receiver. Raises ValueError for a frame that contradicts itself and
        BusClosed when the bus is closed.
        """
        try:
            if wire_encoding == "raw":
                payload, header = codec.encode_frame(frame, self._clock, self.name)
            else:
                payload, header = codec.encode_jpeg(frame, self._quality, self._clock, self.name)
            self._frames.put(payload, attachment=header)
            if self._pictures is not None and self.picture_wanted:
                if picture is not None or wire_encoding == "raw":
                    payload, header = codec.encode_jpeg(
                        picture or frame, self._quality, self._clock, self.name
                    )
                self._pictures.put(payload, attachment=header)
        except zenoh.ZError as error:
            raise BusClosed("bus: closed while a frame was published") from error


class FrameInbox(Handle):
    """The newest frame of a key; made by `Bus.frame_inbox`. Meant for one consumer.

    Older frames are overwritten unseen (`skipped`), malformed ones are counted by reason and dropped.
    A payload is copied and decoded only when it is taken.

    A key has one publisher. While the one that is listened to sends, frames of another are refused and counted
    (`foreign`): two cameras under one name would make one picture of two. When it has been silent for
    `HANDOVER_S`, the next one takes its place.
    """

    def __init__(self, clock: str, now: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.skipped = 0
        """Frames overwritten before they were taken."""
        self.malformed: Counter[Malformation] = Counter()
        """Messages dropped, by reason."""
        self.same_clock: bool | None = None
        """Whether the last frame's times are on the monotonic clock of this host; None before the first."""
        self.through_shared_memory: bool | None = None
        """Whether the last frame came through shared memory; None before the first."""
        self.foreign = 0
        """Frames refused because another publisher of the key is listened to."""
        self.source: str | None = None
        """The publisher that is listened to; None before the first frame, empty for one without a name."""
        self._heard_s = 0.0
        self._proved = False
        self._now = now
        self._clock = clock
        self._slot: zenoh.Sample | None = None
        self._closed = False
        self._changed = threading.Condition()

    def take(self, timeout_s: float) -> Frame | None:
        """Wait for the newest frame that was not taken yet; None after `timeout_s`; BusClosed when closed."""
        deadline = time.monotonic() + timeout_s
        while (sample := self._next(deadline)) is not None:
            try:
                frame = self._decode(sample)
            except MalformedMessage as error:
                self.malformed[error.reason] += 1
                if not self._proved:  # who has sent nothing good keeps nobody out
                    self.source = None
            else:
                self._proved = True
                return frame
        return None

    def take_jpeg(self, timeout_s: float) -> JpegPicture | None:
        """Like `take`, on a key of JPEG pictures, which stay as they came."""
        deadline = time.monotonic() + timeout_s
        while (sample := self._next(deadline)) is not None:
            try:
                header = self._header(sample)
            except MalformedMessage as error:
                self.malformed[error.reason] += 1
                continue
            if header.encoding != "jpeg" or header.thumb is not None:
                self.malformed[Malformation.BAD_HEADER] += 1
                continue
            return JpegPicture(header.seq, *header.size, sample.payload.to_bytes(), header.capture_ns / 1e9)
        return None

    def close(self) -> None:
        """Stop listening and wake the consumer; idempotent."""
        with self._changed:
            self._closed = True
            self._slot = None
            self._changed.notify_all()
        super().close()

    def receive(self, sample: zenoh.Sample) -> None:
        """Take a sample in (for the bus only): in a network thread nothing but a swap may happen."""
        attachment = sample.attachment
        known = attachment is not None and len(attachment) <= codec.MAX_HEADER_BYTES
        source = codec.source_of(attachment.to_bytes()) if attachment is not None and known else None
        with self._changed:
            if self._closed or (source is not None and not self._listens_to(source)):
                return
            self.skipped += self._slot is not None
            self._slot = sample
            self._changed.notify()

    def _listens_to(self, source: str) -> bool:
        now = self._now()
        if source != self.source:
            if self.source is not None and now - self._heard_s < HANDOVER_S:
                self.foreign += 1
                return False
            self.source, self._proved = source, False
        self._heard_s = now
        return True

    def _next(self, deadline: float) -> zenoh.Sample | None:
        with self._changed:
            while self._slot is None and not self._closed:
                left = deadline - time.monotonic()
                if left <= 0:
                    return None
                self._changed.wait(left)
            if self._closed:
                raise BusClosed("bus: closed while waiting for a frame")
            sample, self._slot = self._slot, None
            return sample

    def _header(self, sample: zenoh.Sample) -> codec.FrameHeader:
        attachment = sample.attachment
        if attachment is None:
            raise MalformedMessage(Malformation.NO_HEADER)
        if len(attachment) > codec.MAX_HEADER_BYTES:
            raise MalformedMessage(Malformation.HEADER_TOO_LONG)
        header = codec.decode_header(attachment.to_bytes())
        header.check_length(len(sample.payload))
        return header

    def _decode(self, sample: zenoh.Sample) -> Frame:
        header = self._header(sample)
        frame = codec.decode_pixels(sample.payload.to_bytes(), header)
        self.same_clock = header.clock == self._clock
        self.through_shared_memory = sample.payload.as_shm() is not None
        return frame
