"""A frame: pixels with the times and the identity that travel with them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Encoding = Literal["gray8", "i420", "bgr8"]


@dataclass(frozen=True, slots=True)
class Frame:
    """One picture of a camera.

    `data` is uint8: (h, w) for gray8, (h * 3 / 2, w) for i420, (h, w, 3) for bgr8, where h and w are
    those of `crop` divided by `reduction`. Times are seconds; `capture_s` and `received_s` are on the monotonic clock.
    """

    seq: int
    """Counts frames since the source was made, without gaps; it goes on over reconnects."""
    capture_s: float
    """When the picture was taken: presentation time anchored to the monotonic clock."""
    received_s: float
    """When the decoded picture reached us, monotonic clock."""
    wall_s: float
    """`received_s` on the wall clock, for people only."""
    width: int
    """Width of the whole picture."""
    height: int
    """Height of the whole picture."""
    encoding: Encoding
    data: NDArray[np.uint8]
    crop: tuple[int, int, int, int] | None = None
    """x, y, w, h of the part of the picture that `data` holds; None: all of it."""

    reduction: int = 1
    """A pixel of `data` is the mean of this many by this many pixels of the picture (gray8 only)."""

    thumb: NDArray[np.uint8] | None = None
    """The whole picture, gray and small (h, w), for frames that hold only a part; of this frame or one
    shortly before it."""

    @property
    def window(self) -> tuple[int, int, int, int]:
        """x, y, w, h of the part that `data` holds."""
        return self.crop or (0, 0, self.width, self.height)
