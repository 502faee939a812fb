"""Fakes and small builders that the tests of `models` share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.births import PolygonBirths, polygon_births
from models.density import GridDensity
from models.profile import RowProfile
from models.roi import Image, Roi, make_roi
from models.state import H, States, W, X, Y, blank

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
    """A motion model on the line: x moves at a given speed and diffuses."""

    name: str
    speed: float
    noise: float
    momentary: bool = False

    def move(self, states: States, dt: float, rng: np.random.Generator) -> States:
        moved = states.copy()
        moved[:, X] += self.speed * dt + self.noise * np.sqrt(dt) * rng.standard_normal(len(states))
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


def area_under_roc(found: Array, missed: Array) -> float:
    """Probability that a positive scores above a negative, ties counting half."""
    above = (found[:, None] > missed[None, :]).mean()
    return float(above + 0.5 * (found[:, None] == missed[None, :]).mean())


def moving_track(start: tuple[float, float], steps: Array, size: float = 20.0) -> Array:
    """Boxes (n + 1, 4) of an object that starts somewhere and makes the given steps (n, 2)."""
    centres = np.vstack([start, np.asarray(start) + np.cumsum(steps, axis=0)])
    return np.column_stack([centres, np.full((len(centres), 2), size)])
