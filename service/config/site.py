"""The whole configuration of one daemon."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, model_validator

from lumpwatch.service.config.address import HostPort, host_and_port
from lumpwatch.service.config.base import Id, PositiveSeconds, Strict
from lumpwatch.service.config.bus import BusConfig
from lumpwatch.service.config.cameras import CameraConfig
from lumpwatch.service.config.console import ConsoleConfig
from lumpwatch.service.config.evidence import Days, EvidenceConfig, ShiftsConfig
from lumpwatch.service.config.gateway import GatewayConfig


class StoreConfig(Strict):
    """Where the daemon keeps what it learned."""

    path: Path = Path("var")
    """Folder of the store; made when missing."""
    keep_priors: int = Field(default=10, ge=2, le=1000)
    """How many versions of each prior are kept."""
    poll_s: PositiveSeconds = 1.0
    """How often a running daemon polls the store for a new prior."""
    keep_events_days: Days = 730.0
    """How long the event log keeps what is over and acknowledged."""
    keep_events: int = Field(default=1_000_000, ge=100)
    """How many events each camera's event log keeps; the oldest go first."""


class TelemetryConfig(Strict):
    """Where metrics and health are served."""

    listen: HostPort = "127.0.0.1:9464"
    """`host:port` of `/metrics`, `/livez`, `/readyz` and `/startupz`."""

    @property
    def address(self) -> tuple[str, int]:
        """Host and port; port 0 takes a free one."""
        return host_and_port(self.listen)


class SiteConfig(Strict):
    """One site: its bus, store, telemetry and cameras."""

    site: Id
    """Name of the site; part of every bus key."""
    bus: BusConfig = BusConfig()
    """The zenoh network."""
    store: StoreConfig = StoreConfig()
    """The daemon's own files."""
    telemetry: TelemetryConfig = TelemetryConfig()
    """Metrics and health."""
    evidence: EvidenceConfig = EvidenceConfig()
    """Clips of the frames around an alarm."""
    shifts: ShiftsConfig = ShiftsConfig()
    """When shifts begin, for reports."""
    console: ConsoleConfig = ConsoleConfig()
    """The operator's console, a process of its own."""
    gateway: GatewayConfig = GatewayConfig()
    """The gateway to the plant's control system, a process of its own."""
    cameras: Annotated[tuple[CameraConfig, ...], Field(min_length=1, max_length=64)]
    """The cameras that this daemon watches."""

    @model_validator(mode="after")
    def _unique(self) -> Self:
        ids = [camera.id for camera in self.cameras]
        if twice := {i for i in ids if ids.count(i) > 1}:
            raise ValueError(f"cameras: id '{min(twice)}' is given more than once")
        return self

    @model_validator(mode="after")
    def _known_regions(self) -> Self:
        known = {f"{camera.id}/{roi.id}" for camera in self.cameras for roi in camera.rois}
        if unknown := [name for name in self.gateway.order if name not in known]:
            raise ValueError(f"gateway.order: no camera has the region '{unknown[0]}'")
        return self

    def camera(self, camera_id: str) -> CameraConfig:
        """The camera of that id; KeyError where there is none."""
        for camera in self.cameras:
            if camera.id == camera_id:
                return camera
        raise KeyError(camera_id)
