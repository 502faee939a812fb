"""The configuration: one strict model a concern, loaded from YAML by `load_config`."""

from lumpwatch.service.config.alarm import AlarmConfig, ConditionAlarmConfig
from lumpwatch.service.config.base import NotNegative, Positive, PositiveSeconds, Strict, Unit
from lumpwatch.service.config.bus import AccessConfig, BusConfig, TlsConfig
from lumpwatch.service.config.calibration import CalibrationConfig
from lumpwatch.service.config.cameras import CameraConfig, LatencyConfig, RoiConfig
from lumpwatch.service.config.console import ConsoleConfig, UserRole
from lumpwatch.service.config.detector import DetectorConfig
from lumpwatch.service.config.evidence import EvidenceConfig, ShiftsConfig
from lumpwatch.service.config.feed import FeedConfig, MouthConfig
from lumpwatch.service.config.gateway import (
    GatewayConfig,
    ModbusConfig,
    MqttConfig,
    OpcUaConfig,
    PlantConfig,
    SparkplugConfig,
)
from lumpwatch.service.config.jdt import (
    ExistenceConfig,
    HistogramConfig,
    JdtConfig,
    LikelihoodConfig,
    LumpConfig,
    NetworkConfig,
)
from lumpwatch.service.config.load import (
    config_schema,
    load_config,
    parse_config,
    read_text,
    site_name,
    variables,
)
from lumpwatch.service.config.motion import MotionConfig
from lumpwatch.service.config.proof import ProofTestConfig
from lumpwatch.service.config.quality import CheckConfig, QualityConfig
from lumpwatch.service.config.sight import SightConfig
from lumpwatch.service.config.site import SiteConfig, StoreConfig, TelemetryConfig
from lumpwatch.service.config.source import PICTURE_SUFFIXES, BackoffConfig, Levels, SourceConfig
from lumpwatch.service.config.trackers import ImmPfConfig, JpdaConfig, MixtureConfig, StatisticalConfig, Zone

__all__ = [
    "PICTURE_SUFFIXES",
    "AccessConfig",
    "AlarmConfig",
    "BackoffConfig",
    "BusConfig",
    "CalibrationConfig",
    "CameraConfig",
    "CheckConfig",
    "ConditionAlarmConfig",
    "ConsoleConfig",
    "DetectorConfig",
    "EvidenceConfig",
    "ExistenceConfig",
    "FeedConfig",
    "GatewayConfig",
    "HistogramConfig",
    "ImmPfConfig",
    "JdtConfig",
    "JpdaConfig",
    "LatencyConfig",
    "Levels",
    "LikelihoodConfig",
    "LumpConfig",
    "MixtureConfig",
    "ModbusConfig",
    "MotionConfig",
    "MouthConfig",
    "MqttConfig",
    "NetworkConfig",
    "NotNegative",
    "OpcUaConfig",
    "PlantConfig",
    "Positive",
    "PositiveSeconds",
    "ProofTestConfig",
    "QualityConfig",
    "RoiConfig",
    "ShiftsConfig",
    "SightConfig",
    "SiteConfig",
    "SourceConfig",
    "SparkplugConfig",
    "StatisticalConfig",
    "StoreConfig",
    "Strict",
    "TelemetryConfig",
    "TlsConfig",
    "Unit",
    "UserRole",
    "Zone",
    "config_schema",
    "load_config",
    "parse_config",
    "read_text",
    "site_name",
    "variables",
]
