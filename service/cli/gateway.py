"""`lumpwatch gateway`: values and signals for the plant's control system."""

from __future__ import annotations

import argparse
import logging
import sys

from lumpwatch.service.cli.common import stop_on_signals
from lumpwatch.service.config import load_config
from lumpwatch.service.core import log_to_stderr
from lumpwatch.service.gateway import RegisterMap, as_csv, as_json, as_table, run_gateway

log = logging.getLogger(__name__)


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
