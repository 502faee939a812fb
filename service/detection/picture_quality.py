"""Whether one camera's picture is fit to judge: measures -> findings -> the reason of each ROI.

The same object live and in replay: it reads no clock, times are those of frames. Measures are medians over
seconds against a learned reference, or against stated defaults that find a picture
that is black, white, without structure or frozen.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Mapping
from statistics import median

from lumpwatch.models.picture.activity import Activity
from lumpwatch.models.picture.measures import PictureMeter
from lumpwatch.models.picture.medians import JumpDetector, SlowMedian
from lumpwatch.models.picture.region import DEFAULTS, Measure, RegionReference, values
from lumpwatch.models.roi import Image, Roi
from lumpwatch.service.config import CheckConfig, QualityConfig
from lumpwatch.service.core import (
    BlindReason,
    DebounceTimes,
    Detection,
    Frame,
    PictureQuality,
    ReasonDebouncer,
)
from lumpwatch.service.detection.camera_shift import CameraShift
from lumpwatch.service.detection.strangers import Strangers
from lumpwatch.service.storage import BadReferenceError, Reference

_BRIGHTENED = 1.1  # a veil of dust is brighter than what it hides; a cover need not be
_NEARER = 0.05  # another light is taken when so many more tiles look like it
_BRIGHTNESS_COUNTS = 0.1  # tiles for a brightness that differs by a factor of e


class CameraQuality:
    """The checks of one camera."""

    def __init__(self, camera: str, config: QualityConfig, rois: tuple[str, ...]) -> None:
        self._config = config
        self._regions = {roi: _Region(config) for roi in rois}
        self._pace = _Pace()
        self._late = False
        self.shift = CameraShift(camera, config)
        """How far the camera has moved."""
        self.decide_hz: float | None = None
        """Frames a second that are judged by rule; None: all."""

    def fit(
        self,
        rois: Mapping[str, Roi],
        width: int,
        height: int,
        reference: Reference | None,
        mouths: Collection[str] = (),
    ) -> None:
        """Measure pictures of this size with these regions, against another reference or none.

        A region that is not among them is not measured; those that watch a mouth are not in the reference. Raises
        BadReferenceError for a reference of regions of another size in the working picture; all is then as before.
        """
        if reference is not None:
            for name, roi in rois.items():
                if name not in mouths:
                    _check_tiles(reference, name, PictureMeter(roi.mask).tiles)
        for name, region in self._regions.items():
            known = () if reference is None or name in mouths else reference.lights
            lights = tuple(light.regions[name] for light in known)
            if name in rois:
                region.fit(rois[name], lights)
            else:
                region.leave()
        self.shift.fit(rois, width, height, reference)

    def picture(self, frame: Frame, now_s: float) -> None:
        """The whole of a new frame, before its regions are observed."""
        if not self._config.enabled:
            return
        overload = self._config.overload
        self._pace.add(frame.seq, frame.capture_s, now_s - frame.received_s, overload.entry_s)
        self._late = (
            self._pace.age_s > overload.longest_age_s
            or self._pace.share(self.decide_hz) < overload.least_share
        )
        light = next((region.light for region in self._regions.values() if region.measured and region.lit), 0)
        self.shift.observe(frame, light)

    def placed(self, roi_id: str, roi: Roi, width: int, height: int) -> tuple[Roi, tuple[int, int]]:
        """Where a region lies now, and by how much it was moved."""
        place, offset = self.shift.placed(roi, width, height)
        self._regions[roi_id].offset_px = offset
        return place, offset

    def observe(self, roi: str, gray: Image, time_s: float) -> None:
        """The working picture (h, w) of a region."""
        if self._config.enabled:
            self._regions[roi].observe(gray, time_s)

    def strangers(self, roi: str, detection: Detection, time_s: float) -> tuple[int, ...]:
        """Identities of the objects that stand while the belt moves; after `observe`."""
        region = self._regions[roi]
        region.standing = (
            () if region.strangers is None else region.strangers.among(detection.objects, time_s)
        )
        return region.standing

    def filtered(self, roi: str, detection: Detection, time_s: float) -> None:
        """What the filter made of it; after `observe`."""
        if not self._config.enabled:
            return
        region = self._regions[roi]
        region.count_particles(detection.effective_particles, time_s)
        found = set(region.found)
        if self._late:
            found.add(BlindReason.OVERLOAD)
        if self.shift.lost:
            found.add(BlindReason.MOVED)
        if region.standing:
            found.add(BlindReason.HIDDEN)
        region.debouncer.step(time_s, found)

    def current(self, roi: str) -> PictureQuality:
        """What is known of a region's picture."""
        region = self._regions[roi]
        reason = region.debouncer.reason
        if reason is None and region.held_off:
            reason = BlindReason.EXPOSURE
        return PictureQuality(
            reason,
            region.suspect or bool(region.standing),
            region.held_off,
            region.holdoffs,
            dict(region.slow),
            region.thresholds,
            region.offset_px,
            region.standing,
        )


class _Region:
    """The checks of one region."""

    def __init__(self, config: QualityConfig) -> None:
        self._config = config
        checks: dict[BlindReason, CheckConfig] = {
            BlindReason.FILTER: config.filter,
            BlindReason.OVERLOAD: config.overload,
            BlindReason.FROZEN: config.frozen,
            BlindReason.DARK: config.dark,
            BlindReason.GLARE: config.glare,
            BlindReason.MOVED: config.moved,
            BlindReason.DUSTY: config.dusty,
            BlindReason.HIDDEN: config.hidden,
            BlindReason.BLURRED: config.blurred,
        }
        enabled = {reason: check for reason, check in checks.items() if check.enabled and config.enabled}
        self.debouncer = ReasonDebouncer(
            {reason: DebounceTimes(check.entry_s, check.exit_s) for reason, check in enabled.items()}
        )
        self.light = 0
        self.offset_px = (0, 0)
        self.held_off, self.holdoffs, self.suspect = False, 0, False
        self.slow: dict[Measure, float] = {}
        self.strangers: Strangers | None = None
        """None where they are not looked for."""
        self.standing: tuple[int, ...] = ()
        self._starved = False
        self._particles = SlowMedian(config.window_s)
        self._seen: set[BlindReason] = set()
        self._until_s = float("-inf")
        self._lights: tuple[RegionReference, ...] = ()
        self._meter: PictureMeter | None = None

    def fit(self, roi: Roi, lights: tuple[RegionReference, ...]) -> None:
        """Measure pictures of this region from now on."""
        window_s = self._config.window_s
        self._meter = PictureMeter(roi.mask)
        looked_for = self._config.enabled and self._config.hidden.enabled and self._config.hidden.standing
        self.strangers, self.standing = Strangers(roi) if looked_for else None, ()
        self._lights = lights
        self._activity = Activity(window_s)
        self._medians = {measure: SlowMedian(window_s) for measure in Measure}
        self._mean = SlowMedian(window_s)
        self._strange = [SlowMedian(window_s) for _ in lights]
        self._jumps = JumpDetector(self._config.exposure.factor)
        self._measured_s = float("-inf")
        self.light = min(self.light, max(len(lights) - 1, 0))

    def leave(self) -> None:
        """Measure nothing until the next `fit`."""
        self._meter, self.strangers, self.standing = None, None, ()
        self.suspect, self.held_off = False, False
        self.slow = {}

    @property
    def measured(self) -> bool:
        """Whether its pictures are."""
        return self._meter is not None

    @property
    def lit(self) -> bool:
        """Whether it is compared with a reference, and so knows the present light."""
        return bool(self._lights)

    @property
    def found(self) -> set[BlindReason]:
        """What the checks of this region find now."""
        return self._seen | ({BlindReason.FILTER} if self._starved else set())

    @property
    def thresholds(self) -> Mapping[Measure, float]:
        """Those of the present light, or the defaults."""
        return self._lights[self.light].thresholds if self._meter and self._lights else DEFAULTS

    def observe(self, gray: Image, time_s: float) -> None:
        """Measure the picture where it is time to."""
        self.held_off = time_s < self._until_s
        if self.strangers is not None:
            self.strangers.observe(gray, time_s)
        if self._meter is None or time_s < self._measured_s + 1.0 / self._config.rate_hz - 1e-3:
            return
        self._measured_s = time_s
        measures = self._meter.measure(gray)
        self._check_exposure(measures.mean, time_s)
        mean = self._mean.add(time_s, measures.mean)
        strange = [
            slow.add(time_s, light.pattern.strange(measures))
            for slow, light in zip(self._strange, self._lights, strict=True)
        ]
        self._choose_light(strange, mean)
        pattern = self._lights[self.light].pattern if self._lights else None
        now = values(measures, self._activity.add(time_s, gray), pattern)
        for measure in set(now) - {Measure.STRANGE}:
            # What changed within a window is slow already.
            median = self._medians[measure].add(time_s, now[measure])
            self.slow[measure] = now[measure] if measure is Measure.ACTIVITY else median
        if strange:
            self.slow[Measure.STRANGE] = strange[self.light]
        self._seen = self._reasons(self._beyond(self.slow), mean)
        self.suspect = bool(self._seen or self._reasons(self._beyond(now), measures.mean))

    def _choose_light(self, strange: list[float], mean: float) -> None:
        """Day or night: the one whose tiles the picture resembles more, and whose brightness."""
        unlike = [
            share + _BRIGHTNESS_COUNTS * abs(math.log(max(mean, 1.0) / max(light.mean, 1.0)))
            for share, light in zip(strange, self._lights, strict=True)
        ]
        if unlike and min(unlike) < unlike[self.light] - _NEARER:
            self.light = unlike.index(min(unlike))

    def _check_exposure(self, mean: float, time_s: float) -> None:
        if self._config.exposure.enabled and self._jumps.add(time_s, mean):
            self.holdoffs += not self.held_off
            self._until_s, self.held_off = time_s + self._config.exposure.hold_s, True

    def _beyond(self, found: Mapping[Measure, float]) -> set[Measure]:
        """Which of these measures are beyond their thresholds."""
        limits = self.thresholds
        return {
            measure
            for measure, value in found.items()
            if measure in limits
            and (value > limits[measure] if measure.too_large else value < limits[measure])
        }

    def _reasons(self, beyond: set[Measure], mean: float) -> set[BlindReason]:
        """What is wrong with a picture, in the words of the operator."""
        found = {_REASONS[measure] for measure in beyond if measure in _REASONS}
        if Measure.STRUCTURE in beyond:
            usual = self._lights[self.light].mean if self._lights else float("inf")
            found.add(BlindReason.DUSTY if mean > _BRIGHTENED * usual else BlindReason.HIDDEN)
        elif Measure.STRANGE in beyond and BlindReason.BLURRED not in found:
            found.add(BlindReason.HIDDEN)  # a blurred picture looks strange everywhere
        return {reason for reason in found if reason in self.debouncer.reasons}

    def count_particles(self, effective: float, time_s: float) -> None:
        """The filter's effective particles; 0 for one without particles."""
        if effective != 0.0:
            least = self._config.filter.least_particles
            self._starved = not self._particles.add(time_s, effective) >= least


def _check_tiles(reference: Reference, roi: str, tiles: int) -> None:
    """Raises BadReferenceError."""
    for light in reference.lights:
        known = light.regions.get(roi)
        if known is None or known.pattern.level_low.size != tiles:
            raise BadReferenceError(
                f"reference, roi {roi}: was learned on pictures of another size "
                f"({known.pattern.level_low.size if known else 0} tiles, now {tiles}); learn again"
            )


_REASONS = {
    Measure.BRIGHT: BlindReason.DARK,
    Measure.SATURATED: BlindReason.GLARE,
    Measure.SHARPNESS: BlindReason.BLURRED,
    Measure.ACTIVITY: BlindReason.FROZEN,
}


class _Pace:
    """Which share of the frames that should be is judged, and how old they are."""

    def __init__(self) -> None:
        self._frames: deque[tuple[float, int, float]] = deque()

    def add(self, seq: int, time_s: float, age_s: float, window_s: float) -> None:
        """The next frame."""
        if self._frames and seq <= self._frames[-1][1]:
            self._frames.clear()  # the camera's process began anew
        self._frames.append((time_s, seq, age_s))
        while self._frames[0][0] < time_s - window_s:
            self._frames.popleft()

    def share(self, rate_hz: float | None) -> float:
        """Of the frames between the oldest and the newest in the window that are due at so many a second."""
        between: float = self._frames[-1][1] - self._frames[0][1]
        if rate_hz is not None:
            between = min(between, rate_hz * (self._frames[-1][0] - self._frames[0][0]))
        return (len(self._frames) - 1) / between if between else 1.0

    @property
    def age_s(self) -> float:
        """The median."""
        return median(age for _, _, age in self._frames)
