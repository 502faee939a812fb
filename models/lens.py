"""Lens distortion: where a pinhole would have seen what a lens shows elsewhere, and how to find it from straight edges.

    ideal = c + (seen - c) (1 + k1 r^2 + k2 r^4),    r = |seen - c| / (width / 2)

with c the middle of the picture. It is the even polynomial of Brown (1966) without its tangential part, applied from
the picture to the pinhole, so that the direction that is needed most takes no iteration. k1 > 0 straightens the barrel
of a wide lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 30
_LEAST_POINTS = 3
_LEAST_FOR_BOTH = 8
"""Points beyond the two that each edge's line takes: fewer do not tell two coefficients apart."""
_LEAST_SLOPE_PX = 3.0
"""By how much points leave their lines for a coefficient that is wrong by one: less hides in errors of a pixel."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Raises ValueError for coefficients by which the picture would fold over itself."""

    k1: float
    k2: float
    size: tuple[int, int]
    """Width and height of the picture, px."""

    def __post_init__(self) -> None:
        r = np.linspace(0.0, float(np.hypot(*self.size)) / self.size[0], 200)
        if not np.all(1.0 + 3.0 * self.k1 * r**2 + 5.0 * self.k2 * r**4 > 0.05):
            raise ValueError(f"lens: by k1 {self.k1:g} and k2 {self.k2:g} the picture folds over itself")

    def ideal(self, points: Array) -> Array:
        """Where a pinhole would have seen picture points (n, 2)."""
        middle = np.array(self.size) / 2.0
        away = points - middle
        square = np.square(away).sum(axis=-1, keepdims=True) / (self.size[0] / 2.0) ** 2
        return np.asarray(middle + away * (1.0 + self.k1 * square + self.k2 * square**2))

    def seen(self, points: Array) -> Array:
        """The inverse, for points that the picture shows."""
        middle = np.array(self.size) / 2.0
        half = self.size[0] / 2.0
        away = points - middle
        target = np.linalg.norm(away, axis=-1, keepdims=True) / half
        r = target.copy()
        for _ in range(_ROUNDS):
            value = r * (1.0 + self.k1 * r**2 + self.k2 * r**4)
            slope = 1.0 + 3.0 * self.k1 * r**2 + 5.0 * self.k2 * r**4
            r = np.maximum(r - (value - target) / np.maximum(slope, 0.05), 0.0)
        return np.asarray(middle + away * np.where(target > 0, r / np.maximum(target, 1e-12), 1.0))

    def ideal_box(self, box: Array) -> Array:
        """The box (x, y, w, h by its centre) that a pinhole would have seen: by the middles of its sides."""
        x, y, w, h = box
        sides = self.ideal(np.array([[x - w / 2, y], [x + w / 2, y], [x, y - h / 2], [x, y + h / 2]]))
        across, down = sides[1] - sides[0], sides[3] - sides[2]
        return np.array([*sides.mean(axis=0), np.hypot(*across), np.hypot(*down)])

    def magnified(self, points: Array) -> Array:
        """By how much a small length at picture points (n, 2) is longer for the pinhole (n,)."""
        step = np.array([[0.5, 0.0], [0.0, 0.5]])
        lengths = [np.linalg.norm(self.ideal(points + d) - self.ideal(points - d), axis=-1) for d in step]
        return np.asarray(np.sqrt(lengths[0] * lengths[1]))


def find_lens(edges: Sequence[Array], size: tuple[int, int]) -> tuple[Lens, float]:
    """The lens by which edges that are straight in the world are straight, and how far their points are off, px (rms).

    Each edge is some points (n, 2) of the picture, three at least. k2 is 0 where they are few. Raises ValueError.
    """
    from scipy.optimize import least_squares  # only who calibrates a lens loads it

    if not edges or any(len(edge) < _LEAST_POINTS for edge in edges):
        raise ValueError(f"lens: needs edges of {_LEAST_POINTS} points each at least")
    both = sum(len(edge) - 2 for edge in edges) >= _LEAST_FOR_BOTH
    middle, half = np.array(size) / 2.0, size[0] / 2.0

    def bent(k: Array) -> Array:
        k1, k2 = k[0], k[1] if both else 0.0
        off = []
        for edge in edges:
            away = (np.asarray(edge, float) - middle) / half
            square = np.square(away).sum(axis=1, keepdims=True)
            straight = away * (1.0 + k1 * square + k2 * square**2)
            centred = straight - straight.mean(axis=0)
            normal = np.linalg.svd(centred)[2][1]
            normal = normal * np.sign(
                normal[np.argmax(np.abs(normal))]
            )  # a sign that flips has no derivative
            # In pixels of the picture: a lens that shrinks everything is not better for it.
            off.append(centred @ normal / (1.0 + k1 * square[:, 0] + k2 * square[:, 0] ** 2) * half)
        return np.concatenate(off)

    found = least_squares(bent, np.zeros(2 if both else 1), bounds=(-0.5, 2.0))
    if np.linalg.norm(found.jac, axis=0).min() < _LEAST_SLOPE_PX:
        raise ValueError(
            "lens: these edges tell nothing of it: give points farther apart, and edges far from the middle"
        )
    k1, k2 = float(found.x[0]), float(found.x[1]) if both else 0.0
    return Lens(k1, k2, size), float(np.sqrt(np.mean(np.square(bent(found.x)))))
