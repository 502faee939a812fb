"""One frame of the background model, pixel by pixel (paper 3, section II, after Li et al. 2003).

With the numbers of paper 3's equations, for every pixel:

    change    differs: I - B is beyond its limits; moved: I - I_previous is
    classify  unchanged: background
              moved, by co-occurrence v: background if 2 P(v, b) > P(v)                       (4, 9, 15, 16)
              else, by colour c and gradient e: if 2 P(c, b) P(e, b) / P(b) > P(c) P(e)       (7, 8, 15, 16)
    learn     the tables that were asked, at rate alpha                                       (10, 11)
    once-off  sum of P(v) - P(v, b) over the first N1 exceeds M: foreground becomes background   (12 to 14)
    maintain  B <- (1 - beta) B + beta I if unchanged, B <- I if background all the same      (17, 18)

The tables hold the joint P(v_i, b): that is what the update of Eq. 10 estimates, and the conditional of the
papers is P(v_i | b) = P(v_i, b) / P(b). With it Eq. 4 needs no division, the left side of Eq. 13 is the
joint of the foreground, and Eq. 14 reads P(v_i, b) <- P(v_i) - P(v_i, b), P(b) <- 1 - P(b). A new entry
(Eq. 11) counts for the background only if the pixel ended as background.

What is background learns in every few frames, for all of them at once (`learn_every`): most of the time went into
learning again what is known. After a change of light all pixels learn in every frame until the background picture
has followed.

After a once-off change Eq. 14 makes foreground of the old background, and what leaves again uncovers a stranger.
With `keep` everything that the pixel has shown so far is background: P(v_i, b) <- P(v_i), P(b) <- 1.

Paper 3 calls a pixel unchanged that neither differs nor moved (`paper`). Then what an object uncovers is
foreground for one frame more, because the step from the object to the background is in no table. By
default a pixel is unchanged that does not differ, and one that moved may be background by either rule.

Eq. 8, d = 1 - 2 <u, v> / (|u|^2 + |v|^2) = |u - v|^2 / (|u|^2 + |v|^2) < delta, compares direction and
length. Where both are short, noise alone makes them differ, and a flat place would never show a gradient
twice: vectors closer than a noise floor are the same as well.

Whole arrays go through with indices, since a view for each pixel would cost more than the work on it.
All of the kernel is in this one file, because numba's cache notices changes of the calling file only.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from lumpwatch.models.trackers.background.tables import LARGEST_GAIN

_LARGEST = np.float32(LARGEST_GAIN)
_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)
_COLOUR, _GRADIENT = 0, 1
_ORIGIN = 128  # a gradient component of zero, as it is kept


@njit(cache=True)
def process(picture, dx, dy, watched, limits, tables, settings, mask):  # type: ignore[no-untyped-def]
    """Write the mask (h, w) of the picture (h, w, 3) and change the tables; one thread."""
    for y in range(len(picture)):
        _row(y, picture, dx, dy, watched, limits, tables, settings, mask)


@njit(cache=True, parallel=True)
def process_parallel(picture, dx, dy, watched, limits, tables, settings, mask):  # type: ignore[no-untyped-def]
    """The same by numba's thread pool; rows share nothing, so the result is the same too."""
    for y in prange(len(picture)):
        _row(y, picture, dx, dy, watched, limits, tables, settings, mask)


@njit(cache=True)
def _row(y, picture, dx, dy, watched, limits, tables, settings, mask):  # type: ignore[no-untyped-def]
    background, previous, static, static_gain, static_prior, dynamic, dynamic_gain, dynamic_prior = tables
    coarse, fine = settings.dynamic_shift, settings.static_shift
    turn = settings.learn and y % settings.every == settings.phase
    for x in range(picture.shape[1]):
        if watched[y, x] == 0:
            mask[y, x] = 0
            continue
        b, g, r = picture[y, x, 0], picture[y, x, 1], picture[y, x, 2]
        moved, differs = False, False
        for c in range(3):
            gap = np.float32(picture[y, x, c]) - background[y, x, c]
            differs |= gap < limits[0, c, 0] or gap > limits[0, c, 1]
        if differs or settings.paper:
            for c in range(3):
                gap = np.float32(picture[y, x, c]) - np.float32(previous[y, x, c])
                moved |= gap < limits[1, c, 0] or gap > limits[1, c, 1]
        unchanged = not (differs or moved)
        known = unchanged or settings.all_background
        if unchanged and not turn:
            mask[y, x] = 0
            if settings.learn:
                for c in range(3):
                    background[y, x, c] += settings.background_rate * (
                        np.float32(picture[y, x, c]) - background[y, x, c]
                    )
            continue
        colour = (np.int32(b >> fine), np.int32(g >> fine), np.int32(r >> fine))
        slope = (_slope(dx[y, x], fine), _slope(dy[y, x], fine), np.int32(0))
        if moved and not unchanged:
            if not (known or settings.paper):
                known = _ask_static(static, static_gain, static_prior, y, x, colour, slope, settings)[0]
            before = previous[y, x, 0] >> coarse, previous[y, x, 1] >> coarse, previous[y, x, 2] >> coarse
            pair = (b >> coarse, g >> coarse, r >> coarse, before[0], before[1], before[2])
            background_now = _dynamic(dynamic, dynamic_gain, dynamic_prior, y, x, pair, known, settings)
        else:
            background_now = _static(
                static, static_gain, static_prior, y, x, colour, slope, known, turn, settings
            )
        mask[y, x] = 0 if background_now else 255
        if settings.learn and background_now:
            beta = settings.background_rate if unchanged else _ONE
            for c in range(3):
                background[y, x, c] += beta * (np.float32(picture[y, x, c]) - background[y, x, c])


@njit(cache=True, inline="always")
def _slope(sobel, shift):  # type: ignore[no-untyped-def]
    """Grey levels a pixel from the Sobel operator, which weighs eight times, quantised."""
    return np.int32(min(max(np.int32(sobel) >> 3, -128), 127) >> shift)


@njit(cache=True, inline="always")
def _static(tables, gains, priors, y, x, colour, slope, known, turn, settings):  # type: ignore[no-untyped-def]
    """Whether pixel (y, x) is background, by colour and gradient or because that is `known`; learn it."""
    if known:
        if not settings.learn:
            return True
        c, c_found, _, _ = _find_static(tables, y, x, _COLOUR, colour, 0, settings)
        e, e_found, _, _ = _find_static(tables, y, x, _GRADIENT, slope, 0, settings)
        background = True
    else:
        background, c, c_found, e, e_found = _ask_static(tables, gains, priors, y, x, colour, slope, settings)
        if not settings.learn or (background and not turn):
            return background
    gain = _grow(tables, gains, priors, y, x, settings.known_growth if background else settings.growth)
    weight = (settings.known_rate if background else settings.rate) * gain
    if not c_found:
        entry = tables[y, c, x, _COLOUR]
        entry.v0, entry.v1, entry.v2 = colour
    if not e_found:
        entry = tables[y, e, x, _GRADIENT]
        entry.v0, entry.v1, entry.v2 = slope[0] + _ORIGIN, slope[1] + _ORIGIN, 0
    _learn(tables, y, x, _COLOUR, c, c_found, weight, background)
    _learn(tables, y, x, _GRADIENT, e, e_found, weight, background)
    if background:
        priors[y, x] += weight
        return True
    least, used = settings.once_off_share * gain, settings.static_used
    if _is_replaced(tables, y, x, _COLOUR, used, least) and _is_replaced(
        tables, y, x, _GRADIENT, used, least
    ):
        _replace(tables, y, x, _COLOUR, settings.keep)
        _replace(tables, y, x, _GRADIENT, settings.keep)
        priors[y, x] = gain if settings.keep else gain - priors[y, x]
    return False


@njit(cache=True)
def _ask_static(tables, gains, priors, y, x, colour, slope, settings):  # type: ignore[no-untyped-def]
    """Whether colour and gradient are background by Eq. 7, and the place of either as in `_find_static`."""
    used = settings.static_used
    c, c_found, c_p, c_joint = _find_static(tables, y, x, _COLOUR, colour, used, settings)
    e, e_found, e_p, e_joint = _find_static(tables, y, x, _GRADIENT, slope, used, settings)
    # Eq. 7 times P(b); all weights carry the gain.
    background = _TWO * c_joint * e_joint > c_p * e_p * (priors[y, x] / gains[y, x])
    return background, c, c_found, e, e_found


@njit(cache=True, inline="always")
def _find_static(tables, y, x, k, feature, used, settings):  # type: ignore[no-untyped-def]
    """First match (else the place for a new entry), whether there is one, and sums of matches within `used`."""
    first, p, joint = -1, _ZERO, _ZERO
    u0, u1, u2 = feature
    length = u0 * u0 + u1 * u1 + u2 * u2
    floor = settings.colour_floor if k == _COLOUR else settings.gradient_floor
    origin = np.int32(0 if k == _COLOUR else _ORIGIN)
    last = tables.shape[1] - 1
    for i in range(tables.shape[1]):
        entry = tables[y, i, x, k]
        if entry.p == _ZERO:
            last = i
            break
        v0, v1, v2 = np.int32(entry.v0) - origin, np.int32(entry.v1) - origin, np.int32(entry.v2)
        gap = (u0 - v0) ** 2 + (u1 - v1) ** 2 + (u2 - v2) ** 2
        both = length + v0 * v0 + v1 * v1 + v2 * v2
        if gap == 0 or np.float32(gap) < settings.static_distance * np.float32(both) + floor:
            if first < 0:
                first = i
            if i < used:
                p += entry.p
                joint += entry.joint
        if first >= 0 and i + 1 >= used:
            break
    return (first, True, p, joint) if first >= 0 else (last, False, p, joint)


@njit(cache=True)
def _dynamic(tables, gains, priors, y, x, pair, known, settings):  # type: ignore[no-untyped-def]
    """Whether pixel (y, x) is background, by co-occurrence or because that is `known`; learn it."""
    used = 0 if known else settings.dynamic_used
    at, found, p, joint = _find_dynamic(tables, y, x, pair, used, settings.dynamic_distance)
    background = known or _TWO * joint > p
    if not settings.learn:
        return background
    gain = _grow(tables, gains, priors, y, x, settings.growth)
    weight = settings.rate * gain
    if not found:
        entry = tables[y, at, x, 0]
        entry.v0, entry.v1, entry.v2, entry.v3, entry.v4, entry.v5 = pair
    _learn(tables, y, x, 0, at, found, weight, background)
    if background:
        priors[y, x] += weight
    elif _is_replaced(tables, y, x, 0, settings.dynamic_used, settings.once_off_share * gain):
        _replace(tables, y, x, 0, settings.keep)
        priors[y, x] = gain if settings.keep else gain - priors[y, x]
    return background


@njit(cache=True, inline="always")
def _find_dynamic(tables, y, x, pair, used, distance):  # type: ignore[no-untyped-def]
    """The same as `_find_static` by Eq. 9."""
    first, p, joint = -1, _ZERO, _ZERO
    last = tables.shape[1] - 1
    for i in range(tables.shape[1]):
        entry = tables[y, i, x, 0]
        if entry.p == _ZERO:
            last = i
            break
        if (
            abs(np.int32(entry.v0) - pair[0]) <= distance
            and abs(np.int32(entry.v1) - pair[1]) <= distance
            and abs(np.int32(entry.v2) - pair[2]) <= distance
            and abs(np.int32(entry.v3) - pair[3]) <= distance
            and abs(np.int32(entry.v4) - pair[4]) <= distance
            and abs(np.int32(entry.v5) - pair[5]) <= distance
        ):
            if first < 0:
                first = i
            if i < used:
                p += entry.p
                joint += entry.joint
        if first >= 0 and i + 1 >= used:
            break
    return (first, True, p, joint) if first >= 0 else (last, False, p, joint)


@njit(cache=True, inline="always")
def _grow(tables, gains, priors, y, x, growth):  # type: ignore[no-untyped-def]
    """Let the weights of a pixel's tables and its prior decay by raising their gain; the new gain."""
    gain = gains[y, x] * growth
    if gain > _LARGEST:
        for i in range(tables.shape[1]):
            for k in range(tables.shape[3]):
                tables[y, i, x, k].p /= gain
                tables[y, i, x, k].joint /= gain
        priors[y, x] /= gain
        gain = _ONE
    gains[y, x] = gain
    return gain


@njit(cache=True, inline="always")
def _learn(tables, y, x, k, at, found, weight, background):  # type: ignore[no-untyped-def]
    """Add `weight` to entry `at` (Eq. 10), or give it that alone where it is new (Eq. 11); keep the order."""
    entry = tables[y, at, x, k]
    joint = weight if background else _ZERO
    if found:
        entry.p += weight
        entry.joint += joint
    else:
        entry.p = weight
        entry.joint = joint
    if at > 0 and entry.p > tables[y, at - 1, x, k].p:
        rising = tables[y, at : at + 1, x, k].copy()
        while at > 0 and rising[0].p > tables[y, at - 1, x, k].p:
            tables[y, at, x, k] = tables[y, at - 1, x, k]
            at -= 1
        tables[y, at, x, k] = rising[0]


@njit(cache=True)
def _is_replaced(tables, y, x, k, used, least):  # type: ignore[no-untyped-def]
    """Whether the first `used` entries have more than the weight `least` in the foreground (Eq. 13)."""
    foreground = _ZERO
    for i in range(used):
        foreground += tables[y, i, x, k].p - tables[y, i, x, k].joint
    return foreground > least


@njit(cache=True)
def _replace(tables, y, x, k, keep):  # type: ignore[no-untyped-def]
    """Turn foreground into background (Eq. 14), or with `keep` all that was seen."""
    for i in range(tables.shape[1]):
        entry = tables[y, i, x, k]
        entry.joint = entry.p if keep else entry.p - entry.joint
