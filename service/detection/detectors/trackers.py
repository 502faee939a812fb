"""The trackers of many objects as detectors of a ROI (papers 2 and 3).

A tracker follows everything that moves, and all tracks that it stands by are listed. What counts for the
alarm are those as large as the objects to be found; the ROI's existence is the probability that one of
them exists.
"""

from __future__ import annotations

import numpy as np

from lumpwatch.models.jdt.row_profile import SIZE_LIMIT
from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Image, Roi
from lumpwatch.models.state import Belief
from lumpwatch.models.trackers.imm_pf import BoxSize, ProfileSize
from lumpwatch.models.trackers.tracked import TrackedObject
from lumpwatch.service.config import ImmPfConfig, JpdaConfig
from lumpwatch.service.core import DetectedObject, Detection, NotCounted
from lumpwatch.service.detection.detectors.base import (
    LONGEST_STEP_S,
    FilterState,
    StateMismatchError,
)
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S, make_models, make_profile
from lumpwatch.service.detection.detectors.tracker_parts import (
    GatedForeground,
    make_foreground,
    make_imm_pf,
    make_jpda,
)

BOX_SPREAD = 0.1
"""Standard deviation of a tracker's width and height, as a share: it states none."""
TURN_S = 0.5
"""A velocity is known as well as the position over this time."""


class TrackerDetector:
    """Satisfies `lumpwatch.service.detection.detectors.base.Detector`."""

    def __init__(self, config: ImmPfConfig | JpdaConfig, roi: Roi, learned: Learned | None) -> None:
        """Raises PriorMismatchError."""
        self.roi = roi
        self._config = config
        self._rng = np.random.default_rng(config.seed)
        fit = None if learned is None else learned.tracker
        interval_s = DEFAULT_INTERVAL_S if learned is None else learned.interval_s
        scene = None if fit is None else fit.scene
        self._foreground = GatedForeground(make_foreground(config, interval_s), scene, config.seed)
        self._outside = roi.mask == 0
        self._names = [model.name for model in config.models]
        self._last_id = self._id_offset = 0
        self.use(learned)

    @property
    def learns(self) -> bool:
        """Whether the next pictures may teach the background model."""
        return self._foreground.learns

    @learns.setter
    def learns(self, may: bool) -> None:
        self._foreground.learns = may

    def use(self, learned: Learned | None) -> None:
        """Take another prior: all tracks start anew, the background stays. Raises PriorMismatchError."""
        height = float(self.roi.shape[0])
        models = make_models(self._config.models, learned, height)
        profile = make_profile(self._config.size_h, learned, self.roi)
        self._parts = models, profile
        line = learned.tracker.size if learned is not None and learned.tracker is not None else None
        scene = learned.tracker.scene if learned is not None and learned.tracker is not None else None
        self._cover = None if scene is None else scene.covering(self.roi.shape)
        self._size: BoxSize = ProfileSize(profile) if line is None else line.scaled(height)
        self._start()

    def _start(self) -> None:
        models, _ = self._parts
        self._id_offset = self._last_id
        if isinstance(self._config, ImmPfConfig):
            self._tracker = make_imm_pf(
                self._config, models, self._size, self._foreground, self._rng, self._cover
            )
        else:
            self._tracker = make_jpda(self._config, models, self.roi, self._foreground)

    def state(self) -> FilterState | None:
        """None: the background model learned over hours cannot be carried over."""
        return None

    def restore(self, state: FilterState) -> None:
        """Not possible. Raises StateMismatchError."""
        raise StateMismatchError("a tracker cannot go on from a stored state")

    def clouds(self) -> tuple[Belief, ...]:
        """None: a tracker shows its model shares instead."""
        return ()

    def step(self, gray: Image, colour: Image | None, dt: float) -> Detection:
        """One working picture, `dt` seconds after the last."""
        if colour is None:
            raise ValueError("a tracker needs colour")
        if dt > LONGEST_STEP_S:
            self._start()
            dt = DEFAULT_INTERVAL_S
        # What lies outside the polygon never changes, so nothing moves there.
        picture = colour.copy()
        picture[self._outside] = 0
        tracked = self._tracker.step(picture, dt)
        objects = tuple(self._describe(track) for track in tracked if track.confirmed)
        none = [1.0 - found.existence for found in objects if found.counts]
        self._last_id = max((self._last_id, *(track.id + self._id_offset for track in tracked)))
        return Detection(1.0 - float(np.prod(none)), objects)

    def _why_not(self, tracked: TrackedObject) -> NotCounted | None:
        """None where the object is as large as those to be found are at its row."""
        if isinstance(self._config, ImmPfConfig):
            return None  # its boxes have the size of what is looked for
        mean, spread = self._parts[1].at(tracked.box[1:2])
        size = 0.5 * float(np.log(tracked.box[2] * tracked.box[3]))
        expected, reach = 0.5 * float(mean[0, 2:].sum()), SIZE_LIMIT * float(spread[0, 2:].max())
        if abs(size - expected) <= reach:
            return None
        return NotCounted.TOO_SMALL if size < expected else NotCounted.TOO_LARGE

    def _describe(self, tracked: TrackedObject) -> DetectedObject:
        x, y, w, h = (float(v) for v in self.roi.to_frame(tracked.box[None])[0])
        spread = tracked.spread / self.roi.scale
        shares = tracked.model_shares
        return DetectedObject(
            tracked.id + self._id_offset,
            x,
            y,
            w,
            h,
            float(spread[0]),
            float(spread[1]),
            tracked.existence,
            self._names[int(shares.argmax())],
            tuple(zip(self._names, shares.tolist(), strict=True)),
            tracked.wrong_way,
            vx=float(tracked.velocity[0] / self.roi.scale),
            vy=float(tracked.velocity[1] / self.roi.scale),
            spread_w=BOX_SPREAD * w,
            spread_h=BOX_SPREAD * h,
            spread_v=float(spread.max()) / TURN_S,
            not_counted=self._why_not(tracked),
        )
