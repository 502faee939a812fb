from __future__ import annotations

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.service.capture.sources.pixels import extract


def yuv(width: int, height: int, name: str = "yuv420p") -> tuple[av.VideoFrame, NDArray[np.uint8]]:
    packed = np.random.default_rng(1).integers(0, 256, (height * 3 // 2, width), np.uint8)
    frame = av.VideoFrame.from_ndarray(packed, format="yuv420p")
    return (frame if name == "yuv420p" else frame.reformat(format=name)), packed


@pytest.mark.parametrize("name", ["yuv420p", "nv12", "yuv422p"])
@pytest.mark.parametrize("width", [64, 70])  # 70: rows of the plane are longer than the picture
def test_gray_is_the_luma_plane_as_it_is(name: str, width: int) -> None:
    frame, packed = yuv(width, 48, name)
    gray = extract(frame, "gray8")
    assert np.array_equal(gray, packed[:48])
    assert not gray.flags.writeable


def test_gray_is_not_copied() -> None:
    frame, _ = yuv(64, 48)
    address = extract(frame, "gray8").__array_interface__["data"][0]
    assert address == frame.planes[0].buffer_ptr


def test_gray_outlives_the_frame() -> None:
    frame, packed = yuv(64, 48)
    gray = extract(frame, "gray8")
    del frame
    yuv(64, 48)
    assert np.array_equal(gray, packed[:48])


@pytest.mark.parametrize("name", ["yuv420p", "nv12"])
@pytest.mark.parametrize("width", [64, 70])
def test_i420_packs_the_planes(name: str, width: int) -> None:
    frame, packed = yuv(width, 48, name)
    assert np.array_equal(extract(frame, "i420"), packed)


def test_i420_of_odd_sides_leaves_the_last_row_and_column_out() -> None:
    gray = np.arange(35, dtype=np.uint8).reshape(5, 7)
    data = extract(av.VideoFrame.from_ndarray(gray, format="gray"), "i420")
    assert data.shape == (6, 6)
    assert np.array_equal(data[:4], gray[:4, :6])
    assert (data[4:] == 128).all()


def test_rgb_becomes_full_range_luma() -> None:
    rgb = np.zeros((16, 16, 3), np.uint8)
    rgb[:8] = 255
    rgb[8:, 8:] = (255, 0, 0)
    for encoding in ("gray8", "i420"):
        luma = extract(av.VideoFrame.from_ndarray(rgb, format="rgb24"), encoding)[:16].astype(int)
        assert abs(luma[:8] - 255).max() <= 1
        assert abs(luma[8:, :8]).max() <= 1
        assert abs(luma[8:, 8:] - 76).max() <= 1  # 0.299 * 255


def test_ten_bits_become_eight_of_the_same_range() -> None:
    frame, packed = yuv(64, 48, "yuv420p10le")
    assert abs(extract(frame, "gray8").astype(int) - packed[:48]).max() <= 1
