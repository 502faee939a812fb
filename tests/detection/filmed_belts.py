"""The belts of belt-cctv, as tests look at them; skips where they are not there."""

from __future__ import annotations

import av
import numpy as np
import pytest

from lumpwatch.models.roi import Image
from tests.footage import footage_folder
from tests.reproduction.real.cctv import BELTS

Polygon = list[tuple[float, float]]


def filmed(belt: str) -> tuple[list[Image], Polygon]:
    """The grey pictures of a belt, and its load in shares of their width and height."""
    folder = footage_folder("belt-cctv", BELTS[belt].file)
    if folder is None:
        pytest.skip("needs the belts of belt-cctv (../shared/data/belt-cctv)")
    with av.open(str(folder / BELTS[belt].file)) as container:
        pictures = [
            np.asarray(frame.to_ndarray(format="gray"), np.uint8) for frame in container.decode(video=0)
        ]
    height, width = pictures[0].shape
    return pictures, [(x / width, y / height) for x, y in BELTS[belt].quad]
