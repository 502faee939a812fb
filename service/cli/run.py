"""`lumpwatch run`: the daemon."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from lumpwatch.service.cli.common import camera_of, stop_on_signals
from lumpwatch.service.cli.options import Commands, add_command, add_loudness
from lumpwatch.service.config import load_config
from lumpwatch.service.core import log_to_stderr
from lumpwatch.service.runtime import (
    Addresses,
    ConfigFile,
    check_priors,
    check_shared_memory,
    check_simulations,
)
from lumpwatch.service.runtime import run as run_daemon

log = logging.getLogger(__name__)


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "run",
        run,
        "Run the daemon until it is told to stop (Ctrl-C or SIGTERM).",
        "lumpwatch run site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument(
        "--camera", action="append", default=[], metavar="ID", help="only this camera (may be repeated)"
    )
    parser.add_argument(
        "--only",
        choices=("camera", "monitor"),
        help="only the processes that read cameras, or only those that filter; the others run elsewhere",
    )
    add_loudness(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    file = ConfigFile(arguments.config)
    config = load_config(arguments.config)
    for camera_id in arguments.camera:
        camera_of(config, camera_id)
    log_to_stderr()
    check_shared_memory(config)
    check_simulations(config)
    for (camera_id, roi_id), note in check_priors(config).items():
        log.info("%s/%s: prior %s", camera_id, roi_id, note)
    roles = (arguments.only,) if arguments.only else ("camera", "monitor")

    def log_addresses(addresses: Addresses) -> None:
        log.info("bus on %s, metrics on %s/metrics", ", ".join(addresses.bus), addresses.telemetry)

    run_daemon(config, stop_on_signals(), arguments.camera, roles, log_addresses, file.changed)
    return 0
