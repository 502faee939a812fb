"""Fits what ships with the product: `python -m tests.reproduction.defaults`.

service/default_lump.py        the lump likelihood of a ROI without a prior, towards which training
                               draws, from 48 simulated feeds of both styles, by day and night, with
                               all that the simulator can do to a picture
service/feed/demo.prior        the prior of the demo, trained on 90 s of the simulated feed
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np

import service
from models.births import polygon_births
from models.learning import LabelledView, LumpFit, fit_lump
from models.learning.fit import lowered
from models.learning.sizes import with_sizes
from models.profile import RowProfile, default_profile
from models.roi import Image, Roi, make_roi
from models.state import H, W, X, Y, blank
from service.cli.demo import CAMERA, ROI, demo_config
from service.config import JdtConfig, parse
from service.detectors.filters import DEFAULT_SPEED_H_S
from service.feed.simulator import FeedSimulator
from service.feed.spec import FeedSpec
from service.feed.write import write_video
from service.labels import read_labels
from service.recordings import read_frames
from service.store.prior import Prior, encode
from service.training import QUIET, train

HEAD = '''"""The lump likelihood that training starts from, and of a ROI without a prior.

Made by `python -m tests.reproduction.defaults`.
"""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

'''


def lump_feed(seed: int) -> FeedSpec:
    """A feed that differs from the others in everything but the two cameras."""
    rng = np.random.default_rng(seed)
    smooth, slab, frozen, _ = rng.dirichlet([0.4, 0.4, 0.8, 1.2])

    def one_of(*values: float) -> float:
        return float(rng.choice(values))

    return FeedSpec(
        seed=seed,
        style="b" if seed % 2 else "a",
        smallest_lump=1.1,
        largest_lump=2.1,
        lumps_per_minute=14.0,
        dust=one_of(0, 0.2, 0.4, 0.7, 1),
        dust_burst=one_of(0, 0, 1.5),
        night=one_of(0, 0, 0, 0.4, 0.7, 1),
        lump_contrast=one_of(1, 1, 0.8, 0.6, 0.4),
        smooth_share=float(smooth),
        slab_share=float(slab),
        frozen_share=float(frozen),
        buried_share=one_of(0, 0, 0.3),
        cluster_share=one_of(0, 0, 0.5),
        touching_share=one_of(0, 0, 0.3),
        roll_share=one_of(0, 0, 0.3),
        noise=one_of(1, 2.5, 5, 9),
        light_step=float(rng.uniform(0.4, 1.7)),
        light_step_at_s=30.0,
        medium_rocks_per_minute=one_of(20, 70, 120),
        near_limit_rocks_per_minute=one_of(0, 0, 6, 12),
        rain=one_of(0, 0, 0, 0.5),
        lens_drops=int(one_of(0, 0, 0, 6)),
        snow=one_of(0, 0, 0, 0.4),
        steam=one_of(0, 0, 0, 0.3),
        exposure_jump=one_of(1, 1, 2.5),
        sun_patches=one_of(0, 0, 0.8),
        shadow_edges=one_of(0, 0, 0.5),
        shake_px=one_of(0.5, 0.5, 4),
    )


@dataclass
class Watched:
    """Working pictures of a feed with its lumps."""

    roi: Roi
    pictures: list[Image]
    boxes: list[np.ndarray]
    """States of the lumps of each picture."""
    seen: list[np.ndarray]
    """Share of each that shows."""
    ids: list[np.ndarray]


def watch(seed: int, seconds: float = 60.0, every: int = 15) -> Watched:
    """Pictures of a feed; every fourth comes through a poor link."""
    spec = lump_feed(seed)
    feed = FeedSimulator(spec)
    # A camera far away or a small picture shows the same belt with fewer pixels.
    working = round(JdtConfig().working_size_px * (1.0, 1.0, 0.7, 0.5)[seed // 2 % 4])
    roi = make_roi(feed.polygon, spec.width, spec.height, working)
    watched = Watched(roi, [], [], [], [])
    for i in range(round(seconds * spec.fps)):
        if i % every:
            feed.skip()
            continue
        picture, truths = feed.render()
        gray = roi.cut(picture)
        if seed % 4 == 3:
            packed = cv2.imencode(".jpg", gray, [cv2.IMWRITE_JPEG_QUALITY, 15 + seed % 30])[1]
            gray = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
        states = blank(len(truths))
        if truths:
            states[:, [X, Y, W, H]] = roi.to_working(np.array([[t.x, t.y, t.w, t.h] for t in truths]))
        watched.pictures.append(gray)
        watched.boxes.append(states)
        watched.seen.append(np.array([t.visibility for t in truths]))
        watched.ids.append(np.array([t.id for t in truths]))
    return watched


def sizes_of(feeds: list[Watched]) -> RowProfile:
    """Sizes by row of all whole lumps of feeds by one camera, as wide as a training leaves them.

    Lengths in ROI heights.
    """
    states, starts = [], []
    for feed in feeds:
        tracks: dict[int, list[np.ndarray]] = {}
        for boxes, seen, ids in zip(feed.boxes, feed.seen, feed.ids, strict=True):
            for state, share, lump in zip(boxes, seen, ids, strict=True):
                if share > 0.95:
                    tracks.setdefault(lump, []).append(state / feed.roi.shape[0])
        for track in tracks.values():
            states += track
            starts += [True] + [False] * (len(track) - 1)
    profile = with_sizes(default_profile(1.0, 0.1, 0.2, 1.0), np.array(states), np.array(starts), 1.0)
    spread = profile.spread.copy()
    spread[:, 2:] = 0.25
    return RowProfile(profile.first_row, profile.row_step, profile.mean, spread)


def default_lump() -> LumpFit:
    """Fit on all feeds, then lowered until boxes of all sizes elsewhere are quiet."""
    feeds = [watch(seed) for seed in range(9000, 9048)]
    by_style = [sizes_of(feeds[style::2]) for style in (0, 1)]
    views, births, anywhere = [], [], []
    smallest, largest = JdtConfig().size_h
    for k, feed in enumerate(feeds):
        height = float(feed.roi.shape[0])
        any_size = default_profile(height, smallest * height, largest * height, DEFAULT_SPEED_H_S * height)
        law = polygon_births(feed.roi.mask, by_style[k % 2].scaled(height), np.ones(1))
        free = polygon_births(feed.roi.mask, any_size, np.ones(1))
        for picture, boxes, seen in zip(feed.pictures, feed.boxes, feed.seen, strict=True):
            views.append(LabelledView(feed.roi.view(picture), boxes[seen > 0.6]))
            births.append(law)
            anywhere.append(free)
    fit = fit_lump(views, births, np.random.default_rng(1), ridge=3e-4)
    return lowered(fit, views, anywhere, QUIET, np.random.default_rng(2))


def demo_prior() -> Prior:
    """Train the demo's ROI on a feed of another seed."""
    config = parse(demo_config(Path("var"), 0)).camera(CAMERA)
    roi = config.roi(ROI)
    with tempfile.TemporaryDirectory() as folder:
        files = write_video(FeedSpec(seed=9100), 90.0, Path(folder))
        frames, _ = read_frames(config, files.video)
        trained = train(roi, frames, read_labels(files.labels), files.labels, "simulated feed, seed 9100")
    return trained.as_prior(CAMERA, roi, "simulated feed, seed 9100", datetime(2026, 1, 1, tzinfo=UTC))


def _source(fit: LumpFit) -> str:
    def numbers(values: np.ndarray) -> str:
        rows = [", ".join(f"{v:.5f}" for v in values[i : i + 8]) for i in range(0, len(values), 8)]
        return "[\n            " + ",\n            ".join(rows) + ",\n        ]"

    fields = ",\n".join(
        f"    {name}=np.array(\n        {numbers(getattr(fit, name))}\n    )"
        for name in ("mean", "scale", "weights")
    )
    return f"{HEAD}DEFAULT_LUMP = LumpFit(\n{fields},\n    offset={fit.offset:.5f},\n)\n"


if __name__ == "__main__":
    package = Path(service.__file__).parent
    (package / "default_lump.py").write_text(_source(default_lump()), encoding="utf-8")
    (package / "feed" / "demo.prior").write_bytes(encode(demo_prior()))
