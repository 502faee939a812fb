"""From picture to decision: regions, detectors, picture quality, and the pipeline of one camera."""

from lumpwatch.service.detection.belt_view import draw_belt, seen_belt
from lumpwatch.service.detection.camera_pipeline import CameraPipeline
from lumpwatch.service.detection.channel import RegionMisfitError
from lumpwatch.service.detection.detectors.base import SHOWN_ABOVE, Detector, FilterState
from lumpwatch.service.detection.detectors.filters import DEFAULT_INTERVAL_S, make_likelihood, make_profile
from lumpwatch.service.detection.detectors.jdt import JdtDetector
from lumpwatch.service.detection.detectors.make import make_detector
from lumpwatch.service.detection.network import make_network
from lumpwatch.service.detection.observer import Unobserved
from lumpwatch.service.detection.picture_quality import CameraQuality
from lumpwatch.service.detection.region import make_region
from lumpwatch.service.detection.region_channel import MakeDetector, RegionChannel
from lumpwatch.service.detection.shadow.shadows import Shadows
from lumpwatch.service.detection.shipped_likelihood import default_likelihood, make_net
from lumpwatch.service.detection.sight import SightState
from lumpwatch.service.detection.sizing import SizeTrack
from lumpwatch.service.detection.snapshot import Snapshot

__all__ = [
    "DEFAULT_INTERVAL_S",
    "SHOWN_ABOVE",
    "CameraPipeline",
    "CameraQuality",
    "Detector",
    "FilterState",
    "JdtDetector",
    "MakeDetector",
    "RegionChannel",
    "RegionMisfitError",
    "Shadows",
    "SightState",
    "SizeTrack",
    "Snapshot",
    "Unobserved",
    "default_likelihood",
    "draw_belt",
    "make_detector",
    "make_likelihood",
    "make_net",
    "make_network",
    "make_profile",
    "make_region",
    "seen_belt",
]
