"""A clip of the live camera: the pictures of the bus, written as they come.

The camera sends them as JPEG while somebody listens, whole and in its own rate. They go into a Matroska file (MJPEG)
without being decoded, each with the time at which it was taken, so a recording costs next to nothing.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
from av import FFmpegError

from lumpwatch.service.bus import Bus, BusClosed
from lumpwatch.service.console.work.errors import RecordingError

_QUIET_S = 10.0
_TICKS = 1000


def record(
    bus: Bus,
    key: str,
    path: Path,
    seconds: float,
    most_bytes: int,
    stop: threading.Event,
    told: Callable[[float, int, int], None],
) -> None:
    """Write the pictures of a key to `path` for so long, or until `stop` is set or so much is written.

    `told` is called with seconds, pictures and missed ones so far. Raises RecordingError where no picture comes, they
    end, or the disk is full: what was written before stays only where there is something to label.
    """
    first_s, last, written, missed, before, taken = None, -1, 0, 0, -1, 0
    size: tuple[int, int] | None = None
    heard_s = time.monotonic()
    try:
        with (
            contextlib.closing(bus.frame_inbox(key)) as inbox,
            av.open(str(path), "w", format="matroska") as container,
        ):
            stream = container.add_stream("mjpeg", rate=25)
            stream.pix_fmt = "yuvj420p"
            stream.time_base = Fraction(1, _TICKS)
            while not stop.is_set() and taken < most_bytes:
                picture = inbox.take_jpeg(0.5)
                if picture is None:
                    if time.monotonic() - heard_s > _QUIET_S:
                        break
                    continue
                heard_s = time.monotonic()
                if size is None:
                    size = stream.width, stream.height = picture.width, picture.height
                if first_s is None:
                    first_s = picture.capture_s
                at_s = picture.capture_s - first_s
                if at_s >= seconds or (picture.width, picture.height) != size or at_s < 0:
                    break
                last = max(last + 1, round(_TICKS * at_s))
                packet = av.Packet(picture.jpeg)
                packet.pts = packet.dts = last
                packet.time_base = Fraction(1, _TICKS)
                packet.stream = stream
                packet.is_keyframe = True
                container.mux(packet)
                written, taken = written + 1, taken + len(picture.jpeg)
                missed += max(0, picture.frame - before - 1) if before >= 0 else 0
                before = picture.frame
                told(at_s, written, missed)
    except BusClosed:
        pass
    except (FFmpegError, OSError) as error:
        raise RecordingError(f"the recording cannot be written ({error.strerror})") from error
    if written < 2:
        raise RecordingError("no pictures come from this camera")
