"""Fits what ships with the product: `python -m tests.reproduction.defaults`.

service/default_lump.py        the lump likelihood of a ROI without a prior, from six simulated
                               feeds of different dust, light and grain, with boxes of all sizes
service/feed/demo.prior        the prior of the demo, trained on 90 s of the simulated feed
"""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

import service
from models.births import polygon_births
from models.learning import LabelledView, LumpFit, fit_lump
from models.profile import default_profile
from models.roi import make_roi
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
from service.training import train

HEAD = '''"""The lump likelihood of a ROI without a prior; made by `python -m tests.reproduction.defaults`."""

from __future__ import annotations

import numpy as np

from models.learning.learned import LumpFit

'''


def lump_views(spec: FeedSpec, seconds: float, every: int) -> tuple[list[LabelledView], np.ndarray]:
    """Working pictures of a feed with its lumps, and the mask of its ROI."""
    feed = FeedSimulator(spec)
    roi = make_roi(feed.polygon, spec.width, spec.height, JdtConfig().working_size_px)
    views = []
    for i in range(round(seconds * spec.fps)):
        if i % every:
            feed.skip()
            continue
        picture, truths = feed.render()
        states = blank(len(truths))
        if truths:
            boxes = np.array([[t.x, t.y, t.w, t.h] for t in truths])
            states[:, [X, Y, W, H]] = roi.to_working(boxes)
        views.append(LabelledView(roi.view(roi.cut(picture)), states))
    return views, roi.mask


def default_lump() -> LumpFit:
    """Fit on feeds that differ in everything but the geometry."""
    views: list[LabelledView] = []
    for seed in range(6):
        spec = FeedSpec(
            seed=9000 + seed,
            dust=0.12 * seed,
            light_step=0.5 + 0.25 * seed,
            light_step_at_s=30.0,
            noise=1.5 + seed,
            medium_rocks_per_minute=30.0 * (1 + seed % 3),
        )
        more, mask = lump_views(spec, seconds=60.0, every=6)
        views += more
    smallest, largest = (size * mask.shape[0] for size in JdtConfig().size_h)
    profile = default_profile(mask.shape[0], smallest, largest, DEFAULT_SPEED_H_S * mask.shape[0])
    return fit_lump(views, polygon_births(mask, profile, np.ones(1)), np.random.default_rng(1))


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
