"""The pictures of the documentation, from a real training and a real replay."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2

from lumpwatch.service.cli.demo import ROI
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.offline.overlay import draw
from lumpwatch.service.offline.plots import ExistenceCurves, draw_prior
from lumpwatch.service.simulator.spec import FeedSpec
from tests.reproduction.lumps import feed_frames, train_on_feed

IMAGES = Path(__file__).parents[2] / "docs" / "images"
SEED, SHOWN_FRAMES, ZOOM = 24, (110, 240, 553), 0.75


def main() -> None:
    """Write overlay, existence curve and prior."""
    IMAGES.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        camera, prior = train_on_feed(Path(folder))
    draw_prior(prior.with_version(1), IMAGES / "prior.png")
    pipeline = CameraPipeline(camera, {ROI: prior})
    curves = ExistenceCurves()
    shown = []
    for frame in feed_frames(FeedSpec(seed=SEED), 60.0):
        results = pipeline.process(frame, frame.received_s)
        curves.add(frame.capture_s, results)
        if frame.seq in SHOWN_FRAMES:
            picture = draw(frame, results, pipeline)
            shown.append(cv2.resize(picture, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_AREA))
    curves.save(IMAGES / "existence.png")
    cv2.imwrite(str(IMAGES / "overlay.jpg"), cv2.hconcat(shown), (cv2.IMWRITE_JPEG_QUALITY, 85))
