"""One region's channel: what it fits, what a step does to it, and that it can go on from a snapshot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import JdtConfig, RoiConfig
from lumpwatch.service.config.detector import DetectorConfig
from lumpwatch.service.core.alarm import AlarmState, Change
from lumpwatch.service.core.crop import working_luma
from lumpwatch.service.core.detection import Detection
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.channel import RegionMisfitError
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from lumpwatch.service.detection.picture_judge import EveryPictureFit
from lumpwatch.service.detection.region_channel import RegionChannel
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.storage.prior_file import Prior
from tests.service_helpers import HEIGHT, WIDTH, camera, frame, prior

ROI = camera().rois[0]


def channel(used: Prior | None = None, config: RoiConfig = ROI) -> RegionChannel:
    made = RegionChannel(config, used or prior(version=3))
    made.fit(WIDTH, HEIGHT)
    return made


def scene(dark: int, bright: int) -> list[Frame]:
    return [frame(k, bright=k >= dark) for k in range(dark + bright)]


def said(target: RegionChannel, frames: list[Frame]) -> list[tuple[Detection | None, AlarmState]]:
    out = []
    for one in frames:
        target.step(one)
        out.append((target.detection, target.alarm.state))
    return out


def test_the_alarm_is_raised_after_its_delay() -> None:
    target = channel()
    made = [target.step(one) for one in scene(5, 15)]
    (raised,) = [one for one in made if one is not None]
    assert (raised.change, target.alarm.state) == (Change.RAISED, AlarmState.UNACKNOWLEDGED)
    assert raised.time_s >= 0.7 - 1e-6


def test_pictures_that_were_cut_already_are_judged_alike() -> None:
    frames, whole, cut = scene(4, 10), channel(), channel()
    for one in frames:
        whole.step(one)
        assert cut.detector is not None
        cut.step_working(working_luma(one, cut.detector.roi), None, one.capture_s)
        assert (cut.detection, cut.alarm) == (whole.detection, whole.alarm)
    assert whole.alarm.active


def test_a_region_that_moved_with_the_camera_is_cut_there_and_told_there() -> None:
    frames = scene(0, 8)
    still, moved = channel(), RegionChannel(ROI, prior(), pictures=(pictures := EveryPictureFit()))
    moved.fit(WIDTH, HEIGHT)
    pictures.offset_px = (4, -2)
    for one in frames:
        still.step(one)
        moved.step(replace(one, data=np.roll(one.data, (-2, 4), axis=(0, 1))))
    assert still.detection is not None
    assert still.detection.objects
    assert moved.detection == still.detection.moved(4, -2)


def test_it_goes_on_from_a_snapshot_to_the_bit() -> None:
    frames, live, later = scene(5, 15), channel(), channel()
    said(live, frames[:8])
    later.restore(live.snapshot())
    assert said(later, frames[8:]) == said(live, frames[8:])


def test_a_prior_that_does_not_fit_raises_where_nobody_is_told() -> None:
    with pytest.raises(LumpwatchError, match="another shape"):
        channel(prior(aspect=1.0))


def test_a_refused_prior_gives_way_to_the_defaults_where_somebody_is() -> None:
    told: list[LumpwatchError] = []
    config = camera(likelihood={"kind": "lump"}).rois[0]
    target = RegionChannel(config, prior(aspect=1.0), refused=told.append)
    target.fit(WIDTH, HEIGHT)
    assert len(told) == 1
    assert target.prior is None
    assert target.size == (WIDTH, HEIGHT)


def test_a_size_that_does_not_fit_leaves_no_filter_behind() -> None:
    target = channel()
    target.step(frame(0))
    with pytest.raises(RegionMisfitError, match="8 x 6 pixels"):
        target.fit(10, 8)
    assert (target.detector, target.size, target.detection) == (None, None, None)
    with pytest.raises(RegionMisfitError):
        target.step(frame(1))
    target.fit(WIDTH, HEIGHT)
    target.step(frame(2))
    assert target.detection is not None


class Saying(JdtDetector):
    """A detector that says what it is told to."""

    said = 0.0

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        return Detection(self.said, ())


@pytest.mark.parametrize("existence", [float("nan"), float("inf"), -0.1, 1.1])
def test_what_is_no_probability_is_an_error_and_not_clear(existence: float) -> None:
    def make(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
        assert isinstance(config, JdtConfig)
        made = Saying(config, roi, learned)
        made.said = existence
        return made

    target = RegionChannel(ROI, prior(), make=make)
    target.fit(WIDTH, HEIGHT)
    before = target.alarm
    with pytest.raises(ValueError, match="is not a probability"):
        target.step(frame(0))
    assert (target.alarm, target.detection) == (before, None)
