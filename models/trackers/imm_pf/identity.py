"""Who is who after targets met: what they looked like before tells it.

Where two targets overlap, the filter of one can go on with the other's body. Each target keeps a running mean of its
histograms from pictures in which it stands clear of all others. When two that met both stand clear again for some
time, their looks since then are compared with those before in both pairings; where the other one fits better by a
margin, the two change places. (A decision once the ambiguity is over, as by track segments, not frame by frame: Perera,
Srinivas, Hoogs, Brooksby, Hu 2006, "Multi-object tracking through simultaneous long occlusions and split-merge
conditions".)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from math import exp

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.state import H, W, X, Y
from lumpwatch.models.trackers.imm_pf.observation import Reference, difference

Array = NDArray[np.float64]


@dataclass(slots=True)
class Looks:
    """What a target looked like while it stood clear of others."""

    before: Reference | None = None
    """Before it met anybody, as far as it was seen; a mean that forgets."""
    since: Reference | None = None
    """Since then."""
    since_s: float = 0.0
    met: set[int] = field(default_factory=set)
    """Identities of those among whom it may be another."""

    def see(self, look: Reference, dt: float, memory_s: float) -> None:
        """One picture in which the target stands clear."""
        if self.met:
            self.since = look if self.since is None else _mixed(self.since, look, self.since_s, dt)
            self.since_s += dt
        elif self.before is None:
            self.before = look
        else:
            share = exp(-dt / memory_s)
            self.before = _mixed(self.before, look, share, 1.0 - share)

    def touch(self, other: int) -> None:
        """It overlaps another target: what was seen since the last meeting may belong to either."""
        self.met.add(other)
        self.since, self.since_s = None, 0.0

    def settle(self, others: set[int]) -> None:
        """Forget meetings with those who are not among `others`; without any left, it is itself again."""
        self.met &= others
        if not self.met and self.since is not None:
            self.before = self.since if self.before is None else _mixed(self.before, self.since, 0.5, 0.5)
            self.since, self.since_s = None, 0.0


def touching(states: Sequence[Array], least: float) -> Iterator[tuple[int, int]]:
    """Pairs of states (8,) whose boxes share more than `least` of the smaller one, by their places in the list."""
    for (i, a), (j, b) in combinations(enumerate(states), 2):
        w = min(a[X] + a[W] / 2, b[X] + b[W] / 2) - max(a[X] - a[W] / 2, b[X] - b[W] / 2)
        h = min(a[Y] + a[H] / 2, b[Y] + b[H] / 2) - max(a[Y] - a[H] / 2, b[Y] - b[H] / 2)
        if w > 0.0 and h > 0.0 and w * h > least * min(a[W] * a[H], b[W] * b[H]):
            yield i, j


def exchanged(a: Looks, b: Looks, margin: float) -> bool:
    """Whether the two look like each other rather than like themselves; False where one was never seen clearly."""
    if a.before is None or b.before is None or a.since is None or b.since is None:
        return False
    kept = difference(a.before, a.since) + difference(b.before, b.since)
    crossed = difference(a.before, b.since) + difference(b.before, a.since)
    return kept - crossed > margin


def _mixed(a: Reference, b: Reference, weight_a: float, weight_b: float) -> Reference:
    """The weighted mean of two looks."""
    share = weight_a / (weight_a + weight_b)
    return Reference(*(share * x + (1.0 - share) * y for x, y in zip(_parts(a), _parts(b), strict=True)))


def _parts(look: Reference) -> tuple[Array, Array, Array]:
    return look.upper, look.lower, look.motion
