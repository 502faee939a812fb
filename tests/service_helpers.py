"""What the tests of the service share: a small camera, frames by hand, and a prior without training.

The camera looks for a bright square on a dark ground: with a histogram likelihood whose reference is
white, a box on the square speaks for an object and any other box against it, so a few frames decide.
"""

from __future__ import annotations

import json
from dataclasses import fields
from datetime import UTC, datetime
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.jdt.density import GridDensity
from lumpwatch.models.jdt.row_profile import RowProfile
from lumpwatch.models.learning import HistogramFit, Learned, LumpFit
from lumpwatch.models.likelihood.lump import FEATURES
from lumpwatch.models.state import Y
from lumpwatch.service.config import CameraConfig, SiteConfig, parse_config
from lumpwatch.service.core.frame import Encoding, Frame
from lumpwatch.service.detection.shipped_likelihood import default_likelihood
from lumpwatch.service.storage.prior_file import Prior, PriorMeta

WIDTH, HEIGHT = 96, 64
POLYGON = ((0.125, 0.125), (0.875, 0.125), (0.875, 0.875), (0.125, 0.875))
INTERVAL_S = 0.1


def site_tree(**detector: Any) -> dict[str, Any]:
    """The configuration of the small camera as plain data; JSON of it is YAML."""
    chosen = {
        "particles": 300,
        "models": ["constant_velocity"],
        "likelihood": {"kind": "histogram"},
        "existence": {"birth_rate_hz": 0.5},
    } | detector
    alarm = {"on_delay_s": 0.2, "off_delay_s": 0.3, "latch": True}
    roi = {"id": "apron", "polygon": [list(p) for p in POLYGON], "detector": chosen, "alarm": alarm}
    camera = {"id": "cam", "source": {"url": "clip.mp4"}, "rois": [roi], "blind_after_s": 1.0}
    camera["quality"] = {"enabled": False}  # its pictures are drawn: dark, without noise, always the same
    # One frame decides here, see above.
    camera["sight"] = {"least_frames": 1, "warm_up_s": 0.0, "longest_gap_s": 3600.0}
    return {"site": "pit", "cameras": [camera]}


def site(tree: dict[str, Any]) -> SiteConfig:
    return parse_config(json.dumps(tree), "site.yaml", {})


def camera(**detector: Any) -> CameraConfig:
    return site(site_tree(**detector)).cameras[0]


def learned(
    models: tuple[str, ...] = ("constant_velocity",), likelihood: LumpFit | HistogramFit | None = None
) -> Learned:
    """Knowledge of objects a quarter of the ROI large that move slowly."""
    m = len(models)
    rows = 5
    log_size = np.log(0.25)
    return Learned(
        models=models,
        rates=np.zeros((m, 2)),
        velocity_noise=np.full(m, 0.1),
        joint=np.full((m, m), 1 / m**2),
        interval_s=INTERVAL_S,
        density=GridDensity((Y,), np.array([0.0]), np.array([0.1]), np.ones((m, 11))),
        births=np.full(m, 1 / m),
        profile=RowProfile(
            0.0,
            0.25,
            np.tile([0.0, 0.0, log_size, log_size], (rows, 1)),
            np.tile([0.05, 0.05, 0.1, 0.1], (rows, 1)),
        ),
        likelihood=likelihood or bright_fit(),
        label_counts=np.full(m, 40, np.int64),
        tracks=8,
    )


def bright_fit(channel: Literal["luma", "colour"] = "luma") -> HistogramFit:
    """White is the object: log ratio +6 on a white box, -6 on a dark one."""
    reference = np.full(16, 0.01 / 16)
    reference[15] += 0.99
    return HistogramFit(reference, 6.0, 12.0, channel)


def lump_fit() -> LumpFit:
    n = len(FEATURES)
    weights = np.linspace(-1.0, 1.0, 2 * n)
    return LumpFit(
        np.linspace(0.1, 0.8, n), np.linspace(0.5, 1.2, n), weights, 0.25, net=default_likelihood().net
    )


def prior(
    known: Learned | None = None,
    *,
    camera_id: str = "cam",
    roi: str = "apron",
    version: int = 0,
    aspect: float = WIDTH / HEIGHT,
    polygon: tuple[tuple[float, float], ...] = POLYGON,
    source: str = "clip.mp4",
) -> Prior:
    meta = PriorMeta(
        camera=camera_id,
        roi=roi,
        created=datetime(2024, 5, 17, 12, 30, tzinfo=UTC),
        polygon=polygon,
        aspect=aspect,
        source=source,
        frames=120,
    )
    return Prior(meta, known or learned(), version)


def picture(*, bright: bool, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """A dark, slightly noisy ground, with a white square of 14 x 14 px around (48, 32) or without it."""
    noise = np.random.default_rng(5).integers(10, 30, (height, width))
    gray = noise.astype(np.uint8)
    if bright:
        gray[25:39, 41:55] = 250
    return gray


def frame(
    seq: int,
    *,
    bright: bool = False,
    time_s: float | None = None,
    data: NDArray[np.uint8] | None = None,
    encoding: Encoding = "gray8",
    size: tuple[int, int] = (WIDTH, HEIGHT),
    received_s: float | None = None,
) -> Frame:
    """Frame `seq`, captured at seq / 10 s unless stated and received at once."""
    when = seq * INTERVAL_S if time_s is None else time_s
    if data is None:
        data = picture(bright=bright, width=size[0], height=size[1])
    received = when if received_s is None else received_s
    return Frame(seq, when, received, 1.7e9 + received, size[0], size[1], encoding, data)


def same(a: object, b: object) -> bool:
    """Equal down to the bits of the arrays."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))  # type: ignore[arg-type]
    return bool(a == b)
