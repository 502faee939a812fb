"""The configuration file while the daemon runs: a camera that is changed in it is started anew, the others go on."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from pathlib import Path

from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.errors import ConfigError

log = logging.getLogger(__name__)

EVERY_S = 1.0


class ConfigFile:
    """Looks at the file once a second; a file that is not valid changes nothing, and that is logged once."""

    def __init__(self, path: Path, clock: Callable[[], float] = time.monotonic) -> None:
        self._path = path
        self._clock = clock
        self._seen = self._stamp()
        self._next_s = clock() + EVERY_S

    def changed(self) -> SiteConfig | None:
        """The configuration, where the file has changed since the last look and is valid."""
        now = self._clock()
        if now < self._next_s:
            return None
        self._next_s = now + EVERY_S
        stamp = self._stamp()
        if stamp is None or stamp == self._seen:
            return None
        self._seen = stamp
        try:
            return load_config(self._path)
        except ConfigError as error:
            log.error("the changed configuration is not taken: %s", error)  # noqa: TRY400 - its one line says all
            return None

    def _stamp(self) -> tuple[int, int, int] | None:
        try:
            status = self._path.stat()
        except OSError:
            return None  # gone, or being replaced
        return status.st_mtime_ns, status.st_ino, status.st_size


def changed_cameras(before: SiteConfig, after: SiteConfig) -> list[str]:
    """The cameras whose section differs, where everything else is the same.

    Logs what cannot be taken while the daemon runs: other keys, and cameras that come or go.
    """
    ids = [camera.id for camera in before.cameras]
    if [camera.id for camera in after.cameras] != ids:
        log.error(
            "cameras were added to or removed from the configuration: that needs a restart of the daemon"
        )
        return []
    if before.model_copy(update={"cameras": ()}) != after.model_copy(update={"cameras": ()}):
        log.warning(
            "the configuration has changed outside of its cameras: that needs a restart of the daemon"
        )
    return [one.id for one, other in zip(before.cameras, after.cameras, strict=True) if one != other]
