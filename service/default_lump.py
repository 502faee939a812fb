"""What is known of lumps before any training; `python -m tests.reproduction.defaults lump` makes the file it is in."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import numpy as np

from models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN, LumpFit
from service.store.fit_arrays import known_lump


def _shipped() -> LumpFit:
    with (
        (files("service") / "default_lump.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as archive,
    ):
        arrays = {key: archive[key].astype(np.float64) for key in archive.files}
    return replace(known_lump(arrays), looks_per_s=DEFAULT_LOOKS_PER_S, margin=DEFAULT_MARGIN)


DEFAULT_LUMP = _shipped()
