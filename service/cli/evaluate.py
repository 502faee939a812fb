"""`lumpwatch evaluate`: a tracking result against labelled truth."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from lumpwatch.models.evaluation import METRICS, Scores, Tracks, tracks_of, without_ignored
from lumpwatch.models.evaluation import evaluate as run_evaluation
from lumpwatch.service.core import read_bounded
from lumpwatch.service.errors import ConfigError, LumpwatchError
from lumpwatch.service.protocol import StateLine
from lumpwatch.service.storage import ignored_boxes, read_labels

_MOST_BYTES = 1 << 30
Row = tuple[int, int, tuple[float, float, float, float]]
"""Frame, track and box."""


def evaluate(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if not 0.0 <= arguments.threshold <= 1.0:
        raise ConfigError(f"--threshold {arguments.threshold:g}: must be within 0 and 1")
    truth = _labels(arguments.truth)
    result = _result(arguments.result, arguments.camera, arguments.roi, counted=arguments.counted)
    result = without_ignored(result, truth, _ignored(arguments.truth), arguments.threshold)
    scores = run_evaluation(result, truth, arguments.threshold)
    if arguments.json:
        content = {key: None if math.isnan(value) else value for key, value in asdict(scores).items()}
        sys.stdout.write(json.dumps(content, indent=2) + "\n")
    else:
        _print(scores, f"{arguments.result.name} against {arguments.truth.name}")
    return 0


def _result(path: Path, camera: str | None, roi: str | None, *, counted: bool) -> Tracks:
    """A result in either format; an empty file is a result without boxes. Raises LumpwatchError."""
    try:
        text = read_bounded(path, _MOST_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise LumpwatchError(f"{path}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise LumpwatchError(f"{path}: is not text") from error
    if text.lstrip().startswith("{"):
        return _tracks(_states(path, text, camera, roi, counted=counted), path)
    for option, value in (("--camera", camera), ("--roi", roi)):
        if value is not None:
            raise ConfigError(f"{option} {value}: {path} is not a states.jsonl, its boxes have no such thing")
    return _labels(path) if text.strip() else _tracks((), path)


def _labels(path: Path) -> Tracks:
    boxes = read_labels(path)
    return _tracks(((box.frame, box.track, (box.x, box.y, box.w, box.h)) for box in boxes), path)


def _ignored(path: Path) -> Tracks:
    boxes = ignored_boxes(path)
    # Their ids say nothing, and need not be unique in a frame.
    return _tracks(
        ((box.frame, number, (box.x, box.y, box.w, box.h)) for number, box in enumerate(boxes)), path
    )


def _states(path: Path, text: str, camera: str | None, roi: str | None, *, counted: bool) -> list[Row]:
    """The boxes of the one ROI that is meant."""
    rows: list[Row] = []
    present: set[tuple[str, str]] = set()
    chosen: set[tuple[str, str]] = set()
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        try:
            state = StateLine.model_validate_json(line)
        except ValidationError as error:
            raise LumpwatchError(f"{path}, line {number}: is not a line of states.jsonl") from error
        present.add((state.camera, state.roi))
        if camera in (None, state.camera) and roi in (None, state.roi):
            chosen.add((state.camera, state.roi))
            rows += [
                (state.frame, found.id, (found.x, found.y, found.w, found.h))
                for found in state.objects
                if found.counts or not counted
            ]
    if len(chosen) != 1:
        known = ", ".join("/".join(place) for place in sorted(present))
        asked = " ".join(f"{name} {value}" for name, value in (("--camera", camera), ("--roi", roi)) if value)
        reason = "fits more than one" if chosen else "fits none"
        raise ConfigError(
            f"{asked or 'without --camera and --roi'}: {reason} of the ROIs in {path} ({known})"
        )
    return rows


def _tracks(rows: Iterable[Row], path: Path) -> Tracks:
    columns = tuple(zip(*rows, strict=True)) or ((), (), ())
    try:
        return tracks_of(*columns)
    except ValueError as error:
        raise LumpwatchError(f"{path}: {error}") from error


def _print(scores: Scores, title: str) -> None:
    table = Table(title=title)
    for heading in ("metric", "value", "better", "says"):
        table.add_column(
            heading, no_wrap=heading != "says", justify="right" if heading == "value" else "left"
        )
    for metric in METRICS:
        value = getattr(scores, metric.field)
        table.add_row(metric.name, _figure(value), metric.better, metric.says)
    console = Console(markup=False)
    console.print(table)
    console.print(
        f"boxes: {scores.truth_boxes} true, {scores.result_boxes} found; "
        f"tracks: {scores.truth_tracks} true, {scores.result_tracks} found; "
        f"frames: {scores.frames}; threshold: {scores.threshold:g}",
        highlight=False,
    )


def _figure(value: float) -> str:
    if math.isnan(value):
        return "undefined"
    return str(value) if isinstance(value, int) else f"{value:.3f}"
