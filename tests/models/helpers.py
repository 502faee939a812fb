"""Fakes and small builders that the tests of `models` share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.models.state import H, States, W, X, Y, blank

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """An observation whose log ratio is a function of the states."""

    function: Callable[[States], Array]

    def log_ratio(self, states: States) -> Array:
        return self.function(states)


def flat(log_ratio: float) -> Seen:
    """The same evidence wherever one looks."""
    return Seen(lambda states: np.full(len(states), log_ratio))


@dataclass(frozen=True)
class Drift:
    """A motion model on the line: x (or another value of the state) moves at a given speed and diffuses."""

    name: str
    speed: float
    noise: float
    momentary: bool = False
    along: int = X

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        moved = states.copy()
        moved[:, self.along] += self.speed * dt + self.noise * np.sqrt(dt) * rng.standard_normal(len(states))
        return moved


@dataclass(frozen=True)
class Marker:
    """A motion model that leaves its mark: x is the mark, nothing else changes."""

    name: str
    mark: float
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        moved = states.copy()
        moved[:, X] = self.mark
        return moved


def boxes(n: int, x: float = 0.0, y: float = 0.0, w: float = 10.0, h: float = 10.0) -> States:
    """`n` equal states at rest."""
    states = blank(n)
    states[:, X], states[:, Y], states[:, W], states[:, H] = x, y, w, h
    return states


def box(x0: float, y0: float, x1: float, y1: float) -> States:
    """One state (1, 8) whose box has the given edges."""
    return boxes(1, (x0 + x1) / 2, (y0 + y1) / 2, x1 - x0, y1 - y0)


def flat_profile(mean: tuple[float, float, float, float], spread: float = 0.0) -> RowProfile:
    """The same (vx, vy, log w, log h) at every row."""
    return RowProfile(0.0, 100.0, np.tile(mean, (2, 1)), np.full((2, 4), spread))


def births_over(width: int, height: int, labels: tuple[float, ...] = (1.0,)) -> PolygonBirths:
    """Objects at rest of 10 x 10 px, born anywhere in a rectangle."""
    ten = float(np.log(10.0))
    return polygon_births(
        np.ones((height, width), np.uint8), flat_profile((0.0, 0.0, ten, ten)), np.array(labels)
    )


def level_density(*levels: float) -> GridDensity:
    """Densities along x in [0, 100] that have the given constant levels, one for each model."""
    return GridDensity(
        (X,), np.array([0.0]), np.array([100.0]), np.repeat(np.array(levels)[:, None], 2, axis=1)
    )


def whole_picture(gray: Image) -> Roi:
    """The region that covers all of a picture, unscaled."""
    height, width = gray.shape
    return make_roi([(0, 0), (1, 0), (1, 1), (0, 1)], width, height, max(width, height))


def gradients(picture: Array, reach: int) -> tuple[Array, Array]:
    """|dx| and |dy| between the pixels `reach` to both sides; the outer ones are repeated beyond the edge."""
    p, n = np.pad(picture, reach, mode="edge"), reach
    return np.abs(p[n:-n, 2 * n :] - p[n:-n, : -2 * n]), np.abs(p[2 * n :, n:-n] - p[: -2 * n, n:-n])


def patch_on_noise(seed: int, contrast: int) -> Image:
    """Noise of 90 x 120 px with a brighter patch."""
    gray = np.random.default_rng(seed).integers(0, 130, (90, 120)).astype(np.uint8)
    gray[30:60, 40:80] += np.uint8(contrast)
    return gray


def patches_on_noise() -> st.SearchStrategy[Image]:
    """Such pictures."""
    return st.builds(patch_on_noise, st.integers(0, 2**32), st.integers(0, 120))


def inside_share_of_noise(x: float, y: float, w: float, h: float) -> float:
    """How much of a box lies in such a picture."""
    across, down = min(x + w / 2, 120) - max(x - w / 2, 0), min(y + h / 2, 90) - max(y - h / 2, 0)
    return across * down / (w * h)


def area_under_roc(found: Array, missed: Array) -> float:
    """Probability that a positive scores above a negative, ties counting half."""
    above = (found[:, None] > missed[None, :]).mean()
    return float(above + 0.5 * (found[:, None] == missed[None, :]).mean())


def moving_track(start: tuple[float, float], steps: Array, size: float = 20.0) -> Array:
    """Boxes (n + 1, 4) of an object that starts somewhere and makes the given steps (n, 2)."""
    centres = np.vstack([start, np.asarray(start) + np.cumsum(steps, axis=0)])
    return np.column_stack([centres, np.full((len(centres), 2), size)])
