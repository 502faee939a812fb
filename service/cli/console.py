"""`lumpwatch console`: the operator's page."""

from __future__ import annotations

import argparse
import logging

from lumpwatch.service.cli.common import stop_on_signals
from lumpwatch.service.config import load_config
from lumpwatch.service.console import run_console
from lumpwatch.service.core import log_to_stderr

log = logging.getLogger(__name__)


def console(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    log_to_stderr()
    run_console(
        config, arguments.config, stop_on_signals(), lambda address: log.info("console on %s", address)
    )
    return 0
