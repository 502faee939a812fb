"""The configuration: one strict model a concern, loaded from YAML by `load`."""

from service.config.alarm import AlarmConfig
from service.config.bus import BusConfig
from service.config.cameras import CameraConfig, RoiConfig
from service.config.detector import DetectorConfig
from service.config.evidence import EvidenceConfig, ShiftsConfig
from service.config.jdt import (
    ExistenceConfig,
    HistogramConfig,
    JdtConfig,
    LikelihoodConfig,
    LumpConfig,
    NetworkConfig,
)
from service.config.load import load, parse, schema
from service.config.motion import MotionConfig
from service.config.site import SiteConfig, StoreConfig, TelemetryConfig
from service.config.source import SourceConfig
from service.config.trackers import ImmPfConfig, JpdaConfig

__all__ = [
    "AlarmConfig",
    "BusConfig",
    "CameraConfig",
    "DetectorConfig",
    "EvidenceConfig",
    "ExistenceConfig",
    "HistogramConfig",
    "ImmPfConfig",
    "JdtConfig",
    "JpdaConfig",
    "LikelihoodConfig",
    "LumpConfig",
    "MotionConfig",
    "NetworkConfig",
    "RoiConfig",
    "ShiftsConfig",
    "SiteConfig",
    "SourceConfig",
    "StoreConfig",
    "TelemetryConfig",
    "load",
    "parse",
    "schema",
]
