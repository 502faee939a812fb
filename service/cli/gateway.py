"""`lumpwatch gateway`: values and signals for the plant's control system."""

from __future__ import annotations

import argparse
import logging
import sys
from pathlib import Path

from lumpwatch.service.cli.common import stop_on_signals
from lumpwatch.service.cli.options import Commands, add_command, add_loudness
from lumpwatch.service.config import load_config
from lumpwatch.service.core import log_to_stderr
from lumpwatch.service.gateway import RegisterMap, as_csv, as_json, as_table, run_gateway

log = logging.getLogger(__name__)


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "gateway",
        gateway,
        "Serve the plant's control system by Modbus TCP, OPC UA and MQTT until told to stop (Ctrl-C or SIGTERM), or "
        "print the map of what it serves.",
        "lumpwatch gateway site.yaml --map --csv > map.csv",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--map", action="store_true", help="print the register map and end")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--csv", action="store_true", help="the map as CSV")
    form.add_argument("--json", action="store_true", help="the map as JSON")
    add_loudness(parser)


def gateway(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    if arguments.map or arguments.csv or arguments.json:
        form = as_csv if arguments.csv else as_json if arguments.json else as_table
        sys.stdout.write(form(RegisterMap(config)) + "\n")
        return 0
    log_to_stderr()
    run_gateway(config, stop_on_signals())
    return 0
