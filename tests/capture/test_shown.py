"""The same film in full and in limited range, and with pixels that are no squares, shows the same."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import ColorRange

from lumpwatch.service.capture.sources.shown import full_range, squared, squared_i420, usable_aspect
from lumpwatch.service.core.frame import Frame
from tests.capture.test_sources_files import Player


def test_every_grey_level_by_the_formula() -> None:
    levels = np.arange(256)
    expected = np.clip(np.round((levels - 16) * 255 / 219), 0, 255)
    # In rows of an odd length and with a gap between them, as a decoder's are.
    plane = np.zeros((257, 300), np.uint8)[:, :257]
    plane[:, :256] = levels
    assert (full_range(plane)[:, :256] == expected).all()


def film(path: Path, *, limited: bool, told: str = "colorprim=bt709", aspect: Fraction = Fraction(1)) -> Path:
    """A disc on a ramp from black to white, lossless; `aspect` squeezes the width; without `told` x264 does
    not say that the range is limited."""
    height, width = 96, round(128 / aspect / 2) * 2
    picture = np.tile(np.linspace(0, 255, 128), (height, 1)).astype(np.uint8)
    cv2.circle(picture, (64, 48), 30, 128, -1)
    picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
    luma = np.round(16 + picture * (219 / 255)).astype(np.uint8) if limited else picture
    with av.open(str(path), "w") as container:
        stream = container.add_stream(
            "libx264", rate=10, options={"crf": "0", "preset": "ultrafast", "x264-params": told}
        )
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.sample_aspect_ratio = aspect
        stream.sample_aspect_ratio = aspect
        stream.codec_context.color_range = (ColorRange.MPEG if limited else ColorRange.JPEG).value
        planes = np.vstack([luma, np.full((height // 2, width), 128, np.uint8)])
        for k in range(3):
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.color_range = (ColorRange.MPEG if limited else ColorRange.JPEG).value
            frame.pts = k
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def first(path: Path, encoding: Literal["gray8", "i420"] = "gray8", **config: str) -> Frame:
    player = Player(path, encoding, **config)
    frame = next(player.frames())
    player.source.close()
    return frame


@pytest.mark.parametrize("encoding", ["gray8", "i420"])
def test_limited_range_shows_what_full_range_shows(
    tmp_path: Path, encoding: Literal["gray8", "i420"]
) -> None:
    full = first(film(tmp_path / "full.mp4", limited=False), encoding)
    limited = first(film(tmp_path / "limited.mp4", limited=True), encoding)
    apart = np.abs(full.data[:96].astype(int) - limited.data[:96])
    assert apart.max() <= 2
    assert (limited.data[:96].min(), limited.data[:96].max()) == (0, 255)
    assert (full.data[96:] == limited.data[96:]).all()  # colour is left alone
    silent = film(tmp_path / "silent.mp4", limited=True, told="")
    assert (first(silent, encoding, levels="limited").data == limited.data).all()
    assert first(silent, encoding).data[:96].max() == 235  # as it came


@pytest.mark.parametrize("encoding", ["gray8", "i420"])
def test_pixels_become_squares(tmp_path: Path, encoding: Literal["gray8", "i420"]) -> None:
    square = first(film(tmp_path / "square.mp4", limited=False), encoding)
    squeezed = first(film(tmp_path / "squeezed.mp4", limited=False, aspect=Fraction(4, 3)), encoding)
    assert (squeezed.width, squeezed.height) == (square.width, square.height) == (128, 96)
    assert np.abs(square.data[:96].astype(int) - squeezed.data[:96]).mean() < 4


def test_sizes_stay_even_and_odd_aspects_are_not_believed() -> None:
    plane = np.zeros((96, 720), np.uint8)
    assert squared(plane, 16 / 15).shape == (96, 768)
    assert squared(plane, 8 / 9).shape == (108, 720)
    assert squared_i420(np.zeros((144, 720), np.uint8), 16 / 15).shape == (144, 768)
    for aspect in (None, Fraction(0), Fraction(1, 100), Fraction(1000), Fraction(1001, 1000)):
        assert usable_aspect(aspect) == 1.0
