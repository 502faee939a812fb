"""Which feeds there are, and how each is made.

A site is a camera over a belt with a size limit. It has three minutes: `train` with labels, `watch` to be judged
on, both with lumps and made of different rocks, and `quiet` without any lump.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import cv2
import numpy as np

from tests.reproduction.real.belts import Load, composite, quarry
from tests.reproduction.real.ore import Image, Split, bare_belts, pieces
from tests.reproduction.real.render import UNCLEAR, Air, Scene, length_of, write
from tests.reproduction.real.strip import Quilt, Strip, quilt
from tests.reproduction.real.view import View

Role = Literal["train", "watch", "quiet"]
ROLES: tuple[Role, ...] = ("train", "watch", "quiet")
CAMERA, ROI = "feed", "apron"
FPS, SECONDS = 25.0, 60.0
_SEEDS = {"train": 1000, "dev": 2000, "test": 3000}


@dataclass(frozen=True, slots=True)
class Site:
    """A camera over a belt."""

    kind: str
    number: int
    split: Split
    view: View
    air: Air
    limit: float
    """Pixels of the strip."""
    crossing_s: float
    lumps: int = 20
    """About how many come by in a minute."""
    mm: float | None = None
    """Millimetres of a pixel of the strip: the camera is calibrated."""
    look: str = "ore"
    away: bool = False
    options: tuple[float, ...] = ()
    fps: float = FPS

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.kind}-{self.number}"

    @property
    def seed(self) -> int:
        """Of everything that is the same in all its minutes."""
        return _SEEDS[self.split] + 100 * KINDS.index(self.kind) + self.number

    def config(self) -> dict[str, object]:
        """What stands in `site.yaml`."""
        roi: dict[str, object] = {"id": ROI, "polygon": self.view.polygon()}
        if self.mm is not None:
            rng = np.random.default_rng([self.seed, 5])
            roi["calibration"] = self.view.calibration(self.mm, self.limit * self.mm, rng)
        camera = {"id": CAMERA, "source": {"url": "video.mp4"}, "rois": [roi]}
        return {"site": self.name, "store": {"path": "var"}, "cameras": [camera]}


TAUGHT = 72
"""Sites that what ships is taught by."""
KINDS = ["scroll", "composite", "calibrated", "quarry"]
Maker = Callable[[Site, Role, Path, np.random.Generator, int], Strip]


def scrolled(site: Site, role: Role, data: Path, rng: np.random.Generator, length: int) -> Strip:
    """Pictures of ore joined, nothing pasted."""
    low, high, window = site.options
    plan = Quilt(
        site.view.belt,
        length,
        round(window),
        (low, high),
        site.limit,
        unclear=UNCLEAR * site.limit,
        lumps=site.lumps * length / (length - site.view.height),
    )
    if role == "quiet":
        plan = replace(plan, window=round(0.8 * window), scale=(0.75 * low, low), lumps=0.0)
        plan = replace(plan, largest=UNCLEAR * site.limit)
    return quilt(rng, pieces(data, site.split, _half(site, role)), plan)


def _half(site: Site, role: Role) -> int:
    """Rocks of one half teach, those of the other are watched."""
    return (site.number + (role != "train")) % 2


def _load(site: Site, role: Role, length: int) -> Load:
    low, high, medium, fine = site.options
    lumps = 0 if role == "quiet" else round(site.lumps * length / (length - site.view.height))
    return Load(
        site.view.belt, length, site.limit, lumps, (low, high), round(medium * length / 4000), fine=fine
    )


def pasted(site: Site, role: Role, data: Path, rng: np.random.Generator, length: int) -> Strip:
    """Lumps and medium rocks on fine ore."""
    return composite(rng, pieces(data, site.split, _half(site, role)), _load(site, role, length))


def packed(site: Site, role: Role, data: Path, rng: np.random.Generator, length: int) -> Strip:
    """Stones of all sizes side by side."""
    return quarry(rng, pieces(data, site.split, _half(site, role)), _load(site, role, length))


MAKERS: dict[str, Maker] = {"scroll": scrolled, "composite": pasted, "calibrated": pasted, "quarry": packed}


def scene(site: Site, role: Role, data: Path, seconds: float = SECONDS) -> Scene:
    """One minute of a site."""
    rng = np.random.default_rng([site.seed, ROLES.index(role)])
    length = length_of(site.view, site.crossing_s, seconds)
    strip = MAKERS[site.kind](site, role, data, rng, length)
    strip = Strip(look(strip.pixels, site.look), strip.bodies)
    fixed = np.random.default_rng([site.seed, 9])
    around = surroundings(fixed, bare_belts(data, site.split), site.view)
    return Scene(
        site.view,
        strip,
        site.limit,
        site.crossing_s,
        seconds,
        site.fps,
        site.air,
        around,
        site.seed * 10 + ROLES.index(role),
        site.away,
    )


def make(
    site: Site, data: Path, folder: Path, seconds: float = SECONDS, roles: Sequence[Role] = ROLES
) -> None:
    """The minutes of a site, each into a folder of its own below `folder`."""
    for role in roles:
        write(scene(site, role, data, seconds), folder / role, site.config())


def look(pixels: Image, name: str) -> Image:
    """The same stones as another kind of rock."""
    if name == "ore":
        return pixels
    value = pixels.astype(np.float32)
    grey = value @ np.array((0.2, 0.5, 0.3), np.float32)
    if name == "granite":
        tinted = grey[..., None] * np.array((1.0, 0.97, 0.95), np.float32) * 0.85 + 12
    elif name == "dark":
        tinted = 255 * (grey[..., None] / 255) ** 1.5 * np.array((0.62, 0.58, 0.56), np.float32) + 8
    elif name == "red":
        tinted = grey[..., None] * np.array((0.5, 0.62, 0.92), np.float32) + 0.15 * value
    elif name == "pale":
        tinted = 255 * (grey[..., None] / 255) ** 0.7 * np.array((0.86, 0.9, 0.92), np.float32)
    else:
        raise ValueError(f"{name}: no such look")
    return np.asarray(np.clip(tinted, 0, 255), np.uint8)


def surroundings(rng: np.random.Generator, bare: tuple[Image, ...], view: View) -> Image:
    """Steel, dirt and dark beside the belt, as large as the picture."""
    size = view.width, view.height
    base = bare[int(rng.integers(len(bare)))]
    picture = cv2.resize(base[40:200, 20:230], size, interpolation=cv2.INTER_LINEAR).astype(np.float32)
    picture = picture * rng.uniform(0.4, 1.1) + rng.uniform(0, 40)
    picture += cv2.resize(rng.normal(0, 18, (5, 7)).astype(np.float32), size, interpolation=cv2.INTER_CUBIC)[
        ..., None
    ]
    for _ in range(int(rng.integers(4, 9))):
        x, y = rng.uniform(-0.1, 1.1, 2) * size
        slope, thick = rng.uniform(-0.3, 0.3), int(rng.integers(4, 26))
        tone = float(rng.uniform(15, 150))
        end = (round(x + slope * view.height), view.height) if rng.random() < 0.6 else (view.width, round(y))
        start = (round(x), 0) if end[1] == view.height else (0, round(y + slope * 50))
        cv2.line(picture, start, end, (tone * 0.95, tone, tone), thick, cv2.LINE_AA)
    return np.asarray(np.clip(cv2.GaussianBlur(picture, (0, 0), 1.2), 0, 255), np.uint8)


def sites(split: Split) -> tuple[Site, ...]:
    """All sites of a split."""
    if split == "train":
        return tuple(_taught_site(number) for number in range(TAUGHT))
    return tuple(site for kind in KINDS if kind in MAKERS for site in SITES[kind](split))


def _scroll_sites(split: Split) -> tuple[Site, ...]:
    above = Site(
        "scroll",
        1,
        split,
        View(640, 480, 470, near=0.86, tilt_deg=0.0, yaw_deg=1.5),
        Air(flicker=0.08, noise=3.0, dust=0.0),
        limit=118.0,
        crossing_s=7.0,
        options=(0.85, 1.6, 270),
    )
    slanted = Site(
        "scroll",
        2,
        split,
        View(640, 360, 560, near=0.88, tilt_deg=38.0, angle_deg=58.0, roll_deg=1.5, yaw_deg=-3.0),
        Air(flicker=0.15, noise=4.0, dust=0.1, shadow=0.3),
        limit=122.0,
        crossing_s=6.5,
        look="ore",
        options=(0.9, 1.7, 280),
    )
    grey = Site(
        "scroll",
        3,
        split,
        View(640, 480, 600, near=0.95, tilt_deg=42.0, angle_deg=50.0, yaw_deg=5.0, shift=0.05, top=0.06),
        Air(flicker=0.15, noise=5.0, dust=0.2, grey=True, contrast=0.8, crf=28),
        limit=120.0,
        crossing_s=7.0,
        lumps=18,
        options=(0.85, 1.7, 280),
    )
    return above, slanted, grey


def _drawn(rng: np.random.Generator, belt: int, low: float, high: float) -> View:
    """A camera somewhere over a belt."""
    width, height = (640, 480) if rng.random() < 0.6 else (640, 360)
    return View(
        width,
        height,
        belt,
        near=float(rng.uniform(0.72, 0.95)),
        tilt_deg=float(rng.uniform(low, high)),
        angle_deg=float(rng.uniform(46, 62)),
        yaw_deg=float(rng.uniform(-6, 6)),
        roll_deg=float(rng.uniform(-2.5, 2.5)),
        shift=float(rng.uniform(-0.08, 0.08)),
        top=0.05,
        bottom=float(rng.uniform(0.9, 0.97)),
    )


def _air(rng: np.random.Generator, grey: bool) -> Air:
    return Air(
        gain=float(rng.uniform(0.65, 1.1)),
        flicker=float(rng.uniform(0.08, 0.25)),
        contrast=float(rng.uniform(0.7, 1.0)),
        shadow=float(rng.choice([0.0, 0.35, 0.5])),
        vignette=float(rng.uniform(0.05, 0.3)),
        blur=float(rng.uniform(0.5, 0.9)),
        noise=float(rng.uniform(2.5, 6.0)),
        shake_px=float(rng.uniform(0.2, 0.7)),
        dust=float(rng.choice([0.0, 0.2, 0.35])),
        grey=grey,
        crf=int(rng.integers(24, 30)),
    )


def _composite_sites(kind: str) -> Callable[[Split], tuple[Site, ...]]:
    calibrated = kind == "calibrated"

    def make_sites(split: Split) -> tuple[Site, ...]:
        found = []
        for number in (1, 2, 3):
            rng = np.random.default_rng([_SEEDS[split], KINDS.index(kind), number])
            belt = 440
            # Small lumps and large ones: belts differ in how wide they are for what their crusher takes.
            limit = float(rng.uniform(80, 96) if number == 3 else rng.uniform(58, 78))
            found.append(
                Site(
                    kind,
                    number,
                    split,
                    _drawn(rng, belt, 20.0, 50.0),
                    _air(rng, grey=number == 2),
                    limit,
                    crossing_s=float(rng.uniform(5.0, 7.5)),
                    lumps=20,
                    mm=float(rng.uniform(400, 800)) / limit if calibrated else None,
                    look=("ore", "ore", "red")[number - 1],
                    options=(1.05 if calibrated else 1.0, 1.9, float(rng.uniform(60, 260)), 0.5),
                )
            )
        return tuple(found)

    return make_sites


def _quarry_sites(split: Split) -> tuple[Site, ...]:
    found = []
    for number, name in enumerate(("granite", "dark", "ore"), 1):
        rng = np.random.default_rng([_SEEDS[split], KINDS.index("quarry"), number])
        found.append(
            Site(
                "quarry",
                number,
                split,
                _drawn(rng, 520, 15.0, 48.0),
                _air(rng, grey=number == 2),
                limit=float(rng.uniform(92, 112)),
                crossing_s=float(rng.uniform(5.0, 7.0)),
                lumps=20,
                mm=None if number == 1 else 6.0,
                look=name,
                options=(1.0, 1.7, 0.0, 0.5),
            )
        )
    return tuple(found)


def _taught_site(number: int) -> Site:
    """A site of the split that teaches: any camera, light and rock, two frames a second."""
    rng = np.random.default_rng([77, number])
    kind = ("scroll", "composite", "quarry")[number % 3]
    limit: tuple[float, float]
    options: tuple[float, ...]
    if kind == "scroll":
        view, limit = _drawn(rng, int(rng.integers(470, 601)), 0.0, 44.0), (112.0, 126.0)
        options = rng.uniform(0.8, 0.95), rng.uniform(1.5, 1.8), rng.uniform(260, 290)
    elif kind == "composite":
        view, limit = _drawn(rng, 440, 10.0, 50.0), (58.0, 96.0)
        options = 1.0, 1.9, rng.uniform(60, 260), 0.5
    else:
        view, limit = _drawn(rng, 520, 15.0, 48.0), (92.0, 112.0)
        options = 1.0, 1.7, 0.0, 0.5
    side = float(rng.uniform(*limit))
    air = _air(rng, bool(rng.random() < 0.5))
    return Site(
        kind,
        100 + number,
        "train",
        view,
        air,
        side,
        crossing_s=float(rng.uniform(5.0, 7.5)),
        lumps=int(rng.integers(12, 21)),
        look=str(rng.choice(["ore", "granite", "dark", "red", "pale"])),
        options=tuple(map(float, options)),
        fps=2.0,
    )


SITES: dict[str, Callable[[Split], tuple[Site, ...]]] = {
    "scroll": _scroll_sites,
    "composite": _composite_sites("composite"),
    "calibrated": _composite_sites("calibrated"),
    "quarry": _quarry_sites,
}
