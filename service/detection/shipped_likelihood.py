"""What is known of lumps before any training: the net, and the score of its boxes. `make model` makes the file."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from hashlib import sha256
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.learning.learned import DEFAULT_LOOKS_PER_S, DEFAULT_MARGIN, LumpFit
from lumpwatch.models.likelihood.net import SHAPES, Net
from lumpwatch.service.storage import known_lump

_NET = "net_"


@cache
def default_likelihood() -> LumpFit:
    """The score of a box that ships with the product."""
    arrays = _shipped()
    fitted = {key: arrays[key].astype(np.float64) for key in arrays if not key.startswith(_NET)}
    return replace(
        known_lump(fitted), looks_per_s=DEFAULT_LOOKS_PER_S, margin=DEFAULT_MARGIN, net=_net_name(arrays)
    )


def make_net() -> Net:
    """The net that ships; each user needs one of its own."""
    arrays = _shipped()
    return Net(
        {key.removeprefix(_NET): arrays[key].astype(np.float32) for key in arrays if key.startswith(_NET)}
    )


@cache
def _shipped() -> dict[str, NDArray[np.generic]]:
    """The arrays of the file, which is read at the first call."""
    with (
        (files("lumpwatch.service.detection") / "default_lump.npz").open("rb") as file,
        np.load(file, allow_pickle=False) as archive,
    ):
        return {key: archive[key] for key in archive.files}


def _net_name(arrays: dict[str, NDArray[np.generic]]) -> str:
    """The first 16 digits of the SHA-256 of its weights: a score belongs to the net that it was fitted to."""
    content = sha256()
    for layer in SHAPES:
        for part in ("weight", "bias"):
            content.update(arrays[f"{_NET}{layer}_{part}"].tobytes())
    return content.hexdigest()[:16]
