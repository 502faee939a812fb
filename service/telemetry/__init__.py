"""Prometheus metrics and health of the daemon and its worker processes, and the worker's connection to the daemon."""

from lumpwatch.service.telemetry.camera import CameraMetrics
from lumpwatch.service.telemetry.daemon import DaemonMetrics
from lumpwatch.service.telemetry.daemon_connection import (
    GRACE_S,
    RESTARTS_WITHIN_S,
    STARTING,
    DaemonConnection,
    Report,
    Restarts,
    Worker,
    work,
)
from lumpwatch.service.telemetry.http import TelemetryServer
from lumpwatch.service.telemetry.hub import HubMetrics
from lumpwatch.service.telemetry.monitor import MonitorMetrics
from lumpwatch.service.telemetry.older_names import OLDER
from lumpwatch.service.telemetry.picture import PictureMetrics
from lumpwatch.service.telemetry.process import resident_bytes
from lumpwatch.service.telemetry.proof import ProofMetrics
from lumpwatch.service.telemetry.relay import Relay
from lumpwatch.service.telemetry.shadow import ShadowMetrics

__all__ = [
    "GRACE_S",
    "OLDER",
    "RESTARTS_WITHIN_S",
    "STARTING",
    "CameraMetrics",
    "DaemonConnection",
    "DaemonMetrics",
    "HubMetrics",
    "MonitorMetrics",
    "PictureMetrics",
    "ProofMetrics",
    "Relay",
    "Report",
    "Restarts",
    "ShadowMetrics",
    "TelemetryServer",
    "Worker",
    "resident_bytes",
    "work",
]
