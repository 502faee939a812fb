"""What the background model has learned: a few arrays, and their form as named arrays.

A pixel's table (Eq. 5 and 6) is a row of entries in descending order of p^i. An entry holds the
feature v_i and two weights. Eq. 10 multiplies all weights of a table by 1 - alpha at every frame; to
touch only the entry that matched, weights are stored multiplied by a gain G that grows instead:

    G <- G / (1 - alpha),   P <- P + alpha G M,   p = P / G.

The gain is brought back to 1 before it leaves the range of single precision (`LARGEST_GAIN`); rows
start at different gains, so that this never happens to the whole picture in one frame.
In memory a rank of a whole row of pixels lies together: nearly every pixel of nearly every frame touches
its rank 0 alone, so that a frame reads one stretch of memory a row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.trackers.background.options import BackgroundOptions

LARGEST_GAIN = 1e12
_PHASES = 61

STATIC = np.dtype([("v0", "u1"), ("v1", "u1"), ("v2", "u1"), ("unused", "u1"), ("p", "f4"), ("joint", "f4")])
"""An entry of a colour table, v = b, g, r, or of a gradient table, v = 128 + slope along x, along y, 0."""
DYNAMIC = np.dtype(
    [
        ("v0", "u1"), ("v1", "u1"), ("v2", "u1"), ("v3", "u1"), ("v4", "u1"), ("v5", "u1"),
        ("unused", "u2"), ("p", "f4"), ("joint", "f4"),
    ]
)  # fmt: skip
"""An entry of a co-occurrence table, v = b, g, r now and before."""


@dataclass(frozen=True, slots=True)
class Tables:
    """The state of the model for pictures (h, w); the arrays change in place."""

    background: NDArray[np.float32]
    """Background picture, BGR (h, w, 3) [B]."""
    previous: NDArray[np.uint8]
    """The last picture (h, w, 3)."""
    static: NDArray[np.void]
    """Colour and gradient tables (h, N2, w, 2)."""
    static_gain: NDArray[np.float32]
    """Gain of the static tables (h, w)."""
    static_prior: NDArray[np.float32]
    """p(b) of the static tables times their gain (h, w)."""
    dynamic: NDArray[np.void]
    """Co-occurrence tables (h, N2, w, 1)."""
    dynamic_gain: NDArray[np.float32]
    """As for the static tables (h, w)."""
    dynamic_prior: NDArray[np.float32]
    """As for the static tables (h, w)."""
    frames: int
    """Frames learned from."""

    @property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "frames"}


def blank_tables(picture: NDArray[np.uint8], options: BackgroundOptions) -> Tables:
    """Nothing learned: empty tables, and `picture` (h, w, 3) as background and last picture."""
    shape = picture.shape[:2]
    phase = (37 * np.arange(shape[0]) % _PHASES) / _PHASES  # neighbours far apart
    gain = np.repeat(LARGEST_GAIN ** -phase[:, np.newaxis], shape[1], axis=1).astype(np.float32)
    return Tables(
        background=picture.astype(np.float32),
        previous=picture.copy(),
        static=np.zeros((shape[0], options.static_kept, shape[1], 2), STATIC),
        static_gain=gain,
        static_prior=np.zeros(shape, np.float32),
        dynamic=np.zeros((shape[0], options.dynamic_kept, shape[1], 1), DYNAMIC),
        dynamic_gain=gain.copy(),
        dynamic_prior=np.zeros(shape, np.float32),
        frames=0,
    )


def to_arrays(tables: Tables) -> dict[str, NDArray[Any]]:
    """Named plain arrays, copied; entry fields are named `static.p` and so on."""
    named: dict[str, NDArray[Any]] = {"frames": np.array(tables.frames)}
    for name, array in tables.arrays.items():
        if array.dtype.names is None:
            named[name] = array.copy()
            continue
        for field in array.dtype.names:
            if field != "unused":
                named[f"{name}.{field}"] = np.array(array[field])
    return named


def from_arrays(named: Mapping[str, NDArray[Any]], options: BackgroundOptions) -> Tables:
    """The inverse of `to_arrays`.

    Raises ValueError for an array that is missing, unknown, ill-shaped or has impossible numbers.
    """
    shape = np.shape(named.get("background", ()))
    if len(shape) != 3 or shape[2] != 3:
        raise ValueError(f"background is missing or not a picture (h, w, 3): {shape}")
    tables = blank_tables(np.zeros(shape, np.uint8), options)
    expected = to_arrays(tables)
    if odd := set(expected) ^ set(named):
        raise ValueError(f"arrays missing or unknown: {', '.join(sorted(odd))}")
    for name, blank in expected.items():
        given = np.asarray(named[name])
        if given.shape != blank.shape or given.dtype != blank.dtype:
            raise ValueError(
                f"{name} is {given.dtype}{given.shape}, these options need {blank.dtype}{blank.shape}"
            )
        if given.dtype.kind == "f" and not np.isfinite(given).all():
            raise ValueError(f"{name} holds numbers that are not finite")
        if name == "background" and (given.min() < 0.0 or given.max() > 255.0):
            raise ValueError("background holds numbers that are no grey levels")
        if name.endswith("_gain") and given.min() <= 0.0:
            raise ValueError(f"{name} holds numbers that are not positive")
        array, _, field = name.partition(".")
        if name != "frames":
            target = getattr(tables, array)
            (target[field] if field else target)[...] = given
    return replace(tables, frames=int(named["frames"]))
