"""`lumpwatch backtest`: configurations over an archive of labelled videos."""

from __future__ import annotations

import argparse
import logging
import math
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from lumpwatch.service.batch import Failed, Finished, Share, Task, run_tasks
from lumpwatch.service.capture import open_recording
from lumpwatch.service.cli.backtest_table import print_result
from lumpwatch.service.cli.common import belt_of, camera_of
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.cli.workers import (
    batch_progress,
    wanted_workers,
    workers_of,
)
from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.offline import (
    Backtest,
    Clip,
    Recording,
    Setup,
    Terms,
    Watch,
    archive,
    backtest_record,
    finished_recordings,
    record_video,
    run_backtest,
    short_names,
    tasks_of,
    write_backtest,
)
from lumpwatch.service.runtime import check_priors
from lumpwatch.service.storage import PriorStore

log = logging.getLogger(__name__)


def backtest(arguments: argparse.Namespace) -> int:
    """Run the command; 1 where a video had to be left out."""
    terms = _terms(arguments)
    wanted_workers(arguments)  # said before anything is read
    if arguments.share is not None and arguments.resume is None:
        raise ConfigError("--share needs --resume DIR, where the shares meet")
    names = short_names(arguments.config, "CONFIG")
    setups = [
        _setup(name, path, arguments.camera, arguments.roi)
        for name, path in zip(names, arguments.config, strict=True)
    ]
    clips = archive(arguments.videos, arguments.labels, arguments.unlabelled_is_empty)
    finished = None if arguments.resume is None else finished_recordings(arguments.resume)
    if arguments.share is not None:
        tasks = tasks_of(setups, [clip.video for clip in clips])
        return _do_share(arguments, arguments.share, tasks, finished)
    _look_at(setups[0], clips)
    if arguments.out is not None:
        _make_folder(arguments.out)
    many = len(setups) * len(clips)
    with workers_of(arguments, many) as workers, batch_progress("backtest", many) as told:
        found = run_backtest(
            setups, clips, terms, arguments.fall_model, workers.executor, workers.width, finished, told
        )
    console = Console(highlight=False, markup=False)
    if arguments.json:
        tell_json(backtest_record(found))
    else:
        for result in found.results:
            print_result(console, result, found)
    if arguments.out is not None:
        write_backtest(found, arguments.out)
        _draw(found, arguments.out / "backtest.png")
        if not arguments.json:
            console.print(f"results in {arguments.out}")
    for failure in found.failures:
        sys.stderr.write(f"lumpwatch: left out: {failure}\n")
    return 1 if found.failures else 0


def _terms(arguments: argparse.Namespace) -> Terms:
    for option in ("least_warning_s", "tolerance_s"):
        if not 0.0 <= getattr(arguments, option) < math.inf:
            name = option.removesuffix("_s").replace("_", "-")
            raise ConfigError(f"--{name} {getattr(arguments, option):g}s: must be finite and not negative")
    if not 0.0 < arguments.false_alarms_per_hour < math.inf:
        raise ConfigError(
            f"--false-alarms-per-hour {arguments.false_alarms_per_hour:g}: must be finite and positive"
        )
    return Terms(arguments.least_warning_s, arguments.tolerance_s, arguments.false_alarms_per_hour)


def _look_at(setup: Setup, clips: Sequence[Clip]) -> None:
    """Say at once, not after an hour, which videos cannot be opened. Raises SourceError where none can be."""
    errors: list[LumpwatchError] = []
    for clip in clips:
        try:
            open_recording(setup.camera, clip.video).close()
        except LumpwatchError as error:
            errors.append(error)
    if len(errors) == len(clips):
        raise errors[0]
    for one in errors:
        log.warning("will be left out: %s", one)


def _do_share(
    arguments: argparse.Namespace,
    share: Share,
    tasks: Sequence[Task[Watch]],
    finished: Finished[Recording] | None,
) -> int:
    """Do a share of the tasks and leave the results in the folder; 1 where one failed."""
    mine = share.of(tasks)
    with workers_of(arguments, len(mine)) as workers, batch_progress("backtest", len(mine)) as told:
        outcomes = run_tasks(mine, record_video, workers.executor, workers.width, finished, told)
    failed = [one for one in outcomes if isinstance(one, Failed)]
    for one in failed:
        sys.stderr.write(f"lumpwatch: failed: {one.reason}\n")
    done = {"share": share.index, "of": share.count, "tasks": len(mine), "failed": len(failed)}
    if arguments.json:
        tell_json(done)
    else:
        sys.stdout.write(
            f"share {share.index} of {share.count}: {len(mine) - len(failed)} of {len(mine)} finished\n"
        )
    return 1 if failed else 0


def _setup(name: str, path: Path, camera_id: str | None, roi_id: str | None) -> Setup:
    """A configuration with the ROI that is meant and its prior. Raises ConfigError."""
    config = load_config(path, secrets=False)
    try:
        return _chosen(name, config, camera_id, roi_id)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _chosen(name: str, config: SiteConfig, camera_id: str | None, roi_id: str | None) -> Setup:
    camera = camera_of(config, camera_id)
    roi = belt_of(camera, roi_id)
    camera = camera.model_copy(update={"rois": (roi,)})
    check_priors(config.model_copy(update={"cameras": (camera,)}))
    store = PriorStore(config.store.path, config.store.keep_priors)
    return Setup(name, camera, store.current(camera.id, roi.id).prior)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LumpwatchError(f"{out}: cannot be written ({error.strerror})") from error


def _draw(found: Backtest, path: Path) -> None:
    from lumpwatch.service.offline import PlotError, draw_backtest

    try:
        draw_backtest(found, path)
    except PlotError as error:
        sys.stderr.write(f"lumpwatch: no picture: {error}\n")
