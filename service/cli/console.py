"""`lumpwatch console`: the operator's page."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from lumpwatch.service.cli.common import stop_on_signals
from lumpwatch.service.cli.options import Commands, add_command, add_loudness
from lumpwatch.service.config import load_config
from lumpwatch.service.console import run_console
from lumpwatch.service.core import log_to_stderr

log = logging.getLogger(__name__)


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "console",
        console,
        "Serve the operator's console, a web page, until it is told to stop (Ctrl-C or SIGTERM).",
        "lumpwatch console site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    add_loudness(parser)


def console(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    log_to_stderr()
    run_console(
        config, arguments.config, stop_on_signals(), lambda address: log.info("console on %s", address)
    )
    return 0
