"""Which foreground is only a shadow: the background with less light on it.

A shadow takes about the same share of the light from all channels. With I the picture and B the background at a
pixel, the share that is left is the length of I along B,

    a = <I, B> / <B, B>,

and the pixel may be shadow where a lies between `darkest` and 1 and what is left over, |I - a B|, is no more than
noise (Horprasert et al. 1999, "A statistical approach for real-time robust background subtraction"). Single pixels
of an object fit as well, by chance. So a shadow needs a core, where all foreground within three pixels may be
shadow; from there it grows over neighbours around which a third may be, up to the object that casts it.

Without colour nothing is left over of anything darker: such pictures must not be asked.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_NEAR, _CORE = 2, 3  # pixels to each side of a window
_SHARE = 0.3
_MAY_BE, _GROWS, _IS = 1, 2, 4


def is_grey(picture: NDArray[np.uint8]) -> bool:
    """Whether the channels of a picture (h, w, 3) are one, on a grid of its pixels."""
    blue, green, red = np.moveaxis(picture[::8, ::8], -1, 0)
    return np.array_equal(blue, green) and np.array_equal(blue, red)


@njit(cache=True)
def remove_shadows(mask, picture, background, darkest, noise):  # type: ignore[no-untyped-def]
    """Set shadow in the mask (h, w) of 0 and 255 to 0; picture (h, w, 3) uint8, background float32; one thread.

    `noise` is the largest root mean square of what is left over of a component, grey levels.
    """
    h, w = mask.shape
    shadow = np.zeros((h, w), np.uint8)
    allowed = np.float32(3.0 * noise * noise)
    candidates = 0
    for y in range(h):
        for x in range(w):
            if mask[y, x] == 0:
                continue
            ib, bb, ii = np.float32(0.0), np.float32(0.0), np.float32(0.0)
            for c in range(3):
                i, b = np.float32(picture[y, x, c]), background[y, x, c]
                ib += i * b
                bb += b * b
                ii += i * i
            if darkest * bb < ib < bb and ii - ib * ib / bb <= allowed:
                shadow[y, x] = _MAY_BE
                candidates += 1
    waiting = np.empty((candidates, 2), np.int32)
    count = 0
    for y in range(h):
        for x in range(w):
            if shadow[y, x] == 0:
                continue
            fit, foreground = _around(mask, shadow, y, x, _NEAR)
            if fit <= _SHARE * foreground:
                continue
            shadow[y, x] |= _GROWS
            fit, foreground = _around(mask, shadow, y, x, _CORE)
            if fit == foreground and 2 * foreground >= (2 * _CORE + 1) ** 2:
                shadow[y, x] |= _IS
                waiting[count] = y, x
                count += 1
    while count > 0:
        count -= 1
        y, x = waiting[count]
        mask[y, x] = 0
        for v in range(max(y - 1, 0), min(y + 2, h)):
            for u in range(max(x - 1, 0), min(x + 2, w)):
                if shadow[v, u] & _GROWS and not shadow[v, u] & _IS:
                    shadow[v, u] |= _IS
                    waiting[count] = v, u
                    count += 1


@njit(cache=True, inline="always")
def _around(mask, shadow, y, x, reach):  # type: ignore[no-untyped-def]
    """Pixels of the window that may be shadow, and those that are foreground."""
    fit, foreground = 0, 0
    for v in range(max(y - reach, 0), min(y + reach + 1, mask.shape[0])):
        for u in range(max(x - reach, 0), min(x + reach + 1, mask.shape[1])):
            foreground += mask[v, u] != 0
            fit += shadow[v, u] != 0
    return fit, foreground
