"""What the handlers of requests share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment

from lumpwatch.service.bus import Bus
from lumpwatch.service.config import SiteConfig
from lumpwatch.service.console.board import Board
from lumpwatch.service.console.clips import Clips
from lumpwatch.service.console.pictures import Pictures
from lumpwatch.service.console.sessions import Sessions, Throttle
from lumpwatch.service.console.stream import Stream
from lumpwatch.service.console.times import SiteTimes
from lumpwatch.service.console.users import UserFile
from lumpwatch.service.console.work import Workshop


@dataclass(frozen=True, slots=True)
class Context:
    """One console."""

    config: SiteConfig
    path: Path
    """The configuration file."""
    bus: Bus
    board: Board
    pictures: Pictures
    clips: Clips
    stream: Stream
    sessions: Sessions
    throttle: Throttle
    users: UserFile | None
    templates: Environment
    times: SiteTimes
    workshop: Workshop
