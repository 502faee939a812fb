"""What is known of lumps before any training; `python -m tests.reproduction.defaults lump` makes the file it is in."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np

from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN, LumpFit
from lumpwatch.service.storage import known_lump


@cache
def default_likelihood() -> LumpFit:
    """The lump likelihood that ships with the product; its file is read at the first call."""
    with (
        (files("lumpwatch.service.detection") / "default_lump.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as archive,
    ):
        arrays = {key: archive[key].astype(np.float64) for key in archive.files}
    return replace(known_lump(arrays), looks_per_s=DEFAULT_LOOKS_PER_S, margin=DEFAULT_MARGIN)
