"""`lumpwatch backtest`: configurations over an archive of labelled videos."""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import cv2
from rich.console import Console
from rich.table import Table

from lumpwatch.service.capture import open_recording
from lumpwatch.service.cli.common import belt_of, camera_of, progress
from lumpwatch.service.cli.options import Commands, add_command, add_json, add_loudness, add_span, tell_json
from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.offline import (
    Backtest,
    Point,
    Result,
    Setup,
    Terms,
    archive,
    backtest_record,
    run_backtest,
    short_names,
    write_backtest,
)
from lumpwatch.service.runtime import check_priors
from lumpwatch.service.storage import PriorStore

_SHOWN = (0.5, 0.7, 0.8, 0.9, 0.96, 0.99, 0.999, 0.9999)


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
        "--videos", type=Path, nargs="+", required=True, metavar="VIDEO", help="videos or folders of images"
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
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: as many as cores)")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for backtest.json, lumps.csv and backtest.png"
    )
    add_json(parser, "print what backtest.json holds")
    add_loudness(parser)


def backtest(arguments: argparse.Namespace) -> int:
    """Run the command; 1 where a video had to be left out."""
    terms, workers = _terms(arguments), _workers(arguments.workers)
    names = short_names(arguments.config, "CONFIG")
    setups = [
        _setup(name, path, arguments.camera, arguments.roi)
        for name, path in zip(names, arguments.config, strict=True)
    ]
    clips = archive(arguments.videos, arguments.labels, arguments.unlabelled_is_empty)
    for clip in clips:  # said at once, not after an hour
        open_recording(setups[0].camera, clip.video).close()
    if arguments.out is not None:
        _make_folder(arguments.out)
    tasks = len(setups) * len(clips)
    with _pool(min(workers, tasks)) as pool, progress("backtest", tasks) as advance:
        found = run_backtest(setups, clips, terms, arguments.fall_model, pool, advance)
    console = Console(highlight=False, markup=False)
    if arguments.json:
        tell_json(backtest_record(found))
    else:
        for result in found.results:
            _print(console, result, found)
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


def _workers(wanted: int | None) -> int:
    if wanted is None:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if wanted < 1:
        raise ConfigError(f"--workers {wanted}: must be at least 1")
    return wanted


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


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), cv2.setNumThreads, (1,))


def _draw(found: Backtest, path: Path) -> None:
    from lumpwatch.service.offline import PlotError, draw_backtest

    try:
        draw_backtest(found, path)
    except PlotError as error:
        sys.stderr.write(f"lumpwatch: no picture: {error}\n")


def _print(console: Console, result: Result, found: Backtest) -> None:
    chosen = result.recommendation.point
    shown = [p for p in result.points if p.raise_above in _SHOWN or p in (chosen, result.configured)]
    prior = f"prior version {result.setup.prior.version}" if result.setup.prior else "stated defaults"
    table = Table(
        padding=(0, 0), title=f"{result.setup.name}: {result.setup.camera.id}/{result.setup.roi.id}, {prior}"
    )
    for heading in (
        "raise\nabove",
        "announced\n(95 %)",
        "warning s\nmid|worst",
        "false an hour\n(95 %)",
        "true",
        "mis-\nplaced",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for point in shown:
        marks = [
            word
            for word, is_it in (("config.", point == result.configured), ("advised", point == chosen))
            if is_it
        ]
        table.add_row(*_cells(point), ", ".join(marks), style="bold" if point == chosen else "")
    console.print(table)
    for line in _words(result, found):
        console.print(line)


def _cells(point: Point) -> tuple[str, ...]:
    low, high = point.detection_interval
    fewest, most = point.false_interval
    announced = "-"
    if point.lumps:
        announced = f"{point.announced}/{point.lumps} ({100 * low:.0f}-{100 * high:.0f} %)"
    rate = "-"
    if point.false_per_hour is not None:
        rate = f"{_rate(point.false_per_hour)} ({_rate(fewest)}-{_rate(most)})"
    return (
        f"{point.raise_above:g}",
        announced,
        f"{_seconds(point.warning_median_s)}|{_seconds(point.warning_worst_tenth_s)}",
        rate,
        str(point.true_alarms),
        str(point.misplaced_alarms),
    )


def _why_none(result: Result, wanted: float) -> str:
    most = result.recommendation.most_announced
    return {
        "no_lumps": "no labelled lump counts in these videos. Give some with lumps; the table holds false alarms "
        "alone.",
        "too_many_false": f"none keeps to {wanted:g} false alarms an hour. Train on this footage (--without-lumps), "
        "raise detector.likelihood.margin, or want less.",
        "nothing_announced": f"where false alarms keep to {wanted:g} an hour no lump is announced in time; the most "
        f"at any threshold is {most}. Train on footage like this before choosing one.",
    }[result.recommendation.reason or "too_many_false"]


def _rate(value: float) -> str:
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _time(hours: float) -> str:
    """Hours as people say them."""
    minutes = round(60 * hours)
    return (
        f"{60 * hours:.1f} min" if minutes < 10 else f"{minutes} min" if minutes < 120 else f"{hours:.1f} h"
    )


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _words(result: Result, found: Backtest) -> list[str]:
    """What the table does not say."""
    advice, wanted = result.recommendation, found.terms.false_alarms_per_hour
    last = result.points[-1]
    lumps = [lump for video in result.judged for lump in video.truth.lumps]
    counted = [lump for lump in lumps if lump.counted]
    by_fall = sum(lump.lip_from == "fall label" for lump in counted)
    outside = sum(video.truth.outside for video in result.judged)
    lost = sum(video.recording.length - len(video.recording.frames) for video in result.judged)
    lines = [
        f"{_time(found.hours)} of footage, {_time(last.quiet_h)} of it without a lump. In brackets: 95 % "
        f"intervals. Announced: at least {found.terms.least_warning_s:g} s before the lip. Warning: median | "
        "worst tenth, 0 for a lump without any. True, misplaced: alarms raised while a lump was there, with and "
        "without the box on it. config.: the threshold of the configuration; advised: the recommended one.",
        f"Lip: {by_fall} lumps by the label of the fall, {len(counted) - by_fall} by their last label. Not "
        f"counted: {len(lumps) - len(counted)} lumps cut off by the video, {outside} labelled outside the ROI.",
    ]
    if advice.point is None:
        lines.append(f"There is no threshold to recommend: {_why_none(result, wanted)}")
    else:
        lines.append(
            f"Recommended for at most {wanted:g} false alarms an hour: raise_above {advice.point.raise_above:g}, "
            f"clear_below {advice.point.clear_below:.3g}. It announces {advice.point.announced} of "
            f"{last.lumps} lumps; the most at any threshold is {advice.most_announced}. An alarm stands for "
            f"{advice.point.standing_share:.2%} of the time without a lump."
        )
    if advice.point is not None and advice.below_per_hour > wanted:
        lines.append(
            f"The footage is too short to show that rate: {advice.point.false_alarms} false alarms in "
            f"{_time(last.quiet_h)} only prove fewer than {_rate(advice.below_per_hour)} an hour (95 % sure); "
            f"{wanted:g} takes {advice.needed_h:.0f} hours without any."
        )
    if result.refused:
        lines.append(f"The prior did not fit {result.refused} videos: they ran on the stated defaults.")
    if lost:
        lines.append(f"{lost} frames could not be judged.")
    return lines
