"""The crusher's mouth under the lip: material that lies in it, sinks as it is crushed, and bridges.

The mouth has two parts beside each other: the part that bridges, of `bridge_width`, and the rest. What happens is
worked out in steps of time from the beginning on, so it does not depend on when it is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.simulator.gaps import Gaps
from lumpwatch.service.simulator.geometry import Geometry
from lumpwatch.service.simulator.motion import BeltMotion
from lumpwatch.service.simulator.noise import Field, smooth_noise
from lumpwatch.service.simulator.spec import FeedSpec

_STREAM, _LOOK = 22, 23
_STEP_S = 0.05
_FASTER = 10.0
"""A bridge that breaks goes through so many times faster than the mouth fills."""
_LEAST = 0.3
"""What is left in the mouth is drawn at this share of the feed's rate at least."""
_ROUGH_PX = 0.012
"""How rough the surface of the material is, in heights of the picture."""
_PERIOD = 1024


@dataclass(frozen=True, slots=True)
class MouthTruth:
    """What the mouth does at a moment."""

    level: float
    """How high material lies in it on average, as a share of its height."""
    standing: float
    """Share of it in which material stands."""
    bridged: bool
    hesitates: bool
    """Whether it holds back for a moment, as it does in normal crushing."""


@dataclass(frozen=True, slots=True)
class Bridge:
    """One that formed; seconds from the start of the feed."""

    from_s: float
    until_s: float


@dataclass(slots=True)
class _Part:
    share: float
    level: float
    sunk: float = 0.0
    stands: bool = False


class Mouth:
    """The mouth of one feed."""

    def __init__(self, spec: FeedSpec, geometry: Geometry, belt: BeltMotion, gaps: Gaps, bed: Field) -> None:
        """`bed` is the ore from above, `spec.belt_width_mm` wide."""
        self._spec, self._belt, self._gaps = spec, belt, gaps
        self._lip, self._rim = round(geometry.lip_row), geometry.rim_row
        left, _, scale = geometry.project(-geometry.belt_width_mm / 2, geometry.belt_length_mm)
        right = 2 * geometry.cu - left
        self._left, self._right = max(round(left), 0), min(round(right), spec.width)
        self._lip_mm = geometry.belt_length_mm
        self._rng = np.random.default_rng([spec.seed, _STREAM])
        self._parts = [
            _Part(spec.bridge_width, spec.mouth_level),
            _Part(1 - spec.bridge_width, spec.mouth_level),
        ]
        self.bridges: list[Bridge] = []
        """Those that have formed so far."""
        self._next_bridge = self._drawn(spec.bridge_every_s)
        self._next_rest = self._drawn(spec.hesitate_every_s)
        self._rest_until = 0.0
        self._history: list[tuple[float, ...]] = []
        self._row()
        look = np.random.default_rng([spec.seed, _LOOK])
        self._from = self._left + round(
            float(look.uniform(0, 1 - spec.bridge_width)) * (self._right - self._left)
        )
        self._prepare(bed, scale, look)

    @property
    def any(self) -> bool:
        """Whether anything ever lies in it."""
        return self._spec.mouth_level > 0 or self._spec.bridge_every_s > 0

    def at(self, t: float) -> MouthTruth:
        """What it does at time t."""
        row = self._at(t)
        share = self._parts[0].share
        still = row[4] * row[0] * share + row[5] * row[2] * (1 - share)
        return MouthTruth(
            level=row[0] * share + row[2] * (1 - share),
            standing=float(still),
            bridged=any(bridge.from_s <= t < bridge.until_s for bridge in self.bridges),
            hesitates=bool(row[6]),
        )

    def draw(self, canvas: NDArray[np.uint8], t: float) -> None:
        """Draw what lies in it at time t over the (h, w) canvas: in front of what falls behind it."""
        row = self._at(t)
        spec = self._spec
        width = round(spec.bridge_width * (self._right - self._left))
        inside = np.arange(self._left, self._right)
        bridges = (inside >= self._from) & (inside < self._from + width)
        for level, sunk, columns in (
            (row[0], row[1], inside[bridges]),
            (row[2], row[3], inside[~bridges]),
        ):
            if level > 0 and len(columns):
                self._draw_part(canvas, level, sunk, columns)

    def _draw_part(
        self, canvas: NDArray[np.uint8], level: float, sunk: float, columns: NDArray[np.intp]
    ) -> None:
        height = self._rim - self._lip
        rows = np.arange(self._lip, self._rim)
        down = sunk * height
        whole = int(np.floor(down))
        part = np.float32(down - whole)
        # The surface is rough where the ore is, and moves with it.
        rough = self._rough[(int(self._rim - level * height) - whole) % _PERIOD, columns]
        top = self._rim - level * height + np.minimum(rough, level * height)
        above = self._ore[(rows - whole) % _PERIOD][:, columns]
        before = self._ore[(rows - whole - 1) % _PERIOD][:, columns]
        ore = (1 - part) * above + part * before
        cover = np.clip(rows[:, None] + 0.5 - top[None] + 0.5, 0, 1).astype(np.float32)
        window = canvas[self._lip : self._rim]
        behind = window[:, columns]
        window[:, columns] = np.round(behind + cover * (ore - behind)).astype(np.uint8)

    def _prepare(self, bed: Field, scale: float, rng: np.random.Generator) -> None:
        texel = self._spec.belt_width_mm / bed.shape[1]
        size = (max(round(bed.shape[1] * texel * scale), 1), max(round(bed.shape[0] * texel * scale), 1))
        ore = np.asarray(cv2.resize(bed, size, interpolation=cv2.INTER_AREA), np.float32)
        ore = np.tile(ore, (_PERIOD // len(ore) + 1, 1))[:_PERIOD]
        x = np.clip(np.arange(self._spec.width) - self._left, 0, ore.shape[1] - 1)
        self._ore = ore[:, x] * np.float32(1.1)
        rough = smooth_noise(rng, (_PERIOD, self._spec.width), 6.0)
        self._rough = _ROUGH_PX * self._spec.height * rough

    def _at(self, t: float) -> tuple[float, ...]:
        at = max(t, 0.0) / _STEP_S
        k = int(at)
        while len(self._history) < k + 2:
            self._advance()
        before, after, part = self._history[k], self._history[k + 1], at - k
        moved = tuple(a + part * (b - a) for a, b in zip(before[:4], after[:4], strict=True))
        return (*moved, *after[4:])

    def _advance(self) -> None:
        spec, t = self._spec, (len(self._history) - 1) * _STEP_S
        flow = self._flow(t)
        if flow > 0.5 and not self._bridged(t):
            self._next_bridge -= _STEP_S
            self._next_rest -= _STEP_S
        if spec.bridge_every_s and self._next_bridge <= 0:
            self.bridges.append(Bridge(t, t + spec.bridge_duration_s))
            self._next_bridge = self._drawn(spec.bridge_every_s)
        if spec.hesitate_every_s and self._next_rest <= 0:
            self._rest_until = t + float(self._rng.uniform(0.2, 1.0)) * spec.hesitate_longest_s
            self._next_rest = self._drawn(spec.hesitate_every_s)
        rests = t < self._rest_until
        for i, part in enumerate(self._parts):
            self._crush(part, flow, holds=rests or (i == 0 and self._bridged(t)))
        self._row(rests=rests)

    def _crush(self, part: _Part, flow: float, *, holds: bool) -> None:
        usual, step = self._spec.mouth_level, _STEP_S / self._spec.mouth_fill_s
        drawn = 0.0
        if not holds and part.level > 0:
            drawn = _FASTER if part.level > usual + 0.05 else max(part.level / max(usual, 1e-6), _LEAST)
            drawn = min(drawn * step, part.level)
        fills = flow * step if usual > 0 or holds else 0.0
        part.stands = holds and part.level > 0
        part.level = min(part.level + fills - drawn, 1.0)
        part.sunk += drawn

    def _flow(self, t: float) -> float:
        """What comes over the lip, as a share of the full feed."""
        cover = float(self._gaps.cover(np.array([self._belt.distance(t) - self._lip_mm]))[0])
        return cover * self._belt.speed(t) / self._belt.full_speed_mm_s

    def _bridged(self, t: float) -> bool:
        return bool(self.bridges) and t < self.bridges[-1].until_s

    def _row(self, *, rests: bool = False) -> None:
        a, b = self._parts
        self._history.append(
            (a.level, a.sunk, b.level, b.sunk, float(a.stands), float(b.stands), float(rests))
        )

    def _drawn(self, every: float) -> float:
        return 0.25 * every + float(self._rng.exponential(0.75 * every)) if every else 0.0
