"""Runs the shadow priors of one camera on the frames that the priors in use have decided.

It is shown results and gives none back: nothing of a shadow can come into a decision. What a shadow
raises ends it, with a line in the log and a count.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import Protocol

from lumpwatch.service.belt import camera_pace
from lumpwatch.service.config import CameraConfig, RoiConfig
from lumpwatch.service.core import Frame, RoiResult
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.picture_judge import EveryPictureFit
from lumpwatch.service.detection.region_channel import MakeDetector, RegionChannel
from lumpwatch.service.detection.shadow.budget import Budget
from lumpwatch.service.detection.shadow.differences import Difference, Differences
from lumpwatch.service.errors import LumpwatchError
from lumpwatch.service.protocol import Counts, ShadowState
from lumpwatch.service.storage import Prior

log = logging.getLogger(__name__)


class ShadowObserver(Protocol):
    """Observes what the shadows do; implemented by metrics."""

    def shadow_counted(self, roi: str, before: Counts, after: Counts) -> None:
        """The counts of a ROI have changed."""

    def shadow_runs(self, roi: str, version: int) -> None:
        """Which version runs; 0: none does."""

    def shadow_decided(self, roi: str, existence: float) -> None:
        """The probability of a lump by the shadow."""

    def shadow_failed(self, roi: str, reason: str) -> None:
        """A shadow ended: `unfit` for this ROI, or `failed`."""


class UnobservedShadows:
    """An observer that ignores everything."""

    def shadow_counted(self, roi: str, before: Counts, after: Counts) -> None:
        """Nothing."""

    def shadow_runs(self, roi: str, version: int) -> None:
        """Nothing."""

    def shadow_decided(self, roi: str, existence: float) -> None:
        """Nothing."""

    def shadow_failed(self, roi: str, reason: str) -> None:
        """Nothing."""


@dataclass(slots=True)
class _Shadow:
    """One prior on trial."""

    prior: Prior
    current: int
    since: datetime
    differences: Differences
    channel: RegionChannel
    pictures: EveryPictureFit
    failed: str | None = None

    @property
    def name(self) -> str:
        """Of the region."""
        return self.channel.config.id

    @property
    def last_s(self) -> float | None:
        """Time of its last step."""
        return self.channel.last_s

    @property
    def existence(self) -> float | None:
        """The probability of a lump then."""
        return None if self.channel.detection is None else self.channel.detection.existence

    def step(self, frame: Frame, offset_px: tuple[int, int] = (0, 0)) -> None:
        """Filter and decide one frame, the region moved by so much; raises whatever is wrong."""
        self.channel.fit(frame.width, frame.height)
        self.pictures.offset_px = offset_px
        self.channel.step(frame)

    def is_recent(self, time_s: float, blind_after_s: float) -> bool:
        """Whether its last step is recent enough to compare."""
        return self.last_s is not None and time_s - self.last_s <= blind_after_s


class Shadows:
    """The shadows of one camera; used by one thread, no method raises for what a shadow does."""

    def __init__(
        self,
        config: CameraConfig,
        wall: Callable[[], datetime],
        clock: Callable[[], float] | None,
        observer: ShadowObserver | None = None,
        make: MakeDetector = make_detector,
    ) -> None:
        """`clock` times the work, in seconds; None: a shadow filters every frame, however long it takes."""
        self._config = config
        self._wall = wall
        self._clock = clock
        self._observer: ShadowObserver = observer or UnobservedShadows()
        self._make = make
        self._budget = Budget()
        self._shadows: dict[str, _Shadow] = {}
        self._last: Frame | None = None
        self._due: tuple[tuple[int, int], float] | None = None
        """Size of the pictures, and `_due_every_s` for it."""

    def use(
        self, roi_id: str, prior: Prior | None, current: int = 0, kept: ShadowState | None = None
    ) -> None:
        """Run a prior in shadow from the next frame on, or none any more.

        `kept` is what was counted before a restart, for the same two versions.
        """
        self._budget.forget(roi_id)
        self._shadows.pop(roi_id, None)
        self._observer.shadow_runs(roi_id, 0 if prior is None else prior.version)
        if prior is None:
            return
        if kept is not None and (kept.version, kept.current) != (prior.version, current):
            kept = None
        counts = Counts() if kept is None else kept.counts
        since = self._wall() if kept is None else kept.since
        self._shadows[roi_id] = self._make_shadow(self._config.roi(roi_id), prior, current, since, counts)

    def follow(self, results: tuple[RoiResult, ...], spent_s: float) -> None:
        """Filter the frame of these results; the priors in use took `spent_s` for it."""
        decided = [
            result
            for result in results
            if result.fit and result.roi in self._shadows and result.frame is not None
        ]
        if not decided or decided[0].frame is None:
            return
        self._earn(decided[0].frame, spent_s)
        # Who has waited longest comes first, so that time that is short is shared.
        for result in sorted(decided, key=lambda result: self._shadows[result.roi].last_s or float("-inf")):
            shadow = self._shadows[result.roi]
            if shadow.failed is None:
                self._follow(shadow, result)

    def state(self, roi_id: str) -> ShadowState | None:
        """The state of the shadow of a ROI, to publish; None: there is none."""
        shadow = self._shadows.get(roi_id)
        if shadow is None:
            return None
        return ShadowState(
            camera=self._config.id,
            roi=roi_id,
            version=shadow.prior.version,
            current=shadow.current,
            since=shadow.since,
            time=self._wall(),
            failed=shadow.failed,
            existence=shadow.existence,
            lump=shadow.channel.alarm.active,
            **asdict(shadow.differences.counts),
        )

    def _make_shadow(
        self, roi: RoiConfig, prior: Prior, current: int, since: datetime, counts: Counts
    ) -> _Shadow:
        differences = Differences(roi.learning.shadow_match_s, self._config.blind_after_s, counts)
        pictures = EveryPictureFit()
        channel = RegionChannel(roi, prior, pictures=pictures, make=self._make)
        return _Shadow(prior, current, since, differences, channel, pictures)

    def _earn(self, frame: Frame, spent_s: float) -> None:
        last, self._last = self._last, frame
        if last is None or frame.seq <= last.seq:
            return
        since_s = frame.capture_s - last.capture_s
        # Where frames were skipped, the interval is still that of the camera, or of the frames that are due: nothing is
        # left of it.
        camera_s = since_s / (frame.seq - last.seq)
        self._budget.earn(min(since_s, max(camera_s, self._due_every_s(frame))), spent_s)

    def _due_every_s(self, frame: Frame) -> float:
        """The interval of the ROI that is decided on most often; 0: every frame is."""
        size = frame.width, frame.height
        if self._due is None or self._due[0] != size:
            rate_hz = camera_pace(self._config, *size).rate_hz
            self._due = size, 0.0 if rate_hz is None else 1.0 / rate_hz
        return self._due[1]

    def _follow(self, shadow: _Shadow, result: RoiResult) -> None:
        assert result.frame is not None
        if result.prior != shadow.current:  # compared with another one from now on
            shadow.current, shadow.since = result.prior, self._wall()
            shadow.differences = Differences(
                shadow.channel.config.learning.shadow_match_s, self._config.blind_after_s
            )
        counts = shadow.differences.counts
        try:
            stepped = self._step(shadow, result.frame, result.quality.offset_px)
        except Exception as error:  # whatever it is: the shadow ends, the prior in use decides on
            self._end(shadow, error)
            return
        now = shadow.differences.counts
        shadow.differences.counts = replace(
            now, frames=now.frames + stepped, skipped=now.skipped + (not stepped)
        )
        if shadow.existence is not None:
            self._observer.shadow_decided(shadow.name, shadow.existence)
        self._compare(shadow, result)
        self._observer.shadow_counted(shadow.name, counts, shadow.differences.counts)

    def _step(self, shadow: _Shadow, frame: Frame, offset_px: tuple[int, int]) -> bool:
        if self._clock is None:
            shadow.step(frame, offset_px)
            return True
        if not self._budget.allows(shadow.name):
            return False
        started = self._clock()
        try:
            shadow.step(frame, offset_px)
        finally:
            self._budget.spend(shadow.name, self._clock() - started)
        return True

    def _compare(self, shadow: _Shadow, result: RoiResult) -> None:
        assert result.frame is not None
        time_s = result.frame.capture_s
        if not shadow.is_recent(time_s, self._config.blind_after_s):
            shadow.differences.interrupt()
            return
        for difference in shadow.differences.step(time_s, result.alarm.active, shadow.channel.alarm.active):
            self._log(shadow, difference)

    def _log(self, shadow: _Shadow, difference: Difference) -> None:
        where = f"{self._config.id}/{shadow.name}: shadow version {shadow.prior.version}"
        if difference.side == "both":
            log.info("%s: alarm of both, the shadow %+.1f s earlier", where, difference.lead_s)
        elif difference.side == "only_current":
            log.info("%s: raises no alarm where version %d does", where, shadow.current)
        else:
            log.info("%s: would raise an alarm where version %d does not", where, shadow.current)

    def _end(self, shadow: _Shadow, error: Exception) -> None:
        roi = shadow.name
        self._budget.forget(roi)
        shadow.channel.close()
        shadow.failed = f"{type(error).__name__}: {error}"
        unfit = isinstance(error, LumpwatchError)
        log.error(
            "%s/%s: shadow version %d ended: %s",
            self._config.id,
            roi,
            shadow.prior.version,
            error,
            exc_info=None if unfit else error,
        )
        self._observer.shadow_failed(roi, "unfit" if unfit else "failed")
        self._observer.shadow_runs(roi, 0)
