"""Short videos whose frames tell their number."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lumpwatch.service.core.video_writer import Codec, VideoWriter


def write_clip(
    path: Path,
    *,
    codec: Codec = "h264",
    frames: int = 50,
    fps: float = 25.0,
    gop: int | None = None,
    width: int = 96,
    height: int = 64,
) -> Path:
    """A noisy picture that moves; the top left 16x16 pixels are 4 times the frame's number, modulo 64."""
    noise = np.random.default_rng(1).integers(0, 256, (height, width), np.uint8)
    with VideoWriter(path, width, height, fps, codec=codec, gop=gop) as writer:
        for i in range(frames):
            picture = np.roll(noise, 3 * i, axis=1)
            picture[:16, :16] = 4 * (i % 64)
            writer.write(picture)
    return path
