"""Which differences between two pictures are changes: thresholds by least median of squares.

For each channel the signed differences D of a grid of pixels go into a histogram. The least median of
squares location is the middle of the shortest interval that holds half of them; half its length is
the median absolute residual, and the scale is sigma = 1.4826 (1 + 5 / (n - 1)) half length (Rousseeuw
and Leroy 1987; used for change detection by Rosin 1998, and by Li et al. 2003). A pixel has changed
where |D - location| > k sigma in a channel, with k sigma kept within given bounds.

The location takes out what the whole picture does at once, such as a camera that adjusts its exposure.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

SAMPLES = 10_000
"""About so many pixels are looked at."""


def change_limits(
    differences: NDArray[np.int32], sigmas: float, least: float, largest: float, largest_light: float
) -> NDArray[np.float32]:
    """Lowest and highest difference (..., 2) that is no change, from histograms (..., 511) of -255 to 255.

    The reach is kept from `least` to `largest`; a location beyond `largest_light` is taken for 0.
    """
    limits = np.empty((*differences.shape[:-1], 2), np.float32)
    for index in np.ndindex(differences.shape[:-1]):
        location, sigma = lmeds(differences[index])
        if abs(location) > largest_light:
            location = 0.0
        reach = min(max(sigmas * sigma, least), largest)
        limits[index] = location - reach, location + reach
    return limits


@njit(cache=True)
def lmeds(counts):  # type: ignore[no-untyped-def]
    """Location and scale by least median of squares, from a histogram (511,) of -255 to 255."""
    total = counts.sum()
    if total < 2:
        return 0.0, 0.0
    half = total // 2 + 1
    first, inside, shortest, location = 0, 0, 1000, 0.0
    for last in range(len(counts)):
        inside += counts[last]
        while inside - counts[first] >= half:
            inside -= counts[first]
            first += 1
        middle = 0.5 * (first + last) - 255.0
        if inside >= half and (
            last - first < shortest or (last - first == shortest and abs(middle) < abs(location))
        ):
            shortest, location = last - first, middle
    return location, 1.4826 * (1.0 + 5.0 / (total - 1)) * 0.5 * shortest


@njit(cache=True)
def count_differences(picture, background, previous, watched):  # type: ignore[no-untyped-def]
    """Histograms (2, 3, 511) of picture - background and picture - previous over a grid of watched pixels."""
    h, w = picture.shape[:2]
    step = max(1, round(np.sqrt(h * w / SAMPLES)))
    counts = np.zeros((2, 3, 511), np.int32)
    for y in range(step // 2, h, step):
        for x in range(step // 2, w, step):
            if watched[y, x] == 0:
                continue
            for c in range(3):
                now = np.int32(picture[y, x, c])
                counts[0, c, 255 + now - int(background[y, x, c] + np.float32(0.5))] += 1
                counts[1, c, 255 + now - np.int32(previous[y, x, c])] += 1
    return counts
