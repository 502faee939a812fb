"""Regions of a mask by flooding: little is foreground, so this takes a quarter of the time of labelling every pixel."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def keep_large(mask, least_area):  # type: ignore[no-untyped-def]
    """A copy of the mask (h, w) of 0 and 255 without its 8-connected regions of fewer pixels than that."""
    h, w = mask.shape
    kept = mask.copy()
    seen = np.zeros((h, w), np.bool_)
    region = np.empty(h * w, np.int32)
    for y in range(h):
        for x in range(w):
            if mask[y, x] == 0 or seen[y, x]:
                continue
            seen[y, x] = True
            region[0], size, done = y * w + x, 1, 0
            while done < size:
                row, column = divmod(region[done], w)
                done += 1
                for v in range(max(row - 1, 0), min(row + 2, h)):
                    for u in range(max(column - 1, 0), min(column + 2, w)):
                        if mask[v, u] != 0 and not seen[v, u]:
                            seen[v, u] = True
                            region[size] = v * w + u
                            size += 1
            if size < least_area:
                for k in range(size):
                    kept[region[k] // w, region[k] % w] = 0
    return kept
