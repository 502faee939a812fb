"""The kernel against a slow reading of the papers' equations, one pixel at a time in double precision."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from lumpwatch.models.trackers.background import BackgroundOptions, StatisticalBackground

Vector = tuple[int, ...]
SHAPE = (4, 5)
REACH = 10.0
FIXED = {
    "least_change": REACH,
    "largest_change": REACH,
    "largest_light": 0.0,
    "least_area": 1,
    "learn_every": 1,
    "darkest_shadow": 1.0,
}
"""Limits of change that do not depend on the picture, and no region too small."""


@dataclass
class Entry:
    v: Vector
    p: float
    p_b: float
    """Conditional on the background."""


@dataclass
class Table:
    """Eq. 5 and 6 with conditional probabilities; `update` learns a frame."""

    used: int
    kept: int
    prior: float = 0.0
    entries: list[Entry] = field(default_factory=list)

    def probabilities(self, same: list[bool]) -> tuple[float, float]:
        """P(v) and P(v|b) by Eq. 15 and 16."""
        chosen = [
            e for e, is_same in zip(self.entries[: self.used], same[: self.used], strict=True) if is_same
        ]
        return sum(e.p for e in chosen), sum(e.p_b for e in chosen)

    def update(self, v: Vector, same: list[bool], alpha: float, background: bool) -> None:
        """Eq. 10 and 11. What it estimates is the joint p_b^i p(b): hence from the conditional to it and back."""
        joints = [e.p_b * self.prior * (1 - alpha) for e in self.entries]
        self.prior = (1 - alpha) * self.prior + alpha * background
        for e in self.entries:
            e.p *= 1 - alpha
        if any(same):
            at = same.index(True)
            self.entries[at].p += alpha
            joints[at] += alpha * background
        else:
            if len(self.entries) == self.kept:
                self.entries.pop()
                joints.pop()
            self.entries.append(Entry(v, alpha, 0.0))
            joints.append(alpha * background)
        for e, joint in zip(self.entries, joints, strict=True):
            e.p_b = joint / self.prior if joint else 0.0
        self.entries.sort(key=lambda e: -e.p)

    def is_replaced(self, share: float) -> bool:
        """Eq. 13."""
        first = self.entries[: self.used]
        return sum(e.p for e in first) - self.prior * sum(e.p_b for e in first) > share

    def turn(self, keep: bool) -> None:
        """Eq. 14, or everything for background."""
        for e in self.entries:
            e.p_b = e.p if keep else (e.p - self.prior * e.p_b) / (1 - self.prior)
        self.prior = 1.0 if keep else 1 - self.prior


def normalised(u: Vector, v: Vector, delta: float, floor: float) -> bool:
    """Eq. 8, or closer than the noise floor."""
    a, b = np.array(u, float), np.array(v, float)
    if (a == b).all() or ((a - b) ** 2).sum() < floor**2 * len(a):
        return True
    # Eq. 8 with the floor added to what is allowed, multiplied out.
    return bool((a @ a + b @ b) - 2 * (a @ b) < delta * (a @ a + b @ b) + floor**2 * len(a))


class Pixel:
    """The whole of section II for one pixel."""

    def __init__(self, first: Vector, options: BackgroundOptions) -> None:
        self.o = options
        self.background = np.array(first, float)
        self.previous = np.array(first)
        self.colour = Table(options.static_used, options.static_kept)
        self.gradient = Table(options.static_used, options.static_kept)
        self.pair = Table(options.dynamic_used, options.dynamic_kept)
        self.frame = 0

    def judge(self, now: Vector, sobel: tuple[int, int]) -> bool:
        """Whether it is background; learned."""
        o = self.o
        picture = np.array(now)
        differs = bool((np.abs(picture - self.background) > REACH).any())
        moved = bool((np.abs(picture - self.previous) > REACH).any())
        unchanged = not differs and not (moved and o.rule == "paper")
        starting = self.frame < o.initial_frames
        alpha = o.initial_rate if starting else o.learning_rate
        static_bits = 256 // o.static_levels
        c = tuple(int(value) // static_bits for value in now)
        e = tuple(int(np.clip(value // 8, -128, 127)) // static_bits for value in sobel)
        floor = o.noise_floor / static_bits
        same_c = [normalised(c, entry.v, o.static_distance, floor) for entry in self.colour.entries]
        same_e = [normalised(e, entry.v, o.static_distance, floor) for entry in self.gradient.entries]
        (p_c, p_cb), (p_e, p_eb) = self.colour.probabilities(same_c), self.gradient.probabilities(same_e)
        static_says = 2 * p_cb * p_eb * self.colour.prior > p_c * p_e
        if moved and not unchanged:
            step = 256 // o.dynamic_levels
            v = tuple(int(value) // step for value in (*now, *self.previous))
            same = [
                max(abs(a - b) for a, b in zip(v, entry.v, strict=True)) <= o.dynamic_distance
                for entry in self.pair.entries
            ]
            p, p_b = self.pair.probabilities(same)
            background = starting or 2 * p_b * self.pair.prior > p or (o.rule == "either" and static_says)
            self.pair.update(v, same, alpha, background)
            if not background and self.pair.is_replaced(o.once_off_share):
                self.pair.turn(o.once_off == "keep")
        else:
            background = starting or unchanged or static_says
            self.colour.update(c, same_c, alpha, background)
            self.gradient.update(e, same_e, alpha, background)
            if not background and all(t.is_replaced(o.once_off_share) for t in (self.colour, self.gradient)):
                self.colour.turn(o.once_off == "keep")
                self.gradient.turn(o.once_off == "keep")
        if background:
            beta = o.background_rate if unchanged else 1.0
            self.background += beta * (picture - self.background)
        self.previous = picture
        self.frame += 1
        return background


def blinking(seed: int, frames: int) -> NDArray[np.uint8]:
    """Pictures whose pixels go among a few colours, with long stays, and have a little noise."""
    rng = np.random.default_rng(seed)
    palette = rng.integers(10, 245, (6, 3))
    at = rng.integers(0, 6, SHAPE)
    pictures = []
    for frame in range(frames):
        jump = rng.random(SHAPE) < (0.25 if frame // 40 % 2 else 0.03)
        at = np.where(jump, rng.integers(0, 6, SHAPE), at)
        pictures.append(palette[at] + rng.integers(-4, 5, (*SHAPE, 3)))
    return np.array(pictures).astype(np.uint8)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"rule": "paper", "once_off": "swap", "noise_floor": 0.0},
        {"once_off": "swap", "learning_rate": 0.08, "initial_frames": 3},
        {"learning_rate": 0.2, "initial_rate": 0.3, "initial_frames": 0, "rule": "paper"},
        {"static_used": 2, "static_kept": 3, "dynamic_used": 2, "dynamic_kept": 4, "learning_rate": 0.1},
        {"static_levels": 64, "dynamic_levels": 64, "learning_rate": 0.1, "initial_frames": 5},
        {"learning_rate": 0.45, "initial_frames": 2},  # gains pass their limit several times
    ],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_kernel_agrees_with_the_equations(options: dict[str, object], seed: int) -> None:
    """Same masks in every frame, same probabilities and background picture at the end."""
    chosen = BackgroundOptions(**(FIXED | options))  # type: ignore[arg-type]
    pictures = blinking(seed, 150)
    model = StatisticalBackground(chosen)
    pixels = {
        (y, x): Pixel(tuple(pictures[0, y, x]), chosen) for y in range(SHAPE[0]) for x in range(SHAPE[1])
    }
    seen_foreground = 0
    for picture in pictures:
        dx, dy = cv2.spatialGradient(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))
        mask = model.apply(picture)
        for (y, x), pixel in pixels.items():
            background = pixel.judge(tuple(picture[y, x].tolist()), (int(dx[y, x]), int(dy[y, x])))
            assert (mask[y, x] == 0) == background
        seen_foreground += int((mask == 255).sum())
    assert seen_foreground > 50
    state = model.state()
    for (y, x), pixel in pixels.items():
        gain = {kind: state[f"{kind}_gain"][y, x] for kind in ("static", "dynamic")}
        for kind, k, table in (
            ("static", 0, pixel.colour),
            ("static", 1, pixel.gradient),
            ("dynamic", 0, pixel.pair),
        ):
            assert state[f"{kind}_prior"][y, x] / gain[kind] == pytest.approx(table.prior, abs=1e-5)
            n = len(table.entries)
            for name, expected in (
                ("p", [e.p for e in table.entries]),
                ("joint", [e.p_b * table.prior for e in table.entries]),
            ):
                values = state[f"{kind}.{name}"][y, :n, x, k] / gain[kind]
                assert values == pytest.approx(expected, abs=1e-5)
        assert state["background"][y, x] == pytest.approx(pixel.background, abs=1e-2)
