"""`lumpwatch check`: whether the configuration is right and the stored priors can be read."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console
from rich.table import Table

from lumpwatch.service.cli.common import Commands, add_command
from lumpwatch.service.config import load_config
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
    Console().print(table)
    return 0
