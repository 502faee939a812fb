"""The configuration: one strict model a concern, loaded from YAML by `load`."""

from service.config.alarm import AlarmConfig
from service.config.bus import BusConfig
from service.config.cameras import CameraConfig, RoiConfig
from service.config.detector import (
    ExistenceConfig,
    HistogramConfig,
    JdtConfig,
    LikelihoodConfig,
    LumpConfig,
    MotionConfig,
)
from service.config.load import load, parse, schema
from service.config.site import SiteConfig, StoreConfig, TelemetryConfig
from service.config.source import SourceConfig

__all__ = [
    "AlarmConfig",
    "BusConfig",
    "CameraConfig",
    "ExistenceConfig",
    "HistogramConfig",
    "JdtConfig",
    "LikelihoodConfig",
    "LumpConfig",
    "MotionConfig",
    "RoiConfig",
    "SiteConfig",
    "SourceConfig",
    "StoreConfig",
    "TelemetryConfig",
    "load",
    "parse",
    "schema",
]
