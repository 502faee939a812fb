"""Is a mouth blocked: enough material stands in it while the feed runs, or a lump that came in has not gone through."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.mouth.patches import PatchGrid
from lumpwatch.models.mouth.standing import SETTLES_S, Standing
from lumpwatch.models.roi import Image

RATE_HZ = 5.0
"""How often the mouth is looked at."""
_LONGEST_S = 1.0
"""A longer gap between two looks counts as this: nobody knows what happened in it."""
_FALLS_S = 3.0
"""So long after a lump was last seen before the mouth it has come to rest, or is through."""
_OF_LUMP, _OF_LUMP_LEFT = 0.4, 0.15
"""Share of a lump's area that must stand together for it to be the lump, and below which it has gone."""
_FEWEST = 3
"""Windows."""


@dataclass(frozen=True, slots=True)
class Limits:
    """When enough stands."""

    blocked_above: float = 0.25
    """Share of the mouth from which on material stands in it."""
    free_below: float = 0.12
    """Share below which none does any more."""
    learn_s: float = 10.0
    """How long the mouth must be seen to swallow before it is known."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """A lump before the mouth."""

    id: int
    share: float
    """Its area as a share of the mouth's."""


@dataclass(frozen=True, slots=True)
class MouthState:
    """What is known of the mouth."""

    share: float = 0.0
    """Share of it in which material stands."""
    stood_s: float = 0.0
    """For how long enough of it has stood while the feed ran."""
    standing: bool = False
    """Whether enough stands."""
    lump: bool = False
    """Whether a lump that came in stands there."""
    known: bool = False
    """Whether the mouth itself is known, from having been seen to swallow."""
    swallows: bool = False
    """Whether material is seen to move."""
    sees: bool = True
    """Whether the mouth shows more than noise, as long as the feed runs."""

    @property
    def stuck(self) -> bool:
        """Whether there is any reason to call it blocked."""
        return self.standing or self.lump


@dataclass(slots=True)
class _Came:
    """A lump on its way into the mouth."""

    first_s: float
    last_s: float
    share: float
    lodged: bool = False


class MouthWatch:
    """One mouth; times rise from step to step, and no clock is read."""

    def __init__(self, mask: Image, limits: Limits) -> None:
        """`mask` (h, w) of the mouth in its working picture. Raises ValueError for one that is too small."""
        self._limits = limits
        self._grid = PatchGrid(mask)
        self._cells = Standing(self._grid)
        self._looked_s: float | None = None
        self._came: dict[int, _Came] = {}
        self.state = MouthState()
        """What is known now."""

    def step(
        self,
        picture: Image,
        time_s: float,
        *,
        runs: bool,
        fit: bool = True,
        arrivals: tuple[Arrival, ...] = (),
    ) -> MouthState:
        """The next working picture (h, w).

        `runs`: whether the feed does; only then the time counts. `fit`: whether the picture is fit to judge; what is
        not changes nothing. `arrivals`: lumps that are before the mouth now.
        """
        for arrival in arrivals:
            self._arrive(arrival, time_s)
        if not fit:
            self._looked_s = time_s
            return self.state
        if self._looked_s is not None and time_s < self._looked_s + 1.0 / RATE_HZ - 1e-3:
            return self.state
        dt = 0.0 if self._looked_s is None else min(time_s - self._looked_s, _LONGEST_S)
        self._looked_s = time_s
        before = self.state
        free = before.known and not before.stuck
        self._cells.step(picture, time_s, dt, learns=not before.known and runs, settled=free and runs)
        share = self._cells.share
        limit = self._limits.free_below if before.standing else self._limits.blocked_above
        standing = share >= limit
        lump = self._lodged(time_s)
        stuck = standing or lump
        stood_s = 0.0
        if stuck:  # what counts as standing has stood for a moment already
            counts = runs and (lump or self._seen_to_stand(time_s))
            stood_s = before.stood_s + dt * counts if before.stuck else SETTLES_S * runs
        known = before.known or self._cells.learned_s >= self._limits.learn_s
        sees = self._cells.sees or stuck or not (runs or not before.sees)
        self.state = MouthState(share, stood_s, standing, lump, known, self._cells.swallows, sees)
        return self.state

    def _seen_to_stand(self, time_s: float) -> bool:
        """Whether what stands is seen now.

        Nobody knows what a mouth full of dust does: no time counts, and none is lost. And through dust more must be
        seen to stand than to move.
        """
        seen = self._cells.seen_share(time_s)
        return seen >= self._limits.free_below and (self._cells.clear or seen >= self._cells.moves)

    def _arrive(self, arrival: Arrival, time_s: float) -> None:
        came = self._came.setdefault(arrival.id, _Came(time_s, time_s, arrival.share))
        came.last_s, came.share = time_s, max(came.share, arrival.share)

    def _lodged(self, time_s: float) -> bool:
        """Whether a lump that came in stands there: together, as large as it, and since it came."""
        for number, came in tuple(self._came.items()):
            since = self._cells.since
            fresh = self._cells.material & (since >= came.first_s) & (since <= came.last_s + _FALLS_S)
            share, windows = _largest(fresh, self._grid)
            least = came.share * (_OF_LUMP_LEFT if came.lodged else _OF_LUMP)
            came.lodged = windows >= _FEWEST and share >= least
            if not came.lodged and time_s > came.last_s + 2.0 * _FALLS_S:
                del self._came[number]
        return any(came.lodged for came in self._came.values())

    def snapshot(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that the next step depends on, as plain data and copies of arrays."""
        cells, arrays = self._cells.state()
        came = {str(number): asdict(one) for number, one in self._came.items()}
        return {
            "cells": cells,
            "looked_s": self._looked_s,
            "came": came,
            "state": asdict(self.state),
        }, arrays

    def restore(self, plain: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from there. Raises ValueError, KeyError or TypeError for what is no state of this mouth."""
        self._cells.restore(plain["cells"], arrays)
        self._looked_s = plain["looked_s"]
        self._came = {int(number): _Came(**one) for number, one in plain["came"].items()}
        self.state = replace(MouthState(), **plain["state"])


def _largest(cells: NDArray[np.bool_], grid: PatchGrid) -> tuple[float, int]:
    """Share of the mouth that the largest group of neighbours among `cells` takes, and its windows."""
    picture = ((grid.place >= 0) & cells[np.maximum(grid.place, 0)]).astype(np.uint8)
    count, labels = cv2.connectedComponents(picture, connectivity=8)
    of = labels[grid.place >= 0]
    shares = np.bincount(of, weights=grid.weight, minlength=count)[1:]
    if not len(shares):
        return 0.0, 0
    return float(shares.max()), int(np.bincount(of, minlength=count)[1:][shares.argmax()])
