"""The two peers that follow nothing: a likelihood map with a threshold, and moving blobs of the right size."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from lumpwatch.models.evaluation import overlaps
from lumpwatch.models.jdt.row_profile import SIZE_LIMIT, RowProfile
from lumpwatch.models.roi import Roi
from lumpwatch.models.state import H, States, W, X, Y, blank
from lumpwatch.models.trackers.foreground import cleaned, regions
from lumpwatch.service.config.cameras import RoiConfig
from lumpwatch.service.config.jdt import JdtConfig
from lumpwatch.service.core.crop import working_luma
from lumpwatch.service.core.frame import Frame
from lumpwatch.service.detection.detectors.filters import make_likelihood, make_profile
from lumpwatch.service.detection.region import make_region
from lumpwatch.service.storage.prior_file import Prior

Boxes = NDArray[np.float64]
_NO_SIZES = np.empty((0, 3))


@dataclass(frozen=True, slots=True)
class Said:
    """What a method says of one frame."""

    alarming: float
    """What its alarm judges, 0 to 1."""
    boxes: Boxes
    """x, y, w, h of what it shows, full-frame pixels (m, 4)."""
    sizes: NDArray[np.float64] = field(default_factory=lambda: _NO_SIZES)
    """Longest diameter and the ends of its interval, mm (m, 3), NaN where not stated; (0, 3) without."""


class _OnRoi:
    """A working picture and what training saw at each of its rows."""

    def __init__(self, config: RoiConfig, prior: Prior) -> None:
        detector = config.detector
        assert isinstance(detector, JdtConfig)
        self._config, self._detector, self._prior = config, detector, prior
        self._roi: Roi | None = None

    def _picture(self, frame: Frame) -> tuple[Roi, NDArray[np.uint8]]:
        if self._roi is None:
            self._roi = make_region(self._config, frame.width, frame.height)
            self._begin(self._roi)
        return self._roi, working_luma(frame, self._roi)

    def _begin(self, roi: Roi) -> None:
        """Prepare for pictures of this ROI."""

    def _profile(self, roi: Roi) -> RowProfile:
        return make_profile(self._detector.size_h, self._prior.learned, roi)


class MapWatcher(_OnRoi):
    """The likelihood over a dense grid of the boxes that a lump may have at each row; its maximum counts.

    It shows the best box and up to two more that do not overlap it, as long as they rather are lumps.
    """

    MOST, SPAN = 3, 40.0
    SHIFTS = 8
    """Boxes along a lump's length."""
    SIZES = (-1.6, -0.8, 0.0, 0.8, 1.6)
    """In standard deviations from the mean of the row."""

    @staticmethod
    def level(score: float) -> float:
        """A log likelihood ratio as a number that an alarm takes, 0 to 1."""
        return float(np.clip(0.5 + score / MapWatcher.SPAN, 0.0, 1.0))

    def _begin(self, roi: Roi) -> None:
        self._likelihood = make_likelihood(self._detector, self._prior.learned)
        self._grid = grid(self._profile(roi), roi, self.SHIFTS, self.SIZES)

    def step(self, frame: Frame) -> Said:
        """The maximum of the map."""
        roi, gray = self._picture(frame)
        seen = self._likelihood.observe(roi.view(gray))
        # The score before tempering and bounds, where the likelihood offers it: bounds make everything equal.
        scores = getattr(seen, "score", seen.log_ratio)(self._grid)
        best = peaks(self._grid[:, [X, Y, W, H]], scores, self.MOST)
        boxes = roi.to_frame(self._grid[best][:, [X, Y, W, H]])
        return Said(self.level(scores.max()), boxes)


class BlobWatcher(_OnRoi):
    """OpenCV's MOG2; blobs as large as lumps are at their row. How large at least is the threshold."""

    HISTORY, VARIANCES = 900, 4.0
    """Best of 100 to 900 frames and of 4 to 100, on training feeds: a short memory learns every lump."""
    BLUR, OPENING, CLOSING = 4.0, 5, (7, 7)
    """Working pixels; smoothing takes away the ore's texture, and leaves a lump's surface."""
    LARGEST = 2.0

    @staticmethod
    def level(size: float) -> float:
        """A size in units of the row's mean lump as a number that an alarm takes, 0 to 1."""
        return float(np.clip(size / BlobWatcher.LARGEST, 0.0, 1.0))

    def _begin(self, roi: Roi) -> None:
        self._rows = self._profile(roi)
        self._model = cv2.createBackgroundSubtractorMOG2(self.HISTORY, self.VARIANCES, detectShadows=False)

    def step(self, frame: Frame) -> Said:
        """The largest blob that is not larger than a lump."""
        roi, gray = self._picture(frame)
        smooth = cv2.GaussianBlur(gray, (0, 0), self.BLUR)
        mask = np.asarray(self._model.apply(smooth), np.uint8) * roi.mask
        found = regions(cleaned(mask, self.OPENING, self.CLOSING), least_area=16)
        mean, spread = self._rows.at(found[:, 1])
        logs = 0.5 * np.log(found[:, 2:]).sum(axis=1) - 0.5 * mean[:, 2:].sum(axis=1)
        kept = logs <= SIZE_LIMIT * spread[:, 2:].max(axis=1)
        found, sizes = found[kept], np.exp(logs[kept])
        order = np.argsort(-sizes)[: MapWatcher.MOST]
        return Said(self.level(sizes.max(initial=0.0)), roi.to_frame(found[order]))


def grid(profile: RowProfile, roi: Roi, shifts: int, sizes: tuple[float, ...]) -> States:
    """All boxes that lumps may have, `shifts` of them along the length of one: states (n, 8)."""
    height, width = roi.shape
    boxes = []
    for size in sizes:
        row = 0.0
        while row < height:
            mean, spread = profile.at(np.array([row]))
            w, h = np.exp(mean[0, 2:] + size * spread[0, 2:])
            columns = np.arange(0.0, width, max(w / shifts, 1.0))
            boxes.append(np.column_stack([columns, *(np.full(len(columns), v) for v in (row, w, h))]))
            row += max(h / shifts, 1.0)
    states = blank(sum(map(len, boxes)))
    states[:, [X, Y, W, H]] = np.concatenate(boxes)
    return states


def peaks(boxes: Boxes, scores: NDArray[np.float64], most: int) -> NDArray[np.intp]:
    """The best box, and up to `most` in all that do not overlap a better one and score above 0."""
    corners = np.column_stack([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, 2:]])
    left = scores.copy()
    chosen: list[int] = []
    while len(chosen) < most:
        best = int(left.argmax())
        if not np.isfinite(left[best]) or (chosen and left[best] <= 0.0):
            break
        chosen.append(best)
        left[overlaps(corners[best : best + 1], corners)[0] > 0.0] = -np.inf
    return np.array(chosen, dtype=np.intp)
