"""Which pictures of belt-ore may teach, judge while developing, and judge at the end.

The pictures are crops of a few frames of a camera; crops of one frame lie side by side and show the same stones at
their seams, so whole frames are split, never crops.
"""

from __future__ import annotations

import re
from typing import Literal

Part = Literal["train", "dev", "test"]

_GRID = {"images": 21, "image": 12}
"""Crops of a frame, by what a file's name begins with."""
_DEV_FRAME, _TEST_FRAMES = 4, (5, 7)


def part_of(name: str) -> Part:
    """The part that a picture belongs to by its file's name, `images0042.png` or `image103.png`."""
    found = re.fullmatch(r"(images?)(\d+)\.\w+", name)
    if found is None:
        raise ValueError(f"{name}: not a name of belt-ore")
    kind, number = found[1], int(found[2])
    frame = number // _GRID[kind]
    if kind == "images":
        return "dev" if frame == _DEV_FRAME else "test" if frame in _TEST_FRAMES else "train"
    # Bare belt for the most part: every fifth frame.
    return "dev" if frame % 5 == 3 else "test" if frame % 5 == 4 else "train"
