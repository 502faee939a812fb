"""Which windows of a mouth show material that stands, and since when.

A window that shows the same for a while is *held*. It stays held while something passes in front of it: what passes
does not stand, and what was behind it comes back. What stood while the mouth swallowed, from the beginning, is the
mouth itself and no material.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.mouth.patches import SIDE, Band, Look, PatchGrid, Windows
from lumpwatch.models.roi import Image

SETTLES_S = 2.0
"""What shows the same for so long stands: by then slow material has left the reach of a camera that shakes."""
_SAME, _LEAST_SAME = 0.75, 0.57
"""Windows that are more alike than the first, times the share of them that is no noise, show the same. Chance stays
below the second, over some looks."""
_LOOKS_S = 0.5
"""Likeness is averaged over about this time: a single look is noise."""
_AVERAGED = 8
"""So many looks are averaged for what a window shows: their noise goes, and what stands stays."""
_LOST_S, _UNSEEN_S = 1.5, 30.0
"""What stood is forgotten when something else is seen in its place for so long, or nothing for much longer."""
_LATELY_S = 1.0
"""What was seen so lately is seen."""
_OWN_S = 4.0
"""What stands for so long while the mouth is learned is the mouth itself."""
_BUILT_UP_S = 600.0
"""So is what stands later for so long while the mouth swallows: dirt that has built up, a new liner."""
_FOLLOWS = 0.01
"""How much of the present picture is taken into that of the mouth itself with each look: its light changes."""
_QUIETEST, _NOISE_S = 0.05, 10.0
"""The noise is what the quietest windows change by, the least over about this time: there some stand now and then."""
_REPEATED = 0.3
"""A picture that differs from the last by less than this share of its own noise is the last one."""
_SWALLOWS = 0.05
"""Share of the windows that must change for the mouth to be seen to swallow."""
_TELLS = 0.5
"""A window of which less than this share is no noise tells nothing."""
_QUIET, _MOST_LOOKS = 1.25, 4.0
"""Grey levels of noise from which on looks are averaged, as many as it is times that, and how many at most."""
_COARSEST = 3.5
"""Noise of a coarse grain is at most so many times what it is told from one picture: more is movement."""
_TELL, _CLEAR, _TELLS_S = 0.15, 0.7, 2.0
"""Share of the windows that must show anything, over about this time, for the mouth to be seen at all, and clearly."""


class Standing:
    """The windows of one mouth; times rise."""

    def __init__(self, grid: PatchGrid) -> None:
        self._grid, n = grid, len(grid)
        self._held = np.zeros((n, SIDE * SIDE), np.float32)
        self._next = np.zeros_like(self._held)
        self._own = np.zeros_like(self._held)
        self._is_held, self._has_own, self._is_own = (np.zeros(n, bool) for _ in range(3))
        self._since, self._seen, self._next_since = (np.full(n, -np.inf) for _ in range(3))
        self._like_held, self._like_next, self._like_own, self._looks = (
            np.zeros(n, np.float32) for _ in range(4)
        )
        self._moves, self._tells, self._noise = 0.0, 1.0, 0.0
        self._before: Windows | None = None
        self._mean: NDArray[np.float32] | None = None
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
        return float(self._grid.weight @ self.material)

    def seen_share(self, time_s: float) -> float:
        """Share of the mouth in which material was seen to stand of late: neither dust nor what passes hides it."""
        return float(self._grid.weight @ (self.material & (time_s - self._seen <= _LATELY_S)))

    @property
    def sees(self) -> bool:
        """Whether enough of the mouth shows more than noise."""
        return self._tells >= _TELL

    @property
    def clear(self) -> bool:
        """Whether most of the mouth shows more than noise."""
        return self._tells >= _CLEAR

    @property
    def moves(self) -> float:
        """Share of the mouth in which something moves, over about a second."""
        return self._moves

    @property
    def swallows(self) -> bool:
        """Whether material is seen to move in the mouth."""
        return self._moves >= _SWALLOWS

    def step(self, picture: Image, time_s: float, dt: float, *, learns: bool, settled: bool) -> None:
        """The next working picture (h, w), `dt` seconds after the last.

        `learns`: whether the mouth itself is learned; `settled`: whether it is known and free, so that what stands
        for very long may be taken for it.
        """
        band = self._grid.band(picture)
        self._measure_noise(band, dt)
        look, shows, textured, certain = self._look(band)
        least = np.maximum(_SAME * certain, _LEAST_SAME).astype(np.float32)
        (held, _), (following, shift_next), (own, shift_own) = look.likeness(
            self._held, self._next, self._own
        )
        moving = textured & ~(self._is_held & (held >= least)) & (following < least)
        self._moves += min(dt, 1.0) * (float(self._grid.weight @ moving) - self._moves)
        self._tells += min(dt / _TELLS_S, 1.0) * (float(self._grid.weight @ textured) - self._tells)

        new = min(dt / _LOOKS_S, 1.0)
        for smooth, alike in ((self._like_held, held), (self._like_next, following), (self._like_own, own)):
            smooth[shows] += np.float32(new) * (alike - smooth)[shows]
        same = self._is_held & shows & (self._like_held >= least)
        same_next = shows & (self._like_next >= least)
        is_own = self._has_own & shows & (self._like_own >= least)

        self._seen[same] = time_s
        other = textured & ~same_next
        self._next[other], self._next_since[other] = look.now[other], time_s
        self._like_next[other], self._looks[other] = 1.0, 1.0
        self._average(look, shift_next, same_next & (following >= 0.5 * least))
        settles = same_next & ~same & (time_s - self._next_since >= SETTLES_S - 1e-6)
        self._held[settles], self._since[settles] = self._next[settles], self._next_since[settles]
        self._like_held[settles] = self._like_next[settles]
        self._seen[settles] = time_s
        self._is_held |= settles
        away_s = time_s - self._seen
        self._is_held &= ~((textured & ~same & (away_s > _LOST_S)) | (away_s > _UNSEEN_S))
        seen = same | settles
        self._is_own = np.where(seen, is_own, self._is_own & self._is_held)
        follows = is_own & (own >= least)
        self._follow(look.moved(np.flatnonzero(follows), shift_own[follows]), follows)
        self._learn(time_s, dt, learns=learns, settled=settled)
        self.material = self._is_held & ~self._is_own

    def _average(self, look: Look, shift: NDArray[np.intp], same: NDArray[np.bool_]) -> None:
        """Take the look into what those windows show, where they show it; not at the end of the reach, where what is
        slow would be followed.
        """
        taken = np.flatnonzero(same & ~look.at_reach[shift])
        looks = self._looks[taken]
        mixed = (
            self._next[taken] + (look.moved(taken, shift[taken]) - self._next[taken]) / (looks + 1.0)[:, None]
        )
        self._next[taken] = _of_length_one(mixed)
        self._looks[taken] = np.minimum(looks + 1.0, _AVERAGED)

    def _look(self, band: Band) -> tuple[Look, NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float32]]:
        """The present look, which windows may show anything (n,), which show more than noise (n,), and the share of
        each that is no noise (n,): so alike are two of the same thing.

        The noisier the camera, the more looks are averaged. What moves is lost in them, and then no longer the same.
        """
        noise = min(max(self._noise, band.noise), _COARSEST * band.noise)
        new = 2.0 / (1.0 + min(max(noise / _QUIET, 1.0), _MOST_LOOKS))
        if self._mean is None or new == 1.0:
            self._mean = band.picture
        else:
            self._mean = self._mean + np.float32(new) * (band.picture - self._mean)
        look = self._grid.take(self._mean)
        share = 1.0 - (noise * np.sqrt(new / (2.0 - new)) / np.maximum(look.deviation, 1e-6)) ** 2
        alone = 1.0 - (noise / np.maximum(band.deviation, 1e-6)) ** 2
        shows = np.maximum(band.deviation, look.deviation) >= band.faint
        textured = shows & (np.maximum(share, alone) >= _TELLS)
        return look, shows, textured, np.clip(share, _TELLS, 1.0).astype(np.float32)

    def _measure_noise(self, band: Band, dt: float) -> None:
        """What is seen to change least is noise, whatever its grain."""
        if self._before is not None and dt > 0.0:
            least = float(np.quantile(band.changed(self._before), _QUIETEST))
            if least < _REPEATED * band.noise:
                return  # streams send the same picture twice at times, and that says nothing of the noise
            slowly = self._noise + dt / _NOISE_S * (least - self._noise)
            self._noise = min(least, slowly) if self._noise > 0.0 else least
        self._before = band.plain

    def _follow(self, now: NDArray[np.float32], own: NDArray[np.bool_]) -> None:
        mixed = self._own[own] + np.float32(_FOLLOWS) * (now - self._own[own])
        self._own[own] = _of_length_one(mixed)

    def _learn(self, time_s: float, dt: float, *, learns: bool, settled: bool) -> None:
        if not self.swallows or not (learns or settled):
            return
        if learns:
            self.learned_s += dt
        taken = self._is_held & ~self._is_own & (time_s - self._since >= (_OWN_S if learns else _BUILT_UP_S))
        self._own[taken], self._like_own[taken] = self._held[taken], self._like_held[taken]
        self._has_own |= taken
        self._is_own |= taken

    def state(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """All that changes, as plain data and copies of arrays."""
        arrays = {name: getattr(self, f"_{name}").copy() for name in _ARRAYS}
        for name, array in (("before", self._before), ("mean", self._mean)):
            arrays[name] = np.zeros((0, 0), np.float32) if array is None else array.copy()
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
        self._mean = arrays["mean"].copy() if arrays["mean"].size else None
        self.material = self._is_held & ~self._is_own


def _of_length_one(windows: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(windows / np.maximum(np.linalg.norm(windows, axis=1, keepdims=True), 1e-6), np.float32)


_ARRAYS = (
    *("held", "next", "own", "is_held", "has_own", "is_own", "since", "seen", "next_since"),
    *("like_held", "like_next", "like_own", "looks"),
)
