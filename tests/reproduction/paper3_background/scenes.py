"""Generated scenes with truth for each pixel, in the conditions that paper 3 names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
WIDTH, HEIGHT, FPS = 180, 120, 30
TRAINING = 100
"""Frames without objects at the start of each scene; they are not judged."""
NOISE = 3.0
"""Grey levels of camera noise."""
BACKGROUND, UNJUDGED, FOREGROUND = 0, 128, 255
ABSORBED_WITHIN = 15 * FPS
"""A change that lasts may be called foreground for so many frames; after that it is background."""
STILL_FOREGROUND = 2 * FPS
"""An object that stops is foreground for so many frames at least."""


@dataclass(frozen=True)
class Scene:
    """Pictures with their truth."""

    pictures: NDArray[np.uint8]
    """BGR (n, h, w, 3)."""
    truth: NDArray[np.uint8]
    """BACKGROUND, UNJUDGED or FOREGROUND (n, h, w)."""
    changes: tuple[tuple[str, int, NDArray[np.bool_]], ...] = ()
    """Once-off changes: what, from which frame, which pixels (h, w)."""


@dataclass
class _Mover:
    """A textured ellipse that crosses the picture, or stops in it from `stops` to `leaves`."""

    texture: Float
    shape: NDArray[np.bool_]
    start: Float
    velocity: Float
    appears: int
    stops: int = 10**9
    leaves: int = 10**9

    def corner(self, frame: int) -> NDArray[np.intp]:
        """Top left corner x, y."""
        moving = min(frame, self.stops) - self.appears + max(frame - self.leaves, 0)
        return np.round(self.start + moving * self.velocity).astype(np.intp)


def _texture(rng: np.random.Generator, shape: tuple[int, int], grain: float, contrast: float) -> Float:
    """Coloured noise of mean zero."""
    raw = cv2.GaussianBlur(rng.normal(size=(*shape, 3)), (0, 0), grain)
    gray = cv2.GaussianBlur(rng.normal(size=(*shape, 1)), (0, 0), grain)
    field = 0.5 * raw / raw.std() + (gray / gray.std())[..., np.newaxis]
    return contrast * field


def _place(rng: np.random.Generator) -> Float:
    """An empty place: colour, coarse and fine texture (h, w, 3)."""
    base = rng.uniform(80, 140, 3)
    shape = (HEIGHT, WIDTH)
    return np.clip(base + _texture(rng, shape, 12.0, 18.0) + _texture(rng, shape, 1.2, 8.0), 20, 210)


def _mover(rng: np.random.Generator, appears: int, around: float = 110.0) -> _Mover:
    """An object that crosses from left or right; its colour differs from mid grey by 35 or more."""
    w, h = int(rng.integers(14, 30)), int(rng.integers(14, 30))
    gap = rng.uniform(-1.0, 1.0, 3)
    gap *= rng.uniform(60, 110) / np.linalg.norm(gap)
    texture = np.clip(around + gap + _texture(rng, (h, w), 2.0, 6.0), 0, 255)
    shape = np.zeros((h, w), np.uint8)
    cv2.ellipse(shape, (w // 2, h // 2), (w // 2 - 1, h // 2 - 1), 0, 0, 360, 1, -1)
    rightward = rng.random() < 0.5
    speed = rng.uniform(1.0, 3.5)
    start = np.array([-w if rightward else WIDTH, rng.uniform(5, HEIGHT - h - 5)])
    return _Mover(texture, shape > 0, start, np.array([speed if rightward else -speed, 0.0]), appears)


def _traffic(rng: np.random.Generator, frames: int) -> list[_Mover]:
    """Somebody comes every 1 to 2.5 seconds after the training."""
    movers, appears = [], TRAINING
    while appears < frames:
        movers.append(_mover(rng, appears))
        appears += int(rng.integers(FPS, 5 * FPS // 2))
    return movers


def _paste(picture: Float, covered: NDArray[np.bool_], mover: _Mover, frame: int) -> NDArray[np.bool_]:
    """Draw a mover into picture and cover; the pixels (h, w) that it takes."""
    taken = np.zeros((HEIGHT, WIDTH), np.bool_)
    if frame < mover.appears:
        return taken
    x, y = mover.corner(frame)
    h, w = mover.shape.shape
    left, top, right, bottom = max(x, 0), max(y, 0), min(x + w, WIDTH), min(y + h, HEIGHT)
    if left >= right or top >= bottom:
        return taken
    inner = (slice(top - y, bottom - y), slice(left - x, right - x))
    taken[top:bottom, left:right] = mover.shape[inner]
    picture[taken] = mover.texture[inner][mover.shape[inner]]
    covered |= taken
    return taken


def _film(
    rng: np.random.Generator, places: Iterator[Float], frames: int, movers: list[_Mover], light: Float,
    shade: float = 1.0,
) -> Scene:  # fmt: skip
    """Draw places, shadows, movers, light (frames,) and noise."""
    pictures = np.empty((frames, HEIGHT, WIDTH, 3), np.uint8)
    truth = np.zeros((frames, HEIGHT, WIDTH), np.uint8)
    changes: list[tuple[str, int, NDArray[np.bool_]]] = []
    for frame, place in zip(range(frames), places, strict=False):
        picture, covered = place.copy(), np.zeros((HEIGHT, WIDTH), np.bool_)
        if shade < 1.0:
            cast = np.zeros((HEIGHT, WIDTH), np.bool_)
            for mover in movers:
                _paste(place.copy(), cast, mover, frame)
            # Light from the upper left: the shadow lies to the lower right, with soft edges.
            moved = np.roll(cast, (5, 9), (0, 1)).astype(np.float64)
            picture *= 1.0 - (1.0 - shade) * cv2.GaussianBlur(moved, (0, 0), 1.0)[..., np.newaxis]
        unjudged = np.zeros((HEIGHT, WIDTH), np.bool_)
        settled = np.zeros((HEIGHT, WIDTH), np.bool_)
        for mover in movers:
            taken = _paste(picture, covered, mover, frame)
            standing = frame - mover.stops
            if frame == mover.stops:
                changes.append(("stops", frame, taken))
            if frame == mover.leaves:
                changes.append(("leaves", frame, taken))
            if frame < mover.leaves and standing >= ABSORBED_WITHIN:
                settled |= taken
            elif frame < mover.leaves and standing >= STILL_FOREGROUND:
                unjudged |= taken
            else:
                settled &= ~taken
                unjudged &= ~taken
        truth[frame][covered] = FOREGROUND
        truth[frame][unjudged] = UNJUDGED
        truth[frame][settled] = BACKGROUND
        noisy = picture * light[frame] + rng.normal(0.0, NOISE, picture.shape)
        pictures[frame] = np.clip(np.round(noisy), 0, 255)
    truth[:TRAINING] = UNJUDGED
    return Scene(pictures, truth, tuple(changes))


def _still(place: Float) -> Iterator[Float]:
    while True:
        yield place


def plain(seed: int) -> Scene:
    """Nothing but camera noise and moving objects."""
    rng = np.random.default_rng([seed, 1])
    frames = TRAINING + 300
    return _film(rng, _still(_place(rng)), frames, _traffic(rng, frames), np.ones(frames))


def waving(seed: int) -> Scene:
    """Foliage waves in two fifths of the picture; objects pass in front of it and beside it."""
    rng = np.random.default_rng([seed, 2])
    frames = TRAINING + 400
    place = _place(rng)
    return _film(rng, _waving(rng, place), frames, _traffic(rng, frames), np.ones(frames))


def _waving(rng: np.random.Generator, place: Float) -> Iterator[Float]:
    leaves = np.clip(rng.uniform(70, 130, 3) + _texture(rng, (HEIGHT, WIDTH), 2.0, 22.0), 10, 230)
    left = int(rng.integers(0, WIDTH - 72))
    grid_x, grid_y = np.meshgrid(np.arange(WIDTH, dtype=np.float32), np.arange(HEIGHT, dtype=np.float32))
    phase = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), 10.0)
    phase = (3.0 * phase / phase.std()).astype(np.float32)
    reach, hertz = rng.uniform(2.0, 3.5), rng.uniform(0.6, 1.2)
    wind, frame = 0.0, 0
    while True:
        wind = 0.97 * wind + 0.24 * float(rng.normal())  # gusts: standard deviation about 1
        strength = reach * (1.0 + 0.3 * wind)
        t = 2.0 * np.pi * hertz * frame / FPS
        shift_x = (strength * np.sin(t + phase)).astype(np.float32)
        shift_y = (0.4 * strength * np.sin(1.7 * t + phase)).astype(np.float32)
        moved = cv2.remap(
            leaves, grid_x + shift_x, grid_y + shift_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        shown = place.copy()
        shown[:, left : left + 72] = moved[:, left : left + 72]
        frame += 1
        yield shown


def gradual(seed: int) -> Scene:
    """The light falls to 60 % within ten seconds, and rises again."""
    rng = np.random.default_rng([seed, 3])
    frames = TRAINING + 600
    light = np.interp(np.arange(frames), [TRAINING, TRAINING + 300, frames], [1.0, 0.6, 1.0])
    return _film(rng, _still(_place(rng)), frames, _traffic(rng, frames), light)


def sudden(seed: int) -> Scene:
    """A light goes on: all at once everything is 40 % brighter."""
    rng = np.random.default_rng([seed, 4])
    frames, on = TRAINING + 800, TRAINING + 100
    light = np.where(np.arange(frames) < on, 0.8, 1.12)
    scene = _film(rng, _still(_place(rng)), frames, _traffic(rng, frames), light)
    return Scene(scene.pictures, scene.truth, (("light", on, np.ones((HEIGHT, WIDTH), np.bool_)),))


def stopped(seed: int) -> Scene:
    """An object stops for 25 seconds and leaves; others pass behind and before it."""
    rng = np.random.default_rng([seed, 5])
    frames = TRAINING + 1200
    standing = _mover(rng, TRAINING + 20)
    standing.stops = standing.appears + round(0.5 * WIDTH / abs(standing.velocity[0]))
    standing.leaves = standing.stops + 25 * FPS
    movers = [standing, *_traffic(rng, frames)]
    return _film(rng, _still(_place(rng)), frames, movers, np.ones(frames))


def shadows(seed: int) -> Scene:
    """Objects cast shadows that take 40 % of the light; shadows are background."""
    rng = np.random.default_rng([seed, 6])
    frames = TRAINING + 300
    return _film(rng, _still(_place(rng)), frames, _traffic(rng, frames), np.ones(frames), shade=0.6)


SCENES: dict[str, Callable[[int], Scene]] = {
    "plain": plain,
    "waving": waving,
    "gradual": gradual,
    "sudden": sudden,
    "stopped": stopped,
    "shadows": shadows,
}
