"""The detector that a configuration asks for."""

from __future__ import annotations

from lumpwatch.models.learning.learned import Learned
from lumpwatch.models.roi import Roi
from lumpwatch.service.config import DetectorConfig, JdtConfig
from lumpwatch.service.detection.detectors.base import Detector
from lumpwatch.service.detection.detectors.jdt import JdtDetector


def make_detector(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
    """Raises PriorMismatchError where the prior does not fit the configuration."""
    if isinstance(config, JdtConfig):
        return JdtDetector(config, roi, learned)
    # A process that runs JDT only has no use for the trackers' compiled code.
    from lumpwatch.service.detection.detectors.trackers import TrackerDetector

    return TrackerDetector(config, roi, learned)
