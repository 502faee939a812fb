"""What several commands share: adding a command, finding camera and ROI, reading files, progress."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from lumpwatch.service.config import CameraConfig, RoiConfig, SiteConfig
from lumpwatch.service.core import log_level
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.signals import on_end_signals

log = logging.getLogger(__name__)


def camera_of(config: SiteConfig, camera_id: str | None) -> CameraConfig:
    """The camera of the configuration, the only one where none is named; raises ConfigError naming those that exist."""
    camera_id = camera_id or _only("--camera", [camera.id for camera in config.cameras])
    try:
        return config.camera(camera_id)
    except KeyError:
        known = ", ".join(camera.id for camera in config.cameras)
        raise ConfigError(f"--camera {camera_id}: is not in the configuration (has {known})") from None


def roi_of(camera: CameraConfig, roi_id: str | None) -> RoiConfig:
    """The ROI of the camera, the only one where none is named; raises ConfigError naming those that exist."""
    roi_id = roi_id or _only("--roi", [roi.id for roi in camera.rois])
    try:
        return camera.roi(roi_id)
    except KeyError:
        known = ", ".join(roi.id for roi in camera.rois)
        raise ConfigError(f"--roi {roi_id}: camera {camera.id} does not have it (has {known})") from None


def belt_of(camera: CameraConfig, roi_id: str | None) -> RoiConfig:
    """Like `roi_of`, of those that look for lumps: a mouth is neither trained nor backtested."""
    if roi_id is None:
        roi_id = _only("--roi", [roi.id for roi in camera.rois if not roi.watches_mouth])
    roi = roi_of(camera, roi_id)
    if roi.watches_mouth:
        raise ConfigError(f"--roi {roi.id}: watches a mouth (watch: mouth), which looks for no lumps")
    return roi


def _only(option: str, ids: list[str]) -> str:
    if not ids:
        raise ConfigError(f"{option}: no roi of this camera looks for lumps")
    if len(ids) > 1:
        raise ConfigError(f"{option} is needed to choose one of {', '.join(ids)}")
    return ids[0]


@contextmanager
def progress(title: str, total: int | None) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal, nothing elsewhere; yields what to call with the count so far.

    The bar belongs to the log level info. At debug the log has begin and end of the stage instead.
    Where `LUMPWATCH_PROGRESS` names a file, another program follows: it holds `stage`, `done` and `total` as JSON.
    """
    if file := os.environ.get("LUMPWATCH_PROGRESS"):
        yield ProgressFile(Path(file), title, total).told
        return
    log.debug("%s: begins", title)
    started = time.perf_counter()
    console = Console(stderr=True)
    if not console.is_terminal or log_level() != logging.INFO:
        yield lambda _: None
        log.debug("%s: done after %.1f s", title, time.perf_counter() - started)
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


class ProgressFile:
    """Progress for another program: a small file, replaced as a whole at most four times a second."""

    _EVERY_S = 0.25

    def __init__(
        self, path: Path, stage: str, total: int | None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._path, self._stage, self._total, self._clock = path, stage, total, clock
        self._told_s = -math.inf
        self.told(0)

    def told(self, done: int) -> None:
        """So much is done; a file that cannot be written holds up nothing."""
        if done != self._total and self._clock() - self._told_s < self._EVERY_S:
            return
        self._told_s = self._clock()
        content = {"stage": self._stage, "done": done, "total": self._total}
        temporary = self._path.with_suffix(".new")
        with contextlib.suppress(OSError):
            temporary.write_text(json.dumps(content))
            temporary.replace(self._path)


def stop_on_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set; a second signal ends the process at once."""
    stop = threading.Event()
    on_end_signals(stop.set, lambda: sys.exit(130))
    return stop
