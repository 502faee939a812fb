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
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness, add_span, tell_json
from lumpwatch.service.cli.workers import (
    add_resuming,
    add_workers,
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


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "backtest",
        backtest,
        "Run one or several configurations over labelled videos, in parallel, and compare them: lumps "
        "announced, warning time before the lip and false alarms an hour at every alarm threshold, and the "
        "threshold for a wanted rate of false alarms.",
        "lumpwatch backtest site.yaml other.yaml --videos a.mp4 b.mp4 --labels a.txt b.txt --out out",
    )
    parser.add_argument("config", type=Path, nargs="+", metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--videos",
        type=Path,
        nargs="+",
        required=True,
        metavar="VIDEO",
        help="videos, folders of videos, or folders of images",
    )
    parser.add_argument(
        "--labels",
        type=Path,
        nargs="+",
        metavar="LABELS",
        help="one label file a video, in their order, MOTChallenge text; an empty one says that no lump comes "
        "(default: beside each video, clip.txt for clip.mp4, or gt.txt)",
    )
    parser.add_argument(
        "--unlabelled-is-empty", action="store_true", help="no lump comes in a video without labels beside it"
    )
    parser.add_argument("--camera", metavar="ID", help="camera, where a configuration has several")
    parser.add_argument("--roi", metavar="ID", help="ROI, where the camera has several")
    parser.add_argument(
        "--fall-model",
        default="fall",
        metavar="NAME",
        help="a lump is at the lip when its labels first name this motion model, or else at its last label "
        "(default fall)",
    )
    add_span(
        parser,
        "least-warning",
        "how long before the lip a lump must be announced",
        default="1s",
        older="least-warning-s",
    )
    add_span(
        parser,
        "tolerance",
        "an alarm is not false this close to a labelled lump",
        default="500ms",
        older="tolerance-s",
    )
    parser.add_argument(
        "--false-alarms-per-hour",
        type=float,
        default=0.1,
        metavar="RATE",
        help="how many false alarms are wanted at most (default 0.1)",
    )
    add_workers(parser)
    add_resuming(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for backtest.json, lumps.csv and backtest.png"
    )
    add_json(parser, "print what backtest.json holds")
    add_loudness(parser)


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
