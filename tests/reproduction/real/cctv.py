"""Real belts from a plant's own cameras: as they are, every alarm false, and with real rocks laid on them.

The belts are filmed from a monitor at an uneven rate: pictures that repeat the one before are left out, and the
rest is shown at RATE frames a second, as by a slow camera. How far the load moved from one picture to the next is
measured on the belt seen from above (phase correlation), and the rocks move as far.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from tests.reproduction.real.ore import Image, Piece, Points, Split, pieces
from tests.reproduction.real.render import Seen, record
from tests.reproduction.real.stones import Cutout, cutout, stones
from tests.reproduction.real.view import Matrix, project

RATE = 8.0
WIDTH = 640
_REPEATED = 0.9
"""Mean difference, grey levels, below which a picture repeats the one before (of a load that can be seen to move)."""


@dataclass(frozen=True, slots=True)
class Belt:
    """A belt in its video."""

    file: str
    quad: tuple[tuple[float, float], ...]
    """The load in the picture: far left, far right, near right, near left, pixels."""
    across: int = 300
    """Pixels across the belt seen from above."""
    along: int = 520
    step: float | None = None
    """Pixels a picture that the load moves, seen from above; None: measured."""


BELTS = {
    "limestone": Belt("limestone.mp4", ((177, 0), (370, 0), (680, 462), (241, 462))),
    # Its load is too fine to be seen to move.
    "fines": Belt("fines.mp4", ((205, 0), (470, 0), (800, 428), (262, 428)), step=9.0),
}


@dataclass(frozen=True, slots=True)
class Reel:
    """The pictures of a belt, `WIDTH` wide."""

    pictures: tuple[Image, ...]
    steps: tuple[float, ...]
    """How far the load moves before each picture, pixels seen from above."""
    matrix: Matrix
    """From above to the picture."""
    across: int
    along: int

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        height, width = self.pictures[0].shape[:2]
        return width, height

    def polygon(self, top: float = 0.03, bottom: float = 0.97) -> list[list[float]]:
        """The region of interest, shares of the picture."""
        ends = [(0, top), (1, top), (1, bottom), (0, bottom)]
        seen = project(self.matrix, np.array(ends) * (self.across, self.along)) / self.size
        return [[round(float(x), 4), round(float(y), 4)] for x, y in np.clip(seen, 0, 1)]


@cache
def reel(folder: Path, name: str, every: bool = False) -> Reel:
    """Read a belt; `every` picture where asked, repeated ones too."""
    belt = BELTS[name]
    with av.open(str(folder / belt.file)) as container:
        full = [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]
    scale = WIDTH / full[0].shape[1]
    height = round(full[0].shape[0] * scale / 2) * 2
    above = np.array([[0, 0], [belt.across, 0], [belt.across, belt.along], [0, belt.along]], np.float32)
    quad = np.array(belt.quad, np.float32) * np.float32(scale)
    matrix = np.asarray(cv2.getPerspectiveTransform(above, quad), float)
    pictures: list[Image] = []
    for one in full:
        small = np.asarray(cv2.resize(one, (WIDTH, height), interpolation=cv2.INTER_AREA), np.uint8)
        if (
            pictures
            and not every
            and belt.step is None
            and cv2.absdiff(small, pictures[-1]).mean() < _REPEATED
        ):
            continue
        pictures.append(small)
    known = 0.0 if every else belt.step
    steps = _steps(pictures, matrix, belt) if known is None else [known] * len(pictures)
    return Reel(tuple(pictures), tuple(steps), matrix, belt.across, belt.along)


def _steps(pictures: Sequence[Image], matrix: Matrix, belt: Belt) -> list[float]:
    above = np.array([_from_above(picture, matrix, belt) for picture in pictures])
    # The monitor's grid stands still; a correlation would find that.
    above -= above.mean(axis=0)
    window = cv2.createHanningWindow((above.shape[2], above.shape[1]), cv2.CV_32F)
    found = [cv2.phaseCorrelate(a, b, window)[0][1] for a, b in itertools.pairwise(above)]
    usual = float(np.median(found))
    # A belt of constant speed: what is far off was not measured but missed.
    steps = [one if 0.3 * usual < one < 1.7 * usual else usual for one in found]
    return [usual, *steps]


def _from_above(picture: Image, matrix: Matrix, belt: Belt) -> NDArray[np.float32]:
    gray = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    flat = cv2.warpPerspective(gray, np.linalg.inv(matrix), (belt.across, belt.along)).astype(np.float32)
    # Far away the monitor's grid is all there is.
    flat = flat[belt.along // 3 :]
    return np.asarray(cv2.GaussianBlur(flat, (0, 0), 1.5) - cv2.GaussianBlur(flat, (0, 0), 12), np.float32)


@dataclass(frozen=True, slots=True)
class CctvSite:
    """A belt with lumps laid on it (roles train, watch and quiet), or as it is at its own rate (quiet alone)."""

    number: int
    split: Split
    belt: str
    lumps: bool

    kind = "cctv"
    LIMIT = 58.0
    """Pixels seen from above, a fifth of the load's width."""
    FULL_RATE = 24.0

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"cctv-{self.number}"

    @property
    def roles(self) -> tuple[str, ...]:
        """Which minutes there are."""
        return ("train", "watch", "quiet") if self.lumps else ("quiet",)

    def make(
        self, ore_data: Path | None, cctv_data: Path, folder: Path, role: str, seconds: float = 60.0
    ) -> None:
        """Write a minute, or two of the belt as it is."""
        film = reel(cctv_data, self.belt, every=not self.lumps)
        rate = RATE if self.lumps else self.FULL_RATE
        roi = {"id": "apron", "polygon": film.polygon()}
        camera = {"id": "feed", "source": {"url": "video.mp4"}, "rois": [roi]}
        site: dict[str, object] = {"site": self.name, "store": {"path": "var"}, "cameras": [camera]}
        if role == "quiet" or ore_data is None:
            shown = loop(film, 2 * seconds, rate)
        else:
            half = int(role != "train")
            rng = np.random.default_rng([7000 + self.number, half])
            shown = with_lumps(film, rng, pieces(ore_data, self.split, half), self.LIMIT, 16, seconds)
        about: dict[str, object] = {"belt": self.belt, "limit": self.LIMIT}
        record(shown, film.size, rate, 24, folder / role, site, about)


def cctv_sites(split: Split) -> tuple[CctvSite, ...]:
    """One belt belongs to training and development, the other to the test."""
    belt = "fines" if split == "test" else "limestone"
    return CctvSite(1, split, belt, True), CctvSite(2, split, belt, False)


@dataclass(frozen=True, slots=True)
class _Rock:
    id: int
    cut: Cutout
    place: Points
    """Of its top left corner when the first picture is shown."""


def loop(of: Reel, seconds: float, rate: float = RATE) -> Iterator[tuple[Image, list[Seen]]]:
    """The belt as it is, again and again."""
    for k in range(round(seconds * rate)):
        yield of.pictures[k % len(of.pictures)], []


def with_lumps(
    of: Reel, rng: np.random.Generator, sources: Sequence[Piece], limit: float, lumps: int, seconds: float
) -> Iterator[tuple[Image, list[Seen]]]:
    """The belt with rocks on it that move with the load; `limit` in pixels seen from above."""
    count = round(seconds * RATE)
    travel = np.cumsum([of.steps[k % len(of.steps)] for k in range(count)])
    rocks = _rocks(of, rng, sources, limit, lumps, float(travel[-1]))
    lights = [_light(picture) for picture in of.pictures]
    for k in range(count):
        picture = of.pictures[k % len(of.pictures)]
        layer = np.zeros((of.along, of.across, 3), np.float32)
        cover, shade = (
            np.zeros((of.along, of.across), np.float32),
            np.zeros((of.along, of.across), np.float32),
        )
        seen = []
        for rock in rocks:
            x, y = rock.place[0], rock.place[1] + travel[k]
            if y > of.along + 4 or y + rock.cut.alpha.shape[0] < -4:
                continue
            _draw(layer, cover, shade, rock.cut, x, y)
            if (one := _seen(of, rock, y, limit)) is not None:
                seen.append(one)
        yield (_onto(of, picture, layer, cover, shade, lights[k % len(lights)]) if seen else picture), seen


def _rocks(
    of: Reel, rng: np.random.Generator, sources: Sequence[Piece], limit: float, lumps: int, travel: float
) -> list[_Rock]:
    large = stones(sources, 52)
    rocks = []
    room = travel + of.along
    for k in range(lumps):
        size = limit * float(rng.uniform(1.0, 1.8))
        stone = large[int(rng.integers(len(large)))]
        cut = cutout(stone, size, rng.uniform(0, 2 * np.pi), bool(rng.integers(2)), rng.uniform(0.8, 1.1))
        width = cut.alpha.shape[1]
        x = float(rng.uniform(4, max(of.across - width - 4, 5)))
        y = of.along - room * (k + float(rng.uniform(0.1, 0.9))) / lumps
        rocks.append(_Rock(k + 1, cut, np.array([x, y])))
    return rocks


def _draw(
    layer: NDArray[np.float32],
    cover: NDArray[np.float32],
    shade: NDArray[np.float32],
    cut: Cutout,
    x: float,
    y: float,
) -> None:
    size = layer.shape[1], layer.shape[0]
    move = np.array([[1, 0, x], [0, 1, y]], float)
    alpha = cv2.warpAffine(cut.alpha, move, size)
    pixels = cv2.warpAffine(cut.pixels, move, size, borderMode=cv2.BORDER_REPLICATE)
    low, high = max(int(y) - 12, 0), min(int(y) + cut.alpha.shape[0] + 20, size[1])
    # A little beyond the rim: what is smoothed later must not meet black.
    reach = cv2.dilate(alpha[low:high], np.ones((7, 7), np.uint8)) > 0.02
    reach &= (cover[low:high] < 0.5) | (alpha[low:high] > 0.5)
    layer[low:high][reach] = pixels[low:high][reach]
    cover[low:high] = np.maximum(cover[low:high], alpha[low:high])
    cast = cv2.warpAffine(cut.alpha, np.add(move, [[0, 0, 2], [0, 0, 4]]), size)
    shade[low:high] = np.maximum(shade[low:high], cv2.GaussianBlur(cast[low:high], (0, 0), 4))


def _light(picture: Image) -> NDArray[np.float32]:
    """The picture's light and colour: itself, very smooth."""
    small = cv2.resize(picture, (picture.shape[1] // 8, picture.shape[0] // 8), interpolation=cv2.INTER_AREA)
    smooth = cv2.GaussianBlur(small, (0, 0), 4).astype(np.float32)
    even = 0.7 * smooth + 0.3 * smooth.mean(axis=(0, 1))
    return np.asarray(cv2.resize(even, (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_LINEAR))


def _onto(
    of: Reel,
    picture: Image,
    layer: NDArray[np.float32],
    cover: NDArray[np.float32],
    shade: NDArray[np.float32],
    light: NDArray[np.float32],
) -> Image:
    rocks, alpha, dark = (cv2.warpPerspective(one, of.matrix, of.size) for one in (layer, cover, shade))
    # The rocks take on the picture's light, colour and softness.
    grey = cv2.cvtColor(rocks, cv2.COLOR_BGR2GRAY)[..., None] / np.float32(150)
    tinted = (0.85 * grey + 0.25) * light
    soft, own = (np.asarray(cv2.GaussianBlur(one, (0, 0), 0.9)) for one in (alpha, tinted))
    under = picture.astype(np.float32) * (1 - 0.35 * dark[..., None])
    fine = picture.astype(np.float32) - cv2.GaussianBlur(picture, (0, 0), 1.5)
    value = under * (1 - soft[..., None]) + (own + 0.5 * fine) * soft[..., None]
    return np.asarray(np.clip(value, 0, 255), np.uint8)


def _seen(of: Reel, rock: _Rock, y: float, limit: float) -> Seen | None:
    outline = project(of.matrix, np.add(rock.cut.corners, (rock.place[0], y)))
    low, high = outline.min(axis=0), outline.max(axis=0)
    inside_low, inside_high = np.clip(low, 0, of.size), np.clip(high, 0, of.size)
    w, h = inside_high - inside_low
    share = float(w * h / max(float(np.prod(high - low)), 1e-9))
    if share <= 0:
        return None
    ratio = float(np.ptp(rock.cut.corners, axis=0).max()) / limit
    return Seen(rock.id, float(inside_low[0]), float(inside_low[1]), float(w), float(h), share, True, ratio)
