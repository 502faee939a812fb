"""`lumpwatch run`: the daemon."""

from __future__ import annotations

import argparse
import logging

from lumpwatch.service.cli.common import camera_of, stop_on_signals
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
