"""A strip that scrolls under a camera at constant speed: video, labels and truth.

Light that changes, a shadow that stands, dust that drifts, noise and a little shake of the camera; all drawn from
the seed. The same feed and seed give the same bytes.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.service.core.video_writer import VideoWriter
from tests.reproduction.real.ore import Image, rounded
from tests.reproduction.real.strip import Body, Strip
from tests.reproduction.real.view import Matrix, View, fineness, project

UNCLEAR = 0.8
"""From this share of the limit on a rock may be taken for a lump: an alarm for it is not held against anyone."""
_SHOWS = 0.5
_BANK, _MARGIN = 6, 48


@dataclass(frozen=True, slots=True)
class Air:
    """Light, lens and air."""

    gain: float = 1.0
    flicker: float = 0.12
    """Slow changes of light, share."""
    contrast: float = 1.0
    shadow: float = 0.0
    """Of a beam over the belt: how much light it takes."""
    vignette: float = 0.15
    blur: float = 0.6
    noise: float = 3.0
    shake_px: float = 0.4
    dust: float = 0.0
    grey: bool = False
    crf: int = 26


@dataclass(frozen=True, slots=True)
class Scene:
    """A strip under a camera."""

    view: View
    strip: Strip
    limit: float
    """Size of a lump, pixels of the strip."""
    crossing_s: float
    """Seconds from the top of the picture to its bottom."""
    seconds: float
    fps: float
    air: Air
    surroundings: Image
    """What is beside the belt, as large as the picture."""
    seed: int
    away: bool = False
    """The belt moves away from the camera."""

    @property
    def speed(self) -> float:
        """Pixels of the strip a second."""
        return speed_of(self.view, self.crossing_s)


def speed_of(view: View, crossing_s: float) -> float:
    """Pixels of the strip a second."""
    return (view.along(1.0) - view.along(0.0)) / crossing_s


def length_of(view: View, crossing_s: float, seconds: float) -> int:
    """How long a strip must be, pixels."""
    low, high = view.rows()
    return int(np.ceil(high - low + speed_of(view, crossing_s) * seconds)) + 4


@dataclass(frozen=True, slots=True)
class Seen:
    """A body in one frame."""

    id: int
    x: float
    y: float
    w: float
    h: float
    visibility: float
    lump: bool
    ratio: float
    """Its size in limits."""


def frames(scene: Scene) -> Iterator[tuple[Image, list[Seen]]]:
    """Pictures, and the bodies near or above the limit in each."""
    rng = np.random.default_rng([scene.seed, 77])
    view, count = scene.view, round(scene.seconds * scene.fps)
    low, high = view.rows()
    span = int(np.ceil(high - low)) + 2
    levels = _levels(scene.strip.pixels)
    weights = _weights(fineness(view), len(levels))
    belt = _belt_mask(view, span, low)
    finish = _Finish(scene, rng, count)
    bodies = [(k, body) for k, body in enumerate(scene.strip.bodies, 1) if body.size >= UNCLEAR * scene.limit]
    edges = np.array([[b.corners[:, 1].min(), b.corners[:, 1].max()] for _, b in bodies]).reshape(-1, 2)
    length = len(scene.strip.pixels)
    # The strip's last row leaves first; away from the camera its first row does.
    travel = scene.speed / scene.fps * np.arange(count)
    starts = (travel if scene.away else length - span - travel) + 0.0
    matrix = view.matrix()
    for k in range(count):
        dx, dy = finish.shake[k]
        shaken = np.array([[1, 0, dx], [0, 1, dy], [0, 0, 1]]) @ matrix
        to_picture = shaken @ np.array([[1, 0, 0], [0, 1, low - starts[k]], [0, 0, 1]])
        rows = int(max(starts[k] - 2, 0)), int(min(starts[k] + span + 4, length))
        load = _warp(levels, to_picture, rows, (view.width, view.height), weights)
        shift = np.array([[1, 0, dx], [0, 1, dy]], float)
        around, alpha = (
            cv2.warpAffine(one, shift, (view.width, view.height), borderMode=cv2.BORDER_REPLICATE)
            for one in (scene.surroundings, belt)
        )
        picture = np.asarray(cv2.blendLinear(load, around, alpha, 1 - alpha), np.uint8)
        near = (edges[:, 1] > starts[k]) & (edges[:, 0] < starts[k] + span)
        yield finish(k, picture), _seen([bodies[n] for n in np.flatnonzero(near)], to_picture, scene)


def _levels(pixels: Image) -> list[Image]:
    levels = [pixels]
    for _ in range(2):
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), np.uint8))
    return levels


def _weights(span: NDArray[np.float32], count: int) -> list[NDArray[np.float32]]:
    level = np.clip(np.log2(np.maximum(span, 1e-3)), 0, count - 1)
    return [np.clip(1 - np.abs(level - k), 0, 1).astype(np.float32) for k in range(count)]


def _warp(
    levels: list[Image],
    matrix: Matrix,
    rows: tuple[int, int],
    size: tuple[int, int],
    weights: list[NDArray[np.float32]],
) -> Image:
    """The strip as the camera sees it; where it is far away from a coarser level, against aliasing."""
    total: Image | None = None
    so_far: NDArray[np.float32] | None = None
    for k, (level, weight) in enumerate(zip(levels, weights, strict=True)):
        if not weight.any():
            continue
        scale = 2**k
        first, last = rows[0] // scale, -(-rows[1] // scale)
        part = level[first:last]
        # Pixel centres of a coarser level lie at scale * i.
        fit = matrix @ np.array([[scale, 0, 0], [0, scale, scale * first], [0, 0, 1]], float)
        one = cv2.warpPerspective(part, fit, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        if total is None or so_far is None:
            total, so_far = np.asarray(one, np.uint8), weight
        else:
            total = np.asarray(cv2.blendLinear(total, one, so_far, weight), np.uint8)
            so_far = so_far + weight
    assert total is not None
    return total


def _belt_mask(view: View, span: int, low: float) -> NDArray[np.float32]:
    # Drawn three times as large: a soft edge of about a pixel.
    corners = np.array([[0, low], [view.belt, low], [view.belt, low + span], [0, low + span]], float)
    seen = project(view.matrix(), corners) * 3
    mask = np.zeros((view.height * 3, view.width * 3), np.uint8)
    cv2.fillConvexPoly(mask, rounded(seen), (255,))
    small = cv2.resize(mask, (view.width, view.height), interpolation=cv2.INTER_AREA)
    return np.asarray(small.astype(np.float32) / np.float32(255))


class _Finish:
    """Light, lens, dust, noise."""

    def __init__(self, scene: Scene, rng: np.random.Generator, count: int) -> None:
        view, self._air = scene.view, scene.air
        self._size = view.width, view.height
        t = np.arange(count) / scene.fps
        self._gain = np.full(count, self._air.gain)
        for period in (61.0, 23.0, 7.3):
            phase, share = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 1.0)
            self._gain += (
                self._air.gain * self._air.flicker * share / 2 * np.sin(2 * np.pi * t / period + phase)
            )
        light = _light(view, self._air, rng)
        self._light = light if self._air.grey else cv2.merge([light, light, light])
        steps = rng.normal(0, 1, (count, 2))
        walk = np.zeros((count, 2))
        for k in range(1, count):
            walk[k] = 0.8 * walk[k - 1] + 0.6 * steps[k]
        self.shake = walk * self._air.shake_px
        channels = 1 if self._air.grey else 3
        shape = (view.height + _MARGIN, view.width + _MARGIN)
        common = rng.normal(0, 0.85 * self._air.noise, (_BANK, *shape, 1))
        own = rng.normal(0, 0.5 * self._air.noise, (_BANK, *shape, channels))
        self._noise = np.squeeze(common + own).astype(np.float32)
        self._pick = rng.integers(0, (_BANK, _MARGIN, _MARGIN), (count, 3))
        self._dust = _Dust(rng, count) if self._air.dust else None

    def __call__(self, k: int, picture: Image) -> Image:
        air = self._air
        if air.blur:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), air.blur), np.uint8)
        if air.grey:
            picture = np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)
        # Around 110 for the contrast, and all at once with the light: light * (contrast * value + offset).
        plain = cv2.convertScaleAbs(picture, alpha=air.contrast, beta=110 * (1 - air.contrast))
        lit = cv2.multiply(plain, self._light, scale=float(self._gain[k]), dtype=cv2.CV_32F)
        value = np.asarray(lit, np.float32)
        if self._dust is not None:
            veil = self._dust.veil(k, self._size) * np.float32(air.dust)
            full = veil if air.grey else np.asarray(cv2.merge([veil, veil, veil]), np.float32)
            value = value + (np.float32(178) - value) * full
        b, y, x = self._pick[k]
        noise = self._noise[b, y : y + self._size[1], x : x + self._size[0]]
        return np.asarray(cv2.add(value, noise, dtype=cv2.CV_8U), np.uint8)


def _light(view: View, air: Air, rng: np.random.Generator) -> NDArray[np.float32]:
    """What stands still: vignette, uneven light, a beam's shadow."""
    v, u = np.mgrid[0 : view.height, 0 : view.width].astype(np.float32)
    u, v = u / view.width - 0.5, v / view.height - 0.5
    light = 1 - air.vignette * 2 * (u**2 + v**2)
    light += np.float32(0.1 * rng.normal()) * u + np.float32(0.12 * rng.normal()) * v
    if air.shadow:
        angle, offset = rng.uniform(-0.4, 0.4), rng.uniform(-0.2, 0.2)
        distance = v + np.float32(np.tan(angle)) * u - np.float32(offset)
        half = np.float32(rng.uniform(0.06, 0.14))
        light *= 1 - air.shadow / (1 + np.exp((np.abs(distance) - half) / 0.015))
    return light.astype(np.float32)


class _Dust:
    """Clouds that drift and change."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        fields = [cv2.GaussianBlur(rng.normal(0, 1, (64, 96)).astype(np.float32), (0, 0), s) for s in (3, 8)]
        self._clouds = [field / field.std() for field in fields]
        self._drift = rng.uniform(-0.35, 0.35, (2, 2))
        t = np.arange(count)
        self._strength = 0.5 + 0.5 * np.sin(2 * np.pi * t / rng.uniform(300, 700) + rng.uniform(0, 6))

    def veil(self, k: int, size: tuple[int, int]) -> NDArray[np.float32]:
        """Opacity, 0 to 1."""
        total = np.zeros((24, 32), np.float32)
        for cloud, drift in zip(self._clouds, self._drift, strict=True):
            dy, dx = drift * k
            shifted = cv2.warpAffine(
                cloud,
                np.array([[1, 0, dx % 96], [0, 1, dy % 64]], float),
                (96, 64),
                borderMode=cv2.BORDER_WRAP,
            )
            total += shifted[20:44, 32:64]
        soft = np.clip(total * 0.3 + 0.3, 0, 1) * np.float32(self._strength[k])
        return np.asarray(cv2.resize(soft, size, interpolation=cv2.INTER_LINEAR))


def _seen(bodies: list[tuple[int, Body]], matrix: Matrix, scene: Scene) -> list[Seen]:
    width, height = scene.view.width, scene.view.height
    found = []
    for k, body in bodies:
        outline = project(matrix, body.corners)
        low, high = outline.min(axis=0), outline.max(axis=0)
        if np.any(high < 0) or np.any(low > (width, height)):
            continue
        inside_low, inside_high = np.clip(low, 0, (width, height)), np.clip(high, 0, (width, height))
        share = float(np.prod(inside_high - inside_low) / max(np.prod(high - low), 1e-9))
        if share <= 0:
            continue
        lump = body.size >= scene.limit and not body.cut
        w, h = inside_high - inside_low
        found.append(
            Seen(
                k,
                float(inside_low[0]),
                float(inside_low[1]),
                float(w),
                float(h),
                share,
                lump,
                body.size / scene.limit,
            )
        )
    return found


def write(scene: Scene, folder: Path, site: dict[str, object]) -> None:
    """A scene as files, see `record`."""
    view = scene.view
    about = {
        "crossing_s": scene.crossing_s,
        "limit": scene.limit,
        "seed": scene.seed,
        "air": asdict(scene.air),
        "view": asdict(view),
    }
    record(frames(scene), (view.width, view.height), scene.fps, scene.air.crf, folder, site, about)


def record(
    shown: Iterable[tuple[Image, list[Seen]]],
    size: tuple[int, int],
    fps: float,
    crf: int,
    folder: Path,
    site: dict[str, object],
    about: dict[str, object],
) -> None:
    """`video.mp4`, `gt.txt` (lumps), `unclear.txt` (what may be taken for one), `site.yaml`, `about.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "about.json").unlink(missing_ok=True)
    lines: dict[bool, list[str]] = {True: [], False: []}
    count = 0
    with VideoWriter(folder / "video.mp4", *size, fps, crf=crf) as out:
        for frame, (picture, bodies) in enumerate(shown, 1):
            out.write(picture)
            count = frame
            for one in bodies:
                if one.visibility >= _SHOWS:
                    box = f"{one.x:.2f},{one.y:.2f},{one.w:.2f},{one.h:.2f}"
                    lines[one.lump].append(f"{frame},{one.id},{box},1,1,{one.visibility:.3f}\n")
    (folder / "gt.txt").write_text("".join(lines[True]), encoding="ascii")
    (folder / "unclear.txt").write_text("".join(lines[False]), encoding="ascii")
    (folder / "site.yaml").write_text(json.dumps(site, indent=1) + "\n", encoding="utf-8")
    known = {
        "width": size[0],
        "height": size[1],
        "fps": fps,
        "seconds": count / fps,
        "lumps": len({line.split(",")[1] for line in lines[True]}),
        "unclear": len({line.split(",")[1] for line in lines[False]}),
        **about,
    }
    # Last: who finds it finds the rest whole.
    (folder / "about.json").write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
