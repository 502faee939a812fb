"""The protocols of a likelihood, and what its kinds share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import inf
from typing import Protocol

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import check_shape
from lumpwatch.models.roi import Image, Roi, View
from lumpwatch.models.state import States

LEAST_INSIDE = 0.75
"""A box with a smaller share of its area inside the polygon cannot be an object."""


class Observation(Protocol):
    """One picture, ready to be asked."""

    def log_ratio(self, states: States) -> NDArray[np.float64]:
        """Log p(Z | x, E = 1) / p(Z | E = 0) of the states (n, 8), as (n,)."""


class Likelihood(Protocol):
    """Turns a picture into an observation."""

    def observe(self, view: View, dt: float = inf) -> Observation:
        """Look at the picture once, `dt` seconds after the last. The observation holds until the next call."""


def look(
    pictures: Iterable[Image], roi: Roi, likelihood: Likelihood, dt: float
) -> Iterator[tuple[View, Observation]]:
    """Each working picture of a region, `dt` seconds apart: grey (h, w) or BGR (h, w, 3), uint8.

    Raises ValueError for a picture of another size than the region's.
    """
    for t, picture in enumerate(pictures):
        try:
            view = _view(picture, roi)
        except ValueError as error:
            raise ValueError(f"picture {t}: {error}") from error
        yield view, likelihood.observe(view, dt if t else inf)


def _view(picture: Image, roi: Roi) -> View:
    if getattr(picture, "ndim", 0) != 3:
        return roi.view(picture)
    check_shape(picture, (*roi.shape, 3), "the picture")
    return roi.view(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8), picture)


def bounded(log_ratio: NDArray[np.float64], evidence: float, bound: float) -> NDArray[np.float64]:
    """Temper and clip a frame's log likelihood ratio, so that one frame alone never decides."""
    return np.clip(evidence * log_ratio, -bound, bound)


@njit(cache=True)
def box_sum(integral, x0, y0, x1, y1):  # type: ignore[no-untyped-def]
    """Sum over [x0, x1) x [y0, y1) from an integral image (h + 1, w + 1)."""
    return integral[y1, x1] - integral[y0, x1] - integral[y1, x0] + integral[y0, x0]


@njit(cache=True)
def _rounded_edges(state, scale):  # type: ignore[no-untyped-def]
    half_w, half_h = 0.5 * scale * state[6], 0.5 * scale * state[7]
    x0, x1 = int(np.floor(state[0] - half_w + 0.5)), int(np.floor(state[0] + half_w + 0.5))
    y0, y1 = int(np.floor(state[1] - half_h + 0.5)), int(np.floor(state[1] + half_h + 0.5))
    return x0, y0, x1, y1


@njit(cache=True)
def box_edges(state, scale, width, height):  # type: ignore[no-untyped-def]
    """Integer edges x0, y0, x1, y1 of a state's box, `scale` times as large, clipped to the picture."""
    x0, y0, x1, y1 = _rounded_edges(state, scale)
    return (
        min(max(x0, 0), width),
        min(max(y0, 0), height),
        min(max(x1, 0), width),
        min(max(y1, 0), height),
    )


@njit(cache=True)
def box_inside(inside, state):  # type: ignore[no-untyped-def]
    """The edges of a state's box, clipped, and the share of it, clipped parts included, in the polygon."""
    height, width = inside.shape[0] - 1, inside.shape[1] - 1
    x0, y0, x1, y1 = _rounded_edges(state, 1.0)
    left, right = min(max(x0, 0), width), min(max(x1, 0), width)
    top, bottom = min(max(y0, 0), height), min(max(y1, 0), height)
    area = (x1 - x0) * (y1 - y0)
    share = box_sum(inside, left, top, right, bottom) / area if area > 0 else 0.0
    return (left, top, right, bottom), share
