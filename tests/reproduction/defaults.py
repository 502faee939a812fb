"""Fits the prior of the demo, on 90 s of the simulated feed: `python -m tests.reproduction.defaults`.

It is bound to the net that ships (`make model`), so it is made anew after it.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import lumpwatch.service
from lumpwatch.models.jdt.births import PolygonBirths, polygon_births
from lumpwatch.models.learning import LabelledView, LumpFit
from lumpwatch.models.roi import Image, Roi, make_roi
from lumpwatch.models.state import H, W, X, Y, blank
from lumpwatch.service.capture.recordings import read_frames
from lumpwatch.service.cli.demo import CAMERA, ROI, demo_config
from lumpwatch.service.config import JdtConfig, parse_config
from lumpwatch.service.detection.detectors.filters import make_profile
from lumpwatch.service.simulator.feed import FeedSimulator
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.simulator.write import write_video
from lumpwatch.service.storage.label_file import read_labels
from lumpwatch.service.storage.prior_file import Prior, encode_prior
from lumpwatch.service.training.learner import train

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


def default_births(roi: Roi) -> PolygonBirths:
    """Boxes of all sizes that lumps have by default, anywhere in the ROI."""
    return polygon_births(roi.mask, make_profile(JdtConfig().size_h, None, roi), np.ones(1))


DEMO_MARGIN = 4.0
"""Above what its 90 s teach: they are full of lumps, and show hardly what a low margin costs while none comes."""


def demo_prior() -> Prior:
    """Train the demo's ROI on a feed of another seed."""
    config = parse_config(demo_config(Path("var"), 0)).camera(CAMERA)
    roi = config.roi(ROI)
    with tempfile.TemporaryDirectory() as folder:
        files = write_video(FeedSpec(seed=9100), 90.0, Path(folder))
        frames, _ = read_frames(config, files.video)
        trained = train(roi, frames, read_labels(files.labels), files.labels, "simulated feed, seed 9100")
    prior = trained.as_prior(CAMERA, roi, "simulated feed, seed 9100", datetime(2026, 1, 1, tzinfo=UTC))
    return with_margin(prior, DEMO_MARGIN)


def with_margin(prior: Prior, margin: float) -> Prior:
    """The prior with another margin."""
    fit = prior.learned.likelihood
    assert isinstance(fit, LumpFit)
    return replace(prior, learned=replace(prior.learned, likelihood=replace(fit, margin=margin)))


if __name__ == "__main__":
    package = Path(lumpwatch.service.__file__).parent
    (package / "simulator" / "demo.prior").write_bytes(encode_prior(demo_prior()))
