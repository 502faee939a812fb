"""What several commands share: adding a command, finding camera and ROI, reading files, progress."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from lumpwatch.service.config import CameraConfig, RoiConfig, SiteConfig
from lumpwatch.service.core import log_level, seconds_of, whole_number
from lumpwatch.service.errors import ConfigError

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]
else:
    Commands = object

log = logging.getLogger(__name__)

Command = Callable[[argparse.Namespace], int]


def add_command(
    commands: Commands, name: str, command: Command, help_text: str, example: str
) -> argparse.ArgumentParser:
    """Add one command with its help and an example."""
    added = commands.add_parser(
        name,
        help=help_text,
        description=help_text,
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    added.set_defaults(command=command)
    return added


def add_json(parser: argparse.ArgumentParser, text: str = "print what was found as JSON") -> None:
    """Add `--json`: the facts for another program, on standard output and nothing else there."""
    parser.add_argument("--json", action="store_true", help=text)


def tell_json(content: object) -> None:
    """Print it on standard output, for another program; what JSON has no number for is an error, never printed."""
    sys.stdout.write(json.dumps(content, indent=2, allow_nan=False) + "\n")


def add_loudness(parser: argparse.ArgumentParser) -> None:
    """Add `--quiet` and `--verbose`, which stand for levels of `LUMPWATCH_LOG_LEVEL`."""
    group = parser.add_mutually_exclusive_group()
    for short, name, level, text in (
        ("-q", "--quiet", "warning", "warnings and errors alone on standard error: no progress, no log"),
        ("-v", "--verbose", "debug", "what is being done, on standard error, in place of progress"),
    ):
        group.add_argument(short, name, action="store_const", const=level, dest="log_level", help=text)


def duration(text: str) -> float:
    """Seconds of a span with units, for argparse: 90s, 30m, 1h30m. A number alone is refused."""
    try:
        return seconds_of(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def picture_size(text: str) -> tuple[int, int]:
    """Width and height in pixels of a text such as 1920x1080, for argparse."""
    width, height = (whole_number(side, _MOST_PX) for side in (*text.split("x"), "", "")[:2])
    if text.count("x") != 1 or not (width and height and min(width, height) >= _LEAST_PX):
        raise argparse.ArgumentTypeError(
            f"'{text[:40]}' is not a size such as 1920x1080 ({_LEAST_PX} to {_MOST_PX} px)"
        )
    return width, height


_LEAST_PX, _MOST_PX = 16, 16384


def add_actor(parser: argparse.ArgumentParser, text: str, *, required: bool) -> None:
    """Add `--by NAME`; the older `--actor` means the same."""
    group = parser.add_mutually_exclusive_group(required=required)
    group.add_argument("--by", dest="actor", default="", metavar="NAME", help=text)
    group.add_argument("--actor", dest="actor", default="", metavar="NAME", help=argparse.SUPPRESS)


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


def _only(option: str, ids: list[str]) -> str:
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

    def handle(number: int, frame: object) -> None:
        if stop.is_set():
            sys.exit(130)
        stop.set()

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    return stop
