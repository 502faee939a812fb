"""Measuring side by side: all candidates take turns in one process on one thread.

Other load on the machine then touches all of them alike. A turn is as many calls as fit into a few
milliseconds; figures are medians over the turns, and ratios are medians of the ratios within a turn.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

TURN_S = 0.02


@dataclass(frozen=True)
class Timings:
    """CPU seconds a call of each candidate in each turn."""

    turns: Mapping[str, tuple[float, ...]]

    def ms(self, name: str) -> float:
        """Median of one candidate in milliseconds."""
        return 1000 * statistics.median(self.turns[name])

    def ratio(self, name: str, to: str) -> float:
        """Median over the turns of one candidate's time divided by another's."""
        pairs = zip(self.turns[name], self.turns[to], strict=True)
        return statistics.median(one / other for one, other in pairs)


def alternate(candidates: Mapping[str, Callable[[], object]], turns: int = 15, warm_up: int = 5) -> Timings:
    """Run all candidates in turn; the warm-up compiles kernels and lets beliefs settle."""
    calls: dict[str, int] = {}
    for name, candidate in candidates.items():
        for _ in range(warm_up):
            candidate()
        began = time.process_time()
        candidate()
        calls[name] = max(1, round(TURN_S / max(time.process_time() - began, 1e-6)))
    seen: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(turns):
        for name, candidate in candidates.items():
            began = time.process_time()
            for _ in range(calls[name]):
                candidate()
            seen[name].append((time.process_time() - began) / calls[name])
    return Timings({name: tuple(times) for name, times in seen.items()})
