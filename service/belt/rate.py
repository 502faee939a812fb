"""How many frames a second a region is decided on: as configured, or as many as it takes to find a lump in time."""

from __future__ import annotations

from lumpwatch.service.belt.geometry import ride_s
from lumpwatch.service.config import (
    CameraConfig,
    HistogramConfig,
    JdtConfig,
    LumpConfig,
    RoiConfig,
    SightConfig,
)
from lumpwatch.service.core import Pace

LEAST_HZ = 10.0
"""No region is decided on less often by itself. On simulated belts at 0.6 and 1.2 m/s, half of 25 frames a second
announced the same lumps as all of them, 0.2 s later in the mean (docs/operation.md)."""
_SPARE = 2.0
LEAST_WARNING_S = 1.0
"""What is asked where `proof_test.least_warning_s` asks for less."""


def decide_hz(roi: RoiConfig, sight: SightConfig, width: int, height: int) -> float | None:
    """Frames a second, for pictures of that size; None: every frame.

    Left to itself: the frames that CLEAR takes (`sight.least_frames`), twice over, within what the ride of a lump
    leaves before the warning that is asked, and `LEAST_HZ` at least. What reads its evidence by frames and not by
    seconds (trackers, networks, a configured `evidence`) is shown every frame.

    Raises ValueError for a calibration that cannot be.
    """
    if roi.decide_hz == "all":
        return None
    if roi.decide_hz is not None:
        return roi.decide_hz
    if not _reads_by_seconds(roi):
        return None
    ride = ride_s(roi, width, height)
    left_s = sight.within_s
    if ride is not None:
        asked_s = max(roi.proof_test.least_warning_s, LEAST_WARNING_S) + roi.alarm.on_delay_s
        left_s = min(left_s, ride - asked_s)
    return max(_SPARE * sight.least_frames / left_s, LEAST_HZ) if left_s > 0.0 else None


def never_clear(roi: RoiConfig, sight: SightConfig, width: int, height: int) -> str | None:
    """Why a region that is decided on as seldom as configured can never be CLEAR; None: it can. Raises ValueError."""
    rate_hz = decide_hz(roi, sight, width, height)
    ride = ride_s(roi, width, height)
    if rate_hz is None or ride is None or rate_hz * ride > sight.least_frames:
        return None
    return (
        f"decide_hz ({rate_hz:g}) gives {rate_hz * ride:.0f} frames while a lump rides across the region "
        f"({ride:.1f} s), and CLEAR takes more than sight.least_frames ({sight.least_frames}): it will always be "
        "BLIND (few_frames)"
    )


def make_pace(roi: RoiConfig, sight: SightConfig, width: int, height: int) -> Pace:
    """The pace of a region in pictures of that size; every frame where its calibration cannot be."""
    try:
        return Pace(decide_hz(roi, sight, width, height))
    except ValueError:
        return Pace(None)  # the region says so when it is fitted


def camera_pace(camera: CameraConfig, width: int, height: int) -> Pace:
    """The pace of the region that is decided on most often: what no region is decided on need not be sent.

    The others choose among the frames that it takes, live and in replay.
    """
    paces = [make_pace(roi, camera.sight, width, height) for roi in camera.rois]
    rates = [pace.rate_hz for pace in paces]
    known = [rate for rate in rates if rate is not None]
    return Pace(max(known) if len(known) == len(rates) else None)


def _reads_by_seconds(roi: RoiConfig) -> bool:
    """Whether what a frame says for a lump grows with the time since the last one."""
    detector = roi.detector
    if not isinstance(detector, JdtConfig):
        return False
    likelihood = detector.likelihood
    return isinstance(likelihood, LumpConfig | HistogramConfig) and likelihood.evidence is None
