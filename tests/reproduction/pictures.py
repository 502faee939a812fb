"""The pictures of the documentation, from a real training and a real replay.

python -m tests.reproduction.pictures     README: overlay and existence curve, with the prior that ships
"""

from __future__ import annotations

import tempfile
from datetime import UTC, datetime
from importlib.resources import as_file, files
from pathlib import Path

import cv2

from lumpwatch.service.cli.demo import CAMERA, ROI, demo_config
from lumpwatch.service.config import parse_config
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.offline.overlay import draw
from lumpwatch.service.offline.plots import ExistenceCurves, draw_prior
from lumpwatch.service.simulator.spec import FeedSpec
from lumpwatch.service.storage import read_file
from lumpwatch.service.training import Recording, learn_reference
from tests.reproduction.lumps import feed_frames, train_on_feed

IMAGES = Path(__file__).parents[2] / "docs" / "images"
REFERENCE_SEED = 9100
SEED, SHOWN_FRAMES, ZOOM = 24, (110, 240, 553), 0.75


def main() -> None:
    """Write overlay, existence curve and prior."""
    readme()
    with tempfile.TemporaryDirectory() as folder:
        _, prior = train_on_feed(Path(folder))
    draw_prior(prior.with_version(1), IMAGES / "prior.png")


def readme() -> None:
    """Write overlay and existence curve: a minute of another seed than the shipped prior learned from."""
    IMAGES.mkdir(exist_ok=True)
    with as_file(files("lumpwatch.service.simulator") / "demo.prior") as path:
        prior = read_file(path)
    camera = parse_config(demo_config(Path("var"), SEED)).camera(CAMERA)
    fit = Recording("simulated feed", feed_frames(FeedSpec(seed=REFERENCE_SEED), 30.0))
    learned = learn_reference(camera, {"day": [fit]}, 1e-3, datetime(2026, 1, 1, tzinfo=UTC))
    pipeline = CameraPipeline(camera, {ROI: prior}, reference=learned.reference)
    curves = ExistenceCurves({ROI: camera.roi(ROI).alarm.raise_above})
    shown = []
    for frame in feed_frames(FeedSpec(seed=SEED), 60.0):
        results = pipeline.process(frame, frame.received_s)
        curves.add(frame.capture_s, results)
        if frame.seq in SHOWN_FRAMES:
            picture = draw(frame, results, pipeline)
            shown.append(cv2.resize(picture, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_AREA))
    curves.save(IMAGES / "existence.png")
    cv2.imwrite(str(IMAGES / "overlay.jpg"), cv2.hconcat(shown), (cv2.IMWRITE_JPEG_QUALITY, 85))


if __name__ == "__main__":
    readme()
