"""The detector that a configuration asks for."""

from __future__ import annotations

from models.learning.learned import Learned
from models.roi import Roi
from service.config.detector import DetectorConfig
from service.config.jdt import JdtConfig
from service.detectors.base import Detector
from service.detectors.jdt import JdtDetector


def make_detector(config: DetectorConfig, roi: Roi, learned: Learned | None) -> Detector:
    """Raises PriorMismatchError where the prior does not fit the configuration."""
    if isinstance(config, JdtConfig):
        return JdtDetector(config, roi, learned)
    # A process that runs JDT only has no use for the trackers' compiled code.
    from service.detectors.trackers import TrackerDetector

    return TrackerDetector(config, roi, learned)
