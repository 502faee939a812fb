"""Which windows of a mouth show material that stands, and since when.

A window that shows the same for a while is *held*. It stays held while something passes in front of it: what passes
does not stand, and what was behind it comes back. What stood while the mouth swallowed, from the beginning, is the
mouth itself and no material.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.mouth.patches import SIDE, Look, PatchGrid, Windows, likeness
from lumpwatch.models.roi import Image

SETTLES_S = 2.0
"""What shows the same for so long stands: by then slow material has left the reach of a camera that shakes."""
_SAME = 0.7
"""Windows that are more alike than this, times the share of them that is no noise, show the same."""
_LOST_S, _UNSEEN_S = 1.5, 30.0
"""What stood is forgotten when something else is seen in its place for so long, or nothing for much longer."""
_OWN_S = 4.0
"""What stands for so long while the mouth is learned is the mouth itself."""
_BUILT_UP_S = 600.0
"""So is what stands later for so long while the mouth swallows: dirt that has built up, a new liner."""
_FOLLOWS = 0.01
"""How much of the present picture is taken into that of the mouth itself with each look: its light changes."""
_QUIETEST, _NOISE_S = 0.05, 10.0
"""The noise is what the quietest windows change by, the least over about this time: there some stand now and then."""
_SWALLOWS = 0.05
"""Share of the windows that must change for the mouth to be seen to swallow."""
_TELL, _TELLS_S = 0.15, 2.0
"""Share of the windows that must show anything, over about this time, for the mouth to be seen at all."""


class Standing:
    """The windows of one mouth; times rise."""

    def __init__(self, grid: PatchGrid) -> None:
        self._grid, n = grid, len(grid)
        self._held = np.zeros((n, SIDE * SIDE), np.float32)
        self._next = np.zeros_like(self._held)
        self._own = np.zeros_like(self._held)
        self._is_held, self._has_own, self._is_own = (np.zeros(n, bool) for _ in range(3))
        self._since, self._seen, self._next_since = (np.full(n, -np.inf) for _ in range(3))
        self._moves, self._tells, self._noise = 0.0, 1.0, 0.0
        self._before: Windows | None = None
        self.material = np.zeros(n, bool)
        """Windows in which material stands (n,)."""
        self.learned_s = 0.0
        """For how long the mouth has been seen to swallow, while it was learned."""

    @property
    def since(self) -> NDArray[np.float64]:
        """Since when each window shows what it shows (n,); meaningful where something stands."""
        return self._since

    @property
    def share(self) -> float:
        """Share of the mouth in which material stands."""
        return float(self.material.mean())

    @property
    def sees(self) -> bool:
        """Whether enough of the mouth shows more than noise."""
        return self._tells >= _TELL

    @property
    def swallows(self) -> bool:
        """Whether material is seen to move in the mouth."""
        return self._moves >= _SWALLOWS

    def step(self, picture: Image, time_s: float, dt: float, *, learns: bool, settled: bool) -> None:
        """The next working picture (h, w), `dt` seconds after the last.

        `learns`: whether the mouth itself is learned; `settled`: whether it is known and free, so that what stands
        for very long may be taken for it.
        """
        look = self._grid.take(picture)
        self._measure_noise(look, dt)
        now = look.now
        textured, certain = look.certain(self._noise)
        least = _SAME * certain

        def shows(of: Windows, known: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
            alike, shift = likeness(look.shifted, of)
            return known & textured & (alike >= least), shift

        same, _ = shows(self._held, self._is_held)
        same_next, _ = shows(self._next, textured)
        own, shift = shows(self._own, self._has_own)

        moving = textured & ~same & ~same_next
        self._moves += min(dt, 1.0) * (float(moving.mean()) - self._moves)
        self._tells += min(dt / _TELLS_S, 1.0) * (float(textured.mean()) - self._tells)

        self._seen[same] = time_s
        other = textured & ~same_next
        self._next[other], self._next_since[other] = now[other], time_s
        settles = same_next & ~same & (time_s - self._next_since >= SETTLES_S - 1e-6)
        self._held[settles], self._since[settles] = self._next[settles], self._next_since[settles]
        self._seen[settles] = time_s
        self._is_held |= settles
        away_s = time_s - self._seen
        self._is_held &= ~((textured & ~same & (away_s > _LOST_S)) | (away_s > _UNSEEN_S))
        seen = same | settles
        self._is_own = np.where(seen, own, self._is_own & self._is_held)
        self._follow(look.shifted[shift[own], np.flatnonzero(own)], own)
        self._learn(time_s, dt, learns=learns, settled=settled)
        self.material = self._is_held & ~self._is_own

    def _measure_noise(self, look: Look, dt: float) -> None:
        """What is seen to change least is noise, whatever its grain."""
        if self._before is not None and dt > 0.0:
            least = float(np.quantile(look.changed(self._before), _QUIETEST))
            self._noise = min(least, self._noise + dt / _NOISE_S * (least - self._noise))
        self._before = look.plain

    def _follow(self, now: NDArray[np.float32], own: NDArray[np.bool_]) -> None:
        mixed = self._own[own] + np.float32(_FOLLOWS) * (now - self._own[own])
        self._own[own] = mixed / np.maximum(np.linalg.norm(mixed, axis=1, keepdims=True), 1e-6)

    def _learn(self, time_s: float, dt: float, *, learns: bool, settled: bool) -> None:
        if not self.swallows or not (learns or settled):
            return
        if learns:
            self.learned_s += dt
        taken = self._is_held & ~self._is_own & (time_s - self._since >= (_OWN_S if learns else _BUILT_UP_S))
        self._own[taken] = self._held[taken]
        self._has_own |= taken
        self._is_own |= taken

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that changes, as plain data and copies of arrays."""
        arrays = {name: getattr(self, f"_{name}").copy() for name in _ARRAYS}
        arrays["before"] = np.zeros((0, 0), np.float32) if self._before is None else self._before.copy()
        return {
            "moves": self._moves,
            "tells": self._tells,
            "noise": self._noise,
            "learned_s": self.learned_s,
        }, arrays

    def restore(self, plain: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> None:
        """Go on from there. Raises ValueError for the state of another mouth, KeyError for none at all."""
        for name in _ARRAYS:
            own = getattr(self, f"_{name}")
            if arrays[name].shape != own.shape:
                raise ValueError(f"{name}: is of another mouth")
            own[...] = arrays[name]
        self._moves, self._tells = float(plain["moves"]), float(plain["tells"])
        self._noise, self.learned_s = float(plain["noise"]), float(plain["learned_s"])
        self._before = arrays["before"].copy() if arrays["before"].shape == self._held.shape else None
        self.material = self._is_held & ~self._is_own


_ARRAYS = ("held", "next", "own", "is_held", "has_own", "is_own", "since", "seen", "next_since")
