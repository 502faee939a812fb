"""A look at a camera before anything runs on it: what it sends, a still, a clip as it comes.

Streams and files are read packet by packet, so codec, key frames and time stamps are those of the camera, and a clip
is a copy without a second compression. Other sources are read as the camera process reads them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av import FFmpegError
from av.container import InputContainer
from av.video.stream import VideoStream

from lumpwatch.models.roi import Image
from lumpwatch.service.capture.sources.base import Fault, Source, SourceError
from lumpwatch.service.capture.sources.faults import fault_of, frame_rate, source_error, video_stream
from lumpwatch.service.capture.sources.make import make_source
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame, VideoWriter, whole_bgr

_DEFAULT_FPS = 15.0
_SETTLED_S = 1.5


@dataclass(frozen=True, slots=True)
class Sent:
    """What a source sends."""

    codec: str | None
    """None where there is none: pictures, the simulated feed."""
    width: int
    height: int
    stated_fps: float | None
    fps: float | None
    """As frames came; None of fewer than three."""
    key_frame_s: float | None
    """Longest time between two key frames; None where no two were seen."""
    clock_rate: float | None
    """Seconds of the camera's clock in one of ours; None of files and of less than two seconds."""
    watched_s: float

    def __str__(self) -> str:
        """One line for a person."""
        stated = "" if self.stated_fps is None else f" ({self.stated_fps:.4g} stated)"
        rate = "rate not known" if self.fps is None else f"{self.fps:.4g} frames a second{stated}"
        if self.fps is None and self.stated_fps is not None:
            rate = f"{self.stated_fps:.4g} frames a second stated"
        words = [f"{self.width}x{self.height}", *([self.codec] if self.codec else []), rate]
        if self.codec:
            far = (
                f"every {self.key_frame_s:.3g} s"
                if self.key_frame_s
                else f"none within {self.watched_s:.3g} s"
            )
            words.append(f"key frames {far}")
        if self.clock_rate is not None:
            words.append(f"clock {100 * (self.clock_rate - 1):+.1f} % against ours")
        return ", ".join(words)

    @property
    def warnings(self) -> list[str]:
        """What will be felt in operation."""
        found = []
        if self.codec and (self.key_frame_s or self.watched_s) > 4.0:
            found.append(
                "key frames are far apart: after a lost packet the picture is damaged until the next one, and so long "
                "the region is BLIND; set the camera to one a second (a file that is played loses no packets)"
            )
        if self.fps is not None and self.fps < 5.0:
            found.append(f"{self.fps:.3g} frames a second are few: ten and more find a lump sooner")
        if self.clock_rate is not None and abs(self.clock_rate - 1.0) > 0.05:
            found.append(
                "the camera's time stamps do not keep time; it is estimated and put right (see the metrics)"
            )
        return found


def look_at(camera: CameraConfig, for_s: float = 5.0) -> tuple[Sent, Image]:
    """What the camera sends, watched for up to `for_s`, and a still (BGR). Raises SourceError."""
    if camera.source.kind in ("rtsp", "video"):
        sent = _packets_of(camera, for_s)
        return sent, snapshot(camera)
    source = _opened(camera, paced=False)
    with closing(source):
        first = _first(source, camera)
        still, fps = whole_bgr(first), source.nominal_fps
    return Sent(None, first.width, first.height, fps, None, None, None, 0.0), still


def snapshot(camera: CameraConfig) -> Image:
    """The first whole picture that comes (BGR). Raises SourceError."""
    source = _opened(camera, paced=False)
    with closing(source):
        return whole_bgr(_first(source, camera))


def record(
    camera: CameraConfig, path: Path, for_s: float, advance: Callable[[float], None] = lambda _: None
) -> float:
    """Write a clip of `for_s`, beginning with a key frame; the seconds that were written. Raises SourceError.

    Streams and files are copied as they come; the suffix of `path` chooses the container (mp4, mkv).
    """
    try:
        if camera.source.kind in ("rtsp", "video"):
            return _copied(camera, path, for_s, advance)
        return _encoded(camera, path, for_s, advance)
    except (FFmpegError, OSError) as error:
        raise SourceError(Fault.UNEXPECTED, f"{path}: cannot be written ({error})") from error


def _copied(camera: CameraConfig, path: Path, for_s: float, advance: Callable[[float], None]) -> float:
    with closing(_container(camera)) as container, av.open(str(path), "w") as out:
        stream = video_stream(container, _name(camera))
        copy = out.add_stream_from_template(stream)
        begin: int | None = None
        done_s = 0.0
        for packet in _demuxed(container, stream, camera):
            if packet.pts is None or packet.dts is None or packet.time_base is None:
                continue
            if begin is None:
                if not packet.is_keyframe:
                    continue
                begin = packet.dts
            done_s = float((packet.dts - begin) * packet.time_base)
            if done_s >= for_s:
                break
            packet.pts, packet.dts = packet.pts - begin, packet.dts - begin
            packet.stream = copy
            out.mux(packet)
            advance(done_s)
    if begin is None:
        raise SourceError(Fault.EMPTY, f"{_name(camera)}: sent no key frame")
    return min(done_s, for_s)


def _encoded(camera: CameraConfig, path: Path, for_s: float, advance: Callable[[float], None]) -> float:
    with closing(_opened(camera, paced=False)) as source:
        fps = source.nominal_fps or _DEFAULT_FPS
        frame: Frame | None = _first(source, camera)
        assert frame is not None
        height, width = frame.height & ~1, frame.width & ~1
        written = 0
        with VideoWriter(path, width, height, fps) as writer:
            while frame is not None and written < round(for_s * fps):
                writer.write(np.ascontiguousarray(whole_bgr(frame)[:height, :width]))
                written += 1
                advance(written / fps)
                frame = source.read()
    return written / fps


def _packets_of(camera: CameraConfig, for_s: float) -> Sent:
    live = camera.source.kind == "rtsp"
    with closing(_container(camera)) as container:
        stream = video_stream(container, _name(camera))
        codec, stated = stream.codec_context.name, frame_rate(stream)
        width, height = stream.codec_context.width, stream.codec_context.height
        times: list[float] = []
        keys: list[float] = []
        began_s = time.monotonic()
        arrived: list[float] = []
        for packet in _demuxed(container, stream, camera):
            if packet.pts is None or packet.time_base is None:
                continue
            at_s, now_s = float(packet.pts * packet.time_base), time.monotonic() - began_s
            times.append(at_s)
            arrived.append(now_s)
            if packet.is_keyframe:
                keys.append(at_s)
            if (now_s if live else at_s - times[0]) >= for_s:
                break
    if not times:
        raise SourceError(Fault.EMPTY, f"{_name(camera)}: sent no picture")
    times_s, span_s = np.sort(times), float(np.ptp(times))
    fps = (len(times) - 1) / span_s if len(times) > 2 and span_s > 0 else None
    rate = None
    # What had gathered while the stream was opened comes at once: it says nothing of the clock.
    steady = np.array(arrived) >= _SETTLED_S
    if live and arrived[-1] >= _SETTLED_S + 2.0:
        rate = float(np.polyfit(np.array(arrived)[steady], np.array(times)[steady], 1)[0])
    gap_s = float(np.diff(np.sort(keys)).max()) if len(keys) > 1 else None
    return Sent(codec, width, height, stated, fps, gap_s, rate, float(times_s[-1] - times_s[0]))


def _demuxed(
    container: InputContainer, stream: VideoStream, camera: CameraConfig
) -> Iterator[av.Packet[VideoStream]]:
    try:
        yield from container.demux(stream)
    except FFmpegError as error:
        raise source_error(_name(camera), fault_of(error, Fault.READ_TIMEOUT), error) from None


def _container(camera: CameraConfig) -> InputContainer:
    source = camera.source
    try:
        if source.kind == "rtsp":
            return av.open(
                source.address,
                options={"rtsp_transport": source.transport, "allowed_media_types": "video"},
                timeout=(source.open_timeout_s, source.read_timeout_s),
                metadata_errors="replace",
            )
        return av.open(f"file:{source.path}", metadata_errors="replace")
    except FFmpegError as error:
        failure = source_error(_name(camera), fault_of(error, Fault.UNREACHABLE), error)
    raise failure


def _opened(camera: CameraConfig, *, paced: bool) -> Source:
    config = camera.source.model_copy(update={"pace": paced, "loop": False})
    source = make_source(config, camera.id, "i420", count=lambda _: None)
    source.open()
    return source


def _first(source: Source, camera: CameraConfig) -> Frame:
    frame = source.read()
    if frame is None:
        raise SourceError(Fault.EMPTY, f"{_name(camera)}: holds no picture")
    return frame


def _name(camera: CameraConfig) -> str:
    return f"camera {camera.id}: {camera.source.redacted}"
