"""Where, how large, how fast and by which model a new object appears: p_b(x) and P_b(alpha)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lumpwatch.models.checks import as_finite, as_probabilities, check_rng, check_shape, settle
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.jdt.switching import draw
from lumpwatch.models.roi import Image
from lumpwatch.models.state import VX, VY, H, Labels, States, W, X, Y, blank


class Births(Protocol):
    """The law of newborn particles."""

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        """`n` newborn states (n, 8) and their motion models (n,)."""


@dataclass(frozen=True, slots=True)
class PolygonBirths:
    """Uniform over the pixels of a polygon; velocity and size from the row profile."""

    pixels: NDArray[np.int32]
    """x and y of every pixel inside (k, 2)."""
    profile: RowProfile
    model_probabilities: NDArray[np.float64]
    """P_b(alpha), (M,)."""

    def __post_init__(self) -> None:
        """Raises ValueError for pixels that are not (k, 2), and probabilities that do not sum to 1."""
        check_shape(self.pixels, ("k", 2), "pixels")
        if len(self.pixels) == 0:
            raise ValueError("pixels must hold one pixel or more")
        probabilities = as_probabilities(self.model_probabilities, "models", "model_probabilities")
        settle(self, {"model_probabilities": probabilities})

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        """`n` newborn states and their motion models."""
        check_rng(rng)
        states = blank(n)
        _place(states, self.pixels, rng)
        values = self.profile.draw(states[:, Y], rng)
        states[:, VX : VY + 1] = values[:, :2]
        states[:, W : H + 1] = values[:, 2:]
        rows = np.broadcast_to(self.model_probabilities, (n, len(self.model_probabilities)))
        return states, draw(rows, rng)


@dataclass(frozen=True, slots=True)
class KernelBirths:
    """Where labelled objects first appeared: Gaussian kernels over those places, and a share anywhere."""

    places: NDArray[np.float64]
    """x and y of the places (k, 2)."""
    bandwidth: NDArray[np.float64]
    """Standard deviation of the kernels along x and y (2,)."""
    anywhere: PolygonBirths
    anywhere_share: float = 0.1
    """Objects that appear where none did in training are found more slowly, but found."""

    def __post_init__(self) -> None:
        """Raises ValueError for places that are not (k, 2), a bandwidth that is not (2,) and a share beyond 0 to 1."""
        places = as_finite(self.places, ("k", 2), "places")
        if len(places) == 0:
            raise ValueError("places must hold one place or more")
        settle(self, {"places": places, "bandwidth": as_finite(self.bandwidth, (2,), "bandwidth")})
        if not 0.0 <= self.anywhere_share <= 1.0:
            raise ValueError(f"anywhere_share must be from 0 to 1, not {self.anywhere_share}")

    def draw(self, n: int, rng: np.random.Generator) -> tuple[States, Labels]:
        """`n` newborn states and their motion models."""
        states, labels = self.anywhere.draw(n, rng)
        chosen = np.flatnonzero(rng.random(n) >= self.anywhere_share)
        kernels = self.places[rng.integers(len(self.places), size=len(chosen))]
        states[chosen, X : Y + 1] = kernels + self.bandwidth * rng.standard_normal((len(chosen), 2))
        values = self.anywhere.profile.draw(states[chosen, Y], rng)
        states[chosen, VX : VY + 1] = values[:, :2]
        states[chosen, W : H + 1] = values[:, 2:]
        return states, labels


def polygon_births(
    mask: Image, profile: RowProfile, model_probabilities: NDArray[np.float64]
) -> PolygonBirths:
    """Births over the pixels where `mask` (h, w) is not zero, by the models' probabilities (M,).

    Raises ValueError for an empty mask, and probabilities that do not sum to 1.
    """
    check_shape(mask, ("h", "w"), "mask")
    rows, columns = np.nonzero(mask)
    if len(rows) == 0:
        raise ValueError("the polygon covers no pixel")
    return PolygonBirths(np.column_stack([columns, rows]).astype(np.int32), profile, model_probabilities)


@njit(cache=True)
def _place(states, pixels, rng):  # type: ignore[no-untyped-def]
    """Put each state anywhere in one of the pixels."""
    for i in range(len(states)):
        pixel = pixels[int(rng.random() * len(pixels))]
        states[i, X] = pixel[0] + rng.random()
        states[i, Y] = pixel[1] + rng.random()
