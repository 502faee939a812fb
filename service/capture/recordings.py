"""A recording in the place of a camera: read as fast as it goes, with the times of the file alone."""

from __future__ import annotations

from collections.abc import Callable, Generator
from pathlib import Path

from lumpwatch.service.capture.sources.base import Source
from lumpwatch.service.capture.sources.make import make_source
from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core import Frame


def open_recording(
    camera: CameraConfig, video: Path, count: Callable[[str], None] = lambda _: None
) -> Source:
    """The camera's source, opened on a video file or a folder of images; `count` as in `make_source`.

    Raises SourceError.
    """
    config = camera.source.model_copy(
        update={"url": type(camera.source.url)(str(video)), "pace": False, "loop": False}
    )
    source = make_source(
        config,
        camera.id,
        "i420" if camera.needs_colour else "gray8",
        count=count,
        monotonic=lambda: 0.0,  # times are those of the file alone
        wall=lambda: 0.0,
    )
    source.open()
    return source


def read_frames(
    camera: CameraConfig, video: Path, count: Callable[[str], None] = lambda _: None
) -> tuple[Generator[Frame, None, None], int | None]:
    """All frames of a recording with times from its start, and their number where it is known.

    `count` is called for each that is not among them (`corrupt`). Raises SourceError.
    """
    source = open_recording(camera, video, count)
    return _frames(source), source.length


def _frames(source: Source) -> Generator[Frame, None, None]:
    """The frames; the source is closed after the last one, or when nobody wants more."""
    try:
        while (frame := source.read()) is not None:
            yield frame
    finally:
        source.close()
