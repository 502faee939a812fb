"""How fast the feed moves, from the displacements of tiles: what stands, what moves, and what does not tell."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.feed.flow import TILE, Displacement, Spectra, TileFlow
from lumpwatch.models.feed.load import CoverMeter
from lumpwatch.models.roi import Image

LONGEST_S = 0.4
"""Two pictures that are compared lie no further apart."""
WANTED_PX = 4.0
"""They lie so far apart that the feed moves by about this, reduced pixels: enough to be told from standing, and little
enough to be found again."""
_MOVED = 0.27
"""Peaks of chance stay below; of tiles of noise one in a thousand is higher."""
_TOGETHER = 0.30
"""So high over the root of their number is the mean of tiles that stand, where noise hides each of them."""
_ZERO_PX = 0.3
"""A peak nearer to zero is that of something that stands, in front of what may move."""
_MOVING_SHARE, _STANDING_SHARE = 0.25, 0.5
"""Share of the covered tiles that must agree; neither may be fewer than those that say the other."""
_PLAIN = 0.03
"""What stands is material only where its contrast is not below this. Fainter texture that stands may as well be the
picture's own, such as the grid of a filmed monitor, a coder's blocks or a dirty lens, before a load too fine to be seen
to move; what is the picture's own never moves with a belt, so faint texture that moves does tell."""
_SAME = 0.05
"""Grey levels: pictures that differ by less on average are one picture, sent twice."""


class Moves(Enum):
    """What two pictures say."""

    MOVING = "moving"
    STANDING = "standing"
    UNTOLD = "untold"


@dataclass(frozen=True, slots=True)
class Motion:
    """What two pictures say of the feed."""

    moves: Moves
    velocity: NDArray[np.float64] | None = None
    """Median along x and y, working px/s (2,); None where it is not told."""
    along: float | None = None
    """Weighted median of what each tile says of the belt's speed, in units of `slope` times px/s; None where it is not
    told, and without a slope."""
    plain: bool = True
    """Whether most of the tiles that say so show plain texture: only then is what is slow material that stands."""


@dataclass(slots=True)
class _Seen:
    time_s: float
    reduced: Image
    spectra: Spectra | None = None
    until_s: float = 0.0
    """The same picture has come until then."""


class FeedMotion:
    """Compares the pictures of one region; times rise from picture to picture."""

    def __init__(self, flow: TileFlow, cover: CoverMeter, slope: NDArray[np.float64] | None = None) -> None:
        """`slope` (n, 2): what a step of one working px along x and y means on the belt, at each tile; NaN where no
        belt is seen, which leaves the tile out.
        """
        self._flow, self._cover, self._slope = flow, cover, slope
        self._seen: deque[_Seen] = deque()
        self._wanted_s = LONGEST_S
        self._cells = self._cells_of_tiles()
        self._belt = np.ones(len(flow.centres), bool) if slope is None else np.isfinite(slope).all(axis=1)

    def add(self, reduced: Image, time_s: float) -> None:
        """A new reduced picture."""
        last = self._seen[-1] if self._seen else None
        if last is not None and last.reduced.shape != reduced.shape:
            self._seen.clear()
        elif last is not None and _same(last.reduced, reduced):
            last.until_s = time_s
            return
        self._seen.append(_Seen(time_s, reduced, until_s=time_s))
        while len(self._seen) > 2 and self._seen[1].until_s < time_s - LONGEST_S - 1e-6:
            self._seen.popleft()

    def compare(self, bare_below: float) -> Motion:
        """What the newest picture says, beside an earlier one.

        Of the tiles with a contrast of `bare_below` at least; only those with that of plain texture say that it stands.
        """
        if not self._seen:
            return Motion(Moves.UNTOLD)
        newest = self._seen[-1]
        # The same picture again: a coder that sends nothing new of what stands, or a stream that falters.
        if newest.until_s > newest.time_s:
            return Motion(Moves.UNTOLD)
        voting = self._belt & self._covered(newest.reduced, bare_below)
        if not voting.any():
            return Motion(Moves.UNTOLD)
        plain = voting & self._covered(newest.reduced, max(bare_below, _PLAIN))
        before = [seen for seen in self._seen if newest.time_s - seen.until_s <= 2.0 * LONGEST_S][:-1]
        if not before:
            return Motion(Moves.UNTOLD)

        def judged(earlier: _Seen) -> tuple[Motion, float]:
            found = self._flow.between(self._spectra(earlier), self._spectra(newest))
            return self._judge(found, voting, plain, newest.time_s - earlier.until_s)

        wanted = min(before, key=lambda seen: abs(newest.time_s - seen.until_s - self._wanted_s))
        motion, fastest = judged(wanted)
        other = None
        if motion.moves is Moves.UNTOLD:
            other = before[-1]  # it may have moved out of sight
        elif fastest < 0.4 * WANTED_PX:
            other = before[0]  # the farther apart they lie, the less the camera's shaking counts
        if other is not None and other is not wanted:
            again, faster = judged(other)
            if again.moves is not Moves.UNTOLD:
                wanted, motion, fastest = other, again, faster
        if motion.moves is Moves.STANDING and wanted is before[-1] and len(before) > 1:
            # It may be the same picture, coded again: only one that stands against an earlier one, too, stands.
            motion, fastest = judged(before[-2])
            wanted = before[-2]
        lag_s = newest.time_s - wanted.until_s
        if motion.moves is Moves.UNTOLD:
            self._wanted_s = 0.5 * lag_s if lag_s > newest.time_s - before[-1].until_s else LONGEST_S
        else:
            self._wanted_s = min(lag_s * WANTED_PX / max(fastest, 0.1), LONGEST_S)
        return motion

    def _cells_of_tiles(self) -> NDArray[np.float32]:
        """1 where the middle of a cell lies in a tile (n, cells)."""
        away = np.abs(self._flow.centres[:, None] / self._flow.reduction - self._cover.middles[None])
        return np.asarray((away < TILE / 2).all(axis=2), np.float32)

    def _spectra(self, seen: _Seen) -> Spectra:
        if seen.spectra is None:
            seen.spectra = self._flow.spectra(seen.reduced)
        return seen.spectra

    def _covered(self, reduced: Image, bare_below: float) -> NDArray[np.bool_]:
        """Which tiles show material in half of their cells at least (n,)."""
        bare = (self._cover.contrast(reduced) < bare_below).ravel()
        return np.asarray(self._cells @ bare <= 0.5 * self._cells.sum(axis=1))

    def _judge(
        self, found: Displacement, voting: NDArray[np.bool_], plain: NDArray[np.bool_], lag_s: float
    ) -> tuple[Motion, float]:
        """What it says, and how far the fastest tiles have moved, reduced px."""
        at_zero = np.hypot(*found.shift.T) < _ZERO_PX
        # What stands before a belt, such as dirt on the lens, may be plainer than the belt.
        shift = np.where(at_zero[:, None] & (found.away_peak >= _MOVED)[:, None], found.away, found.shift)
        peak = np.where(at_zero & (found.away_peak >= _MOVED), found.away_peak, found.peak)
        shift, peak, count = shift.astype(float), peak.astype(float), int(voting.sum())
        moved = voting & (peak >= _MOVED) & (np.hypot(*shift.T) >= _ZERO_PX)
        still = voting & ~moved & (peak >= _MOVED)
        together = moved & _agrees(shift, peak, moved)
        least = max(_MOVING_SHARE * count, 0.5 * moved.sum(), float(still.sum()), 1.0)
        if together.sum() >= least:
            told, moves = together, Moves.MOVING
        elif (still & plain).sum() >= max(_STANDING_SHARE * count, 1.0):
            told, moves = still & plain, Moves.STANDING
        elif 2 * plain.sum() >= count and _stand_together(found.around_zero[plain]):
            nothing = None if self._slope is None else 0.0
            return Motion(Moves.STANDING, np.zeros(2), nothing), 0.0
        else:
            return Motion(Moves.UNTOLD), 0.0
        velocity = shift[told] * self._flow.reduction / lag_s
        median = np.array([_median(velocity[:, axis], peak[told]) for axis in (0, 1)])
        along = None
        if self._slope is not None:
            slope = self._slope[told]
            sure = peak[told] / np.hypot(*slope.T)
            along = _median((slope * velocity).sum(axis=1), sure)
        most = bool(2 * (told & plain).sum() >= told.sum())
        return Motion(moves, median, along, most), float(np.quantile(np.hypot(*shift[told].T), 0.9))


def _stand_together(around_zero: NDArray[np.float32]) -> bool:
    """Whether tiles (n, 3, 3) stand as a whole, though noise hides each of them."""
    return bool(around_zero.mean(axis=0).max() >= _TOGETHER / np.sqrt(len(around_zero)))


def _agrees(
    shift: NDArray[np.float64], peak: NDArray[np.float64], of: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Which tiles move roughly as most of `of` do (n,): the same way, each at its own distance from the camera."""
    if not of.any():
        return np.zeros(len(shift), bool)
    middle = np.array([_median(shift[of, axis], peak[of]) for axis in (0, 1)])
    length = float(np.hypot(*middle))
    if length < 1e-9:
        return of
    ahead = shift @ (middle / length)
    beside = np.hypot(*(shift - ahead[:, None] * middle / length).T)
    return np.asarray((ahead > 0.25 * length) & (ahead < 4.0 * length) & (beside < 0.5 * np.abs(ahead) + 0.5))


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    return float(values[order][int(np.searchsorted(sums, 0.5 * sums[-1]))])


def _same(a: Image, b: Image) -> bool:
    return cv2.norm(a, b, cv2.NORM_L1) < _SAME * a.size
