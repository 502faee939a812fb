"""How much of the smaller of two boxes the larger one covers."""

from __future__ import annotations

from collections.abc import Sequence

SAME_PLACE = 0.3
"""From this share on two boxes lie at the same place."""


def shared(
    low_a: Sequence[float], size_a: Sequence[float], low_b: Sequence[float], size_b: Sequence[float]
) -> float:
    """What two boxes have in common, as a share of the smaller one: upper left corners and sizes (2,), any unit."""
    common = 1.0
    for a, length_a, b, length_b in zip(low_a, size_a, low_b, size_b, strict=True):
        common *= max(min(a + length_a, b + length_b) - max(a, b), 0.0)
    return common / max(min(size_a[0] * size_a[1], size_b[0] * size_b[1]), 1e-9)
