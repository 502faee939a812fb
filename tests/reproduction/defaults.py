"""Fits what ships with the product: `python -m tests.reproduction.defaults lump`, then `… defaults demo`.

service/detection/default_lump.npz   the lump likelihood of a ROI without a prior, and where training starts: from
                               288 simulated minutes of all kinds of lumps, of both styles, with boxes of all sizes
service/simulator/demo.prior          the prior of the demo, trained on 90 s of the simulated feed
"""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import lumpwatch.service
from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.learning import LabelledView, LumpFit, fit_lump
from lumpwatch.models.learning.fit import Scene
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli.demo import CAMERA, ROI, demo_config
from lumpwatch.service.config import JdtConfig, parse_config
from lumpwatch.service.detection.detectors.filters import make_profile
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.fit_arrays import told
from lumpwatch.service.storage.label_file import read_labels
from lumpwatch.service.storage.prior_file import Prior, encode_prior
from lumpwatch.service.training.learner import train

PATTERNS = 128
FIRST_SEED = 9200
SEEDS = 12
"""Feeds of each look and style."""
SECONDS = 60.0
EVERY = 20
"""Of their pictures one in so many is kept."""
ALTERED = 0.5
"""Share of the pictures that are seen as another camera might show them."""


def lump_views(spec: FeedSpec) -> tuple[list[LabelledView], Roi]:
    """Working pictures of a feed with its lumps, and its ROI."""
    feed = FeedSimulator(spec)
    roi = make_roi(feed.polygon, spec.width, spec.height, JdtConfig().working_size_px)
    rng = np.random.default_rng(spec.seed)
    views = []
    for i in range(round(SECONDS * spec.fps)):
        if i % EVERY:
            feed.skip()
            continue
        picture, truths = feed.render()
        states = blank(len(truths))
        if truths:
            boxes = np.array([[t.x, t.y, t.w, t.h] for t in truths])
            states[:, [X, Y, W, H]] = roi.to_working(boxes)
        gray = roi.cut(picture)
        if rng.random() < ALTERED:
            gray = altered(gray, rng)
        views.append(LabelledView(roi.view(gray), states))
    return views, roi


def altered(gray: Image, rng: np.random.Generator) -> Image:
    """The picture of another camera: blurred or sharpened, with another gamma, contrast, brightness and noise."""
    light: NDArray[np.floating[Any]] = gray.astype(np.float32)
    if rng.random() < 0.5:
        light = cv2.GaussianBlur(light, (0, 0), rng.uniform(0.4, 1.3)).astype(np.float32)
    elif rng.random() < 0.5:
        light += rng.uniform(0.3, 1.0) * (light - cv2.GaussianBlur(light, (0, 0), 1.5))
    if rng.random() < 0.5:
        light = 255.0 * (np.clip(light, 0.0, 255.0) / 255.0) ** np.exp(rng.uniform(-0.6, 0.6))
    if rng.random() < 0.5:
        light = light.mean() + rng.uniform(0.5, 1.5) * (light - light.mean())
    if rng.random() < 0.5:
        light = light + rng.uniform(1.0, 6.0) * rng.standard_normal(light.shape)
    return np.clip(light + rng.uniform(-20.0, 20.0), 0.0, 255.0).astype(np.uint8)


LUMPS: dict[str, object] = {
    "smallest_lump": 1.0, "largest_lump": 2.2, "lumps_per_minute": 14.0, "cluster_share": 0.3, "dust": 0.3,
    "frozen_share": 0.3, "smooth_share": 0.2, "slab_share": 0.1, "buried_share": 0.2,
}  # fmt: skip
LOOKS: tuple[dict[str, object], ...] = (
    {},
    {"dust": 0.6, "medium_rocks_per_minute": 100.0},
    {"dust": 0.9, "light_drift": 0.3},
    {"night": 0.5, "noise": 4.0},
    {"night": 0.9},
    {"rain": 0.4, "lens_drops": 3},
    {"snow": 0.4, "lump_contrast": 0.8},
    {"steam": 0.3},
    {"lump_contrast": 0.6},
    {"sun_patches": 0.7, "shadow_edges": 0.4},
    {"h264_crf": 32},
    {"exposure_jump": 2.0, "exposure_every_s": 6.0},
)
"""Kinds of lumps and looks of the place; both styles of the feed show each."""


def default_births(roi: Roi) -> PolygonBirths:
    """Boxes of all sizes that lumps have by default, anywhere in the ROI."""
    return polygon_births(roi.mask, make_profile(JdtConfig().size_h, None, roi), np.ones(1))


def default_lump() -> LumpFit:
    """Fit on lumps of all kinds, in every weather, in both styles."""
    scenes: list[Scene] = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(mp_context=context, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
        for style in ("a", "b"):
            specs = [
                FeedSpec.model_validate({"seed": FIRST_SEED + number, "style": style, **LUMPS, **look})
                for number, look in enumerate(SEEDS * LOOKS)
            ]
            feeds = list(pool.map(lump_views, specs))
            births = default_births(feeds[0][1])
            scenes.append(([view for views, _ in feeds for view in views], births))
    return fit_lump(scenes, np.random.default_rng(1), patterns=PATTERNS)


def demo_prior() -> Prior:
    """Train the demo's ROI on a feed of another seed."""
    config = parse_config(demo_config(Path("var"), 0)).camera(CAMERA)
    roi = config.roi(ROI)
    with tempfile.TemporaryDirectory() as folder:
        files = write_video(FeedSpec(seed=9100), 90.0, Path(folder))
        frames, _ = read_frames(config, files.video)
        trained = train(roi, frames, read_labels(files.labels), files.labels, "simulated feed, seed 9100")
    return trained.as_prior(CAMERA, roi, "simulated feed, seed 9100", datetime(2026, 1, 1, tzinfo=UTC))


if __name__ == "__main__":
    package = Path(lumpwatch.service.__file__).parent
    match sys.argv[1:]:
        case ["lump"]:
            # Half as many digits as in a prior: it is part of every installation.
            arrays = {name: array.astype(np.float32) for name, array in told(default_lump()).items()}
            for default in ("fit_looks", "fit_margin"):
                del arrays[default]
            np.savez(package / "detection" / "default_lump.npz", allow_pickle=False, **arrays)
        case ["demo"]:
            (package / "simulator" / "demo.prior").write_bytes(encode_prior(demo_prior()))
        case _:
            sys.exit("say lump or demo")
