"""Who a target is: known again after it was lost, told apart from those it met (see `identity`)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from lumpwatch.models.state import VX, VY, H, X, Y
from lumpwatch.models.trackers.imm_pf.identity import exchanged, touching
from lumpwatch.models.trackers.imm_pf.observation import PictureGrids, difference, refer
from lumpwatch.models.trackers.imm_pf.options import TrackerOptions
from lumpwatch.models.trackers.imm_pf.target import Target, exchange


class Recognition:
    """Remembers those who ended for some time; of the others it keeps nothing."""

    def __init__(self, options: TrackerOptions) -> None:
        self._options = options
        self._lost: list[Target] = []

    def forget(self, dt: float) -> None:
        """Time goes on for those who were lost."""
        for lost in self._lost:
            lost.lost_s += dt
        self._lost = [lost for lost in self._lost if lost.lost_s < self._options.lost_s]

    def lose(self, target: Target) -> None:
        """Remember one that ended."""
        self._lost.append(target)

    def recognise(self, target: Target) -> None:
        """Give a newly confirmed target the identity of the one that was lost here, if it looks like it."""
        known = min(self._lost, key=lambda lost: self._strangeness(lost, target), default=None)
        if known is not None and self._strangeness(known, target) < np.inf:
            self._lost.remove(known)
            target.id, target.looks.before = known.id, known.looks.before

    def _strangeness(self, lost: Target, found: Target) -> float:
        """How badly a target fits one that ended; infinite where it cannot be the same."""
        o = self._options
        reach = o.lost_reach * found.state[H] * (0.5 + lost.lost_s)
        # People do not walk on unseen in one direction for long.
        expected = lost.state[[X, Y]] + lost.state[[VX, VY]] * min(lost.lost_s, 1.0)
        gap = float(np.hypot(*(found.state[[X, Y]] - expected))) / reach
        apart = difference(lost.looks.before or lost.reference, found.reference)
        return gap + apart if gap < 1.0 and apart < o.lost_distance else np.inf

    def tell_apart(self, confirmed: Sequence[Target], seen: PictureGrids, dt: float) -> None:
        """Look at those who stand clear, and let two that were mistaken for each other change places."""
        o = self._options
        if o.settled_s == 0.0:
            return
        clear = self._clear(confirmed)
        for target in clear:
            target.looks.see(refer(seen, target.state, o.observation), dt, o.look_s)
            if not target.looks.met and target.looks.before is not None:
                target.reference = target.looks.before
        for a, b in combinations(clear, 2):
            if b.id in a.looks.met and min(a.looks.since_s, b.looks.since_s) >= o.settled_s:
                self._settle(a, b)
        known = {target.id for target in confirmed}
        for target in confirmed:
            target.looks.settle(known)

    def _clear(self, confirmed: Sequence[Target]) -> list[Target]:
        """Those who stand clear of all others, after noting who met whom."""
        near = list(touching([target.state for target in confirmed], self._options.touching))
        for i, j in near:
            confirmed[i].looks.touch(confirmed[j].id)
            confirmed[j].looks.touch(confirmed[i].id)
        met = {k for pair in near for k in pair}
        return [
            target
            for k, target in enumerate(confirmed)
            if k not in met and target.visible > self._options.clear_above
        ]

    def _settle(self, a: Target, b: Target) -> None:
        """Decide between two who met and have stood clear since."""
        if exchanged(a.looks, b.looks, self._options.exchange_margin):
            exchange(a, b)
        a.looks.met.discard(b.id)
        b.looks.met.discard(a.id)
