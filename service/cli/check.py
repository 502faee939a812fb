"""`lumpwatch check`: whether the configuration is right and the stored priors can be read."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from lumpwatch.models.roi import Image
from lumpwatch.service.belt import make_pace, make_plane, never_clear, pixels_of
from lumpwatch.service.capture import look_at
from lumpwatch.service.cli.common import camera_of
from lumpwatch.service.cli.snapshot import save_picture
from lumpwatch.service.config import CameraConfig, SiteConfig, load_config
from lumpwatch.service.core import read_bounded, write_words
from lumpwatch.service.detection import draw_belt, seen_belt
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.runtime import check_priors, check_simulations

_ASSUMED = (1920, 1080)
"""Size of pictures that nobody has seen yet."""


@dataclass(slots=True)
class _Found:
    """What the check tells."""

    site: str
    rois: list[dict[str, Any]] = field(default_factory=list)
    sources: dict[str, dict[str, Any]] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def check(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config, secrets=arguments.connect)
    if arguments.camera is not None or arguments.picture is not None:
        config = config.model_copy(update={"cameras": (camera_of(config, arguments.camera),)})
    check_simulations(config)
    _check_files(config)
    notes = check_priors(config)
    found = _Found(config.site)
    for camera in config.cameras:
        for roi in camera.rois:
            found.rois.append(
                {
                    "camera": camera.id,
                    "source": camera.source.redacted,
                    "roi": roi.id,
                    "detector": "mouth" if roi.watches_mouth else roi.detector.summary,
                    "prior": notes[camera.id, roi.id],
                }
            )
    picture = None if arguments.picture is None else _read(arguments.picture)
    if arguments.connect:
        _connect(found, config, None if picture is not None else arguments.out)
    known = arguments.size or (None if picture is None else (picture.shape[1], picture.shape[0]))
    for camera in config.cameras:
        _calibrations(found, camera, known or _sent_size(found, camera.id))
    if picture is not None:
        out = arguments.out or arguments.picture.with_name(f"{arguments.picture.stem}-checked.png")
        _draw(config.cameras[0], picture)
        save_picture(out, picture)
        found.lines.append(f"{config.cameras[0].id}: drawn on the picture in {out}")
    if any(note.startswith("none") for note in notes.values()):
        found.warnings.append(
            "An untrained region knows lumps in general, not this site's: it finds fewer and raises more false alarms. "
            "A minute of labels teaches it (lumpwatch train)."
        )
    _print(found, as_json=arguments.json)
    return 0


def _check_files(config: SiteConfig) -> None:
    """Raises ConfigError for a source that is a file and is not there."""
    for camera in config.cameras:
        if camera.source.kind in ("video", "images") and not camera.source.path.exists():
            raise ConfigError(f"camera {camera.id}: source {camera.source.path}: no such file or folder")


def _sent_size(found: _Found, camera: str) -> tuple[int, int] | None:
    """Size of the pictures that the source sent; None where it was not asked."""
    sent = found.sources.get(camera)
    return None if sent is None else (sent["width"], sent["height"])


def _calibrations(found: _Found, camera: CameraConfig, known: tuple[int, int] | None) -> None:
    """What each calibration means in pictures of that size. Raises ConfigError where one makes no sense."""
    size = known or _ASSUMED
    for roi, told in zip(camera.rois, (one for one in found.rois if one["camera"] == camera.id), strict=True):
        place = f"{camera.id}/{roi.id}"
        told["decide_hz"] = rate_hz = make_pace(roi, camera.sight, *size).rate_hz
        decided = "on every frame" if rate_hz is None else f"{rate_hz:.3g} times a second at least"
        found.lines.append(f"{place}: decided {decided}")
        if roi.calibration is None:
            continue
        try:
            plane = make_plane(roi.calibration, *size)
        except ValueError as error:
            raise ConfigError(f"{place}: {error}") from error
        view = seen_belt(roi.calibration, plane, *pixels_of(roi.calibration, *size))
        told["calibration"] = asdict(view)
        assumed = "" if known else f" (pictures of {size[0]}x{size[1]} assumed; --connect asks the source)"
        found.lines.append(f"{place}: {view}{assumed}")
        found.warnings += [f"{place}: {warning}" for warning in view.warnings]
        if (why := never_clear(roi, camera.sight, *size)) is not None:
            found.warnings.append(f"{place}: {why}")


def _draw(camera: CameraConfig, picture: Image) -> None:
    height, width = picture.shape[:2]
    for roi in camera.rois:
        corners = np.array([(x * width, y * height) for x, y in roi.polygon]).round().astype(np.int32)
        cv2.polylines(
            picture, [corners], isClosed=True, color=(90, 200, 110), thickness=2, lineType=cv2.LINE_AA
        )
        lowest = corners[corners[:, 1].argmax()]  # the metres of a calibration stand at the far end
        write_words(picture, roi.id, (int(lowest[0]), int(lowest[1]) - 6), (90, 200, 110))
        if roi.calibration is not None:
            plane = make_plane(roi.calibration, width, height)
            draw_belt(picture, roi.calibration, plane, *pixels_of(roi.calibration, width, height))


def _connect(found: _Found, config: SiteConfig, out: Path | None) -> None:
    """Open each source. Raises SourceError."""
    if out is not None and len(config.cameras) > 1:
        raise ConfigError("--out takes the still of one camera: choose it with --camera")
    for camera in config.cameras:
        sent, still = look_at(camera)
        found.sources[camera.id] = asdict(sent)
        found.lines.append(f"{camera.id}: {sent}")
        found.warnings += [f"{camera.id}: {warning}" for warning in sent.warnings]
        if out is not None:
            save_picture(out, still)
            found.lines.append(f"{camera.id}: still in {out}")


def _print(found: _Found, *, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(asdict(found), indent=2) + "\n")
        return
    table = Table(title=f"{found.site}: configuration is valid")
    headings = ("camera", "source", "roi", "detector", "prior")
    for heading in headings:
        table.add_column(heading)
    for told in found.rois:
        table.add_row(*(told[heading] for heading in headings))
    console = Console(markup=False)
    console.print(table)
    for line in (*found.lines, *found.warnings):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _read(path: Path) -> Image:
    try:
        coded = np.frombuffer(read_bounded(path), np.uint8)
    except OSError as error:
        raise ConfigError(f"--picture {path}: cannot be read ({error.strerror})") from error
    picture = cv2.imdecode(coded, cv2.IMREAD_COLOR) if coded.size else None
    if picture is None:
        raise ConfigError(f"--picture {path}: is no picture")
    return np.asarray(picture, np.uint8)
