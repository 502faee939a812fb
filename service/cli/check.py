"""`lumpwatch check`: whether the configuration is right and the stored priors can be read."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console
from rich.table import Table

from lumpwatch.service.cli.common import Commands, add_command
from lumpwatch.service.config import CalibrationConfig, SiteConfig, load_config
from lumpwatch.service.detection import make_plane
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.runtime import check_priors, check_simulations


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "check",
        check,
        "Check a configuration and the priors it uses, without starting anything.",
        "lumpwatch check site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--size",
        type=_size,
        metavar="WxH",
        help="size of the pictures, such as 1920x1080: says how well each calibration fits them",
    )


def check(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    check_simulations(config)
    table = Table(title=f"{config.site}: configuration is valid")
    for heading in ("camera", "source", "roi", "detector", "prior"):
        table.add_column(heading)
    notes = check_priors(config)
    for camera in config.cameras:
        for roi in camera.rois:
            table.add_row(
                camera.id,
                camera.source.redacted,
                roi.id,
                roi.detector.summary,
                notes[camera.id, roi.id],
            )
    fits = [] if arguments.size is None else _fits(config, *arguments.size)
    console = Console(markup=False)
    console.print(table)
    for line in fits:
        console.print(line, highlight=False, soft_wrap=True)
    if any(note.startswith("none") for note in notes.values()):
        console.print(
            "An untrained region knows lumps in general, not this site's: it finds fewer and raises more false alarms. "
            "A minute of labels teaches it (lumpwatch train).",
            highlight=False,
            soft_wrap=True,
        )
    return 0


def _fits(config: SiteConfig, width: int, height: int) -> list[str]:
    """How well each calibration fits pictures of that size. Raises ConfigError where one does not."""
    return [
        _fit(f"{camera.id}/{roi.id}", roi.calibration, width, height)
        for camera in config.cameras
        for roi in camera.rois
        if roi.calibration is not None
    ]


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"'{text}' is not WIDTHxHEIGHT in pixels")
    return int(width), int(height)


def _fit(place: str, calibration: CalibrationConfig, width: int, height: int) -> str:
    try:
        plane = make_plane(calibration, width, height)
    except ValueError as error:
        raise ConfigError(f"{place}: {error}") from error
    return (
        f"{place}: calibration fits within {plane.missed_px:.1f} px; the camera sees {plane.view_deg:.0f} degrees "
        f"across and is {plane.cameras.centre[0, 2] / 1000:.1f} m above the belt"
    )
