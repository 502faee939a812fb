"""What training lets a region watch is judged as the pipeline judges it live."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lumpwatch.service.config import CameraConfig
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.training.footage import Footage, read_footage
from lumpwatch.service.training.watching import watch
from tests.service_helpers import camera, frame, learned, prior, site, site_tree

CALIBRATION = {
    "points": [[0.2, 0.2], [0.8, 0.2], [0.9, 0.9], [0.1, 0.9]],
    "points_mm": [[0, 0], [1500, 0], [1500, 3000], [0, 3000]],
    "lip": [[0.1, 0.9], [0.9, 0.9]],
    "limit_mm": 600,
}


def calibrated() -> CameraConfig:
    tree = site_tree()
    tree["cameras"][0]["rois"][0]["calibration"] = CALIBRATION
    return site(tree).cameras[0]


def scene(dark: int, bright: int, dark_again: int) -> list[Frame]:
    return [frame(k, bright=dark <= k < dark + bright) for k in range(dark + bright + dark_again)]


def footage_of(config: CameraConfig, frames: list[Frame]) -> Footage:
    return read_footage(config.rois[0], iter(frames), (), lambda _: None)


@pytest.mark.parametrize("config", [camera(), calibrated()], ids=["existence", "oversize"])
def test_the_alarm_comes_and_goes_on_the_same_pictures_as_live(config: CameraConfig) -> None:
    """Delays, thresholds and sizes are those of the alarm: on a calibrated belt what is small raises none."""
    frames = scene(5, 20, 10)
    pipeline = CameraPipeline(config, {"apron": prior()})
    live = [result for one in frames for result in pipeline.process(one, one.received_s)]
    watched: list[tuple[Any, ...]] = []
    for (_, moment), channel in watch(config.rois[0], footage_of(config, frames), learned()):
        assert channel.detection is not None
        watched.append((moment.time_s, channel.detection, channel.alarm))
    assert watched == [(r.frame.capture_s if r.frame else None, r.detection, r.alarm) for r in live]
    assert max(r.existence for r in live) > 0.99
    raised = [r.transition for r in live if r.transition]
    assert bool(raised) == (config.rois[0].calibration is None)


def test_every_clip_begins_anew() -> None:
    one = footage_of(camera(), scene(2, 15, 0))
    again = [replace(moment, clip=1) for moment in one.moments]
    two = replace(one, views=[*one.views, *one.views], moments=[*one.moments, *again])
    said = [
        c.detection.existence if c.detection else None for _, c in watch(camera().rois[0], two, learned())
    ]
    assert said[:17] == said[17:]
    assert len(said) == 34


def test_only_what_is_wanted_is_watched() -> None:
    footage = footage_of(camera(), scene(2, 15, 0))
    seen = watch(camera().rois[0], footage, learned(), lambda moment: 3 <= moment.frame <= 9)
    assert [moment.frame for (_, moment), _ in seen] == [*range(3, 10)]
    assert np.all(np.diff([moment.time_s for moment in footage.moments]) > 0)
