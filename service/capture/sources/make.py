"""From a configured source to the object that reads it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Literal

from lumpwatch.service.capture.sources.base import Source
from lumpwatch.service.config import SourceConfig


def make_source(
    config: SourceConfig,
    camera_id: str,
    encoding: Literal["gray8", "i420"],
    *,
    count: Callable[[str], None],
    monotonic: Callable[[], float] = time.monotonic,
    wall: Callable[[], float] = time.time,
    sleep: Callable[[float], object] = time.sleep,
) -> Source:
    """The source that the URL means, not yet open.

    `encoding` is that of its frames. `count` is called for each event that costs or moves a
    frame but does not end the stream: `corrupt`, `stale`, `frozen_pts` (the frame is dropped),
    `pts_jump` (time stamps did not go on from the last ones), `clock` (they contradict the arrivals),
    `size_changed` (within a file or folder: it goes on in the new size), `slipped` (a paced file was read too
    slowly and goes on later). `sleep` paces files; it may return early to end a wait.
    """
    # Each kind imports what it needs only: a simulated feed loads no FFmpeg.
    if config.kind == "simulated":
        from lumpwatch.service.capture.sources.simulated import SimulatedSource

        return SimulatedSource(config, camera_id, monotonic, wall, sleep)
    if config.kind == "rtsp":
        from lumpwatch.service.capture.sources.rtsp import RtspSource

        return RtspSource(config, camera_id, encoding, count=count, monotonic=monotonic, wall=wall)

    from lumpwatch.service.capture.sources.pacing import Pacer

    pacer = Pacer(
        pace=config.pace,
        max_late_s=config.max_age_s,
        monotonic=monotonic,
        wall=wall,
        sleep=sleep,
        slipped=lambda: count("slipped"),
    )
    if config.kind == "images":
        from lumpwatch.service.capture.sources.images import ImageSource

        return ImageSource(config, camera_id, encoding, count=count, pacer=pacer)
    from lumpwatch.service.capture.sources.video import VideoSource

    return VideoSource(config, camera_id, encoding, count=count, pacer=pacer)
