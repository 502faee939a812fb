"""Logging of the service's processes: one line an event on standard error."""

from __future__ import annotations

import logging
import os
import sys

LEVEL = "LUMPWATCH_LOG_LEVEL"
"""Environment variable: debug, info (default), warning or error; worker processes inherit it."""


def log_to_stderr() -> None:
    """Set up the root logger of this process."""
    level = logging.getLevelNamesMapping().get(os.environ.get(LEVEL, "info").upper(), logging.INFO)
    logging.basicConfig(
        stream=sys.stderr,
        level=level,
        format="%(asctime)s %(levelname)-7s %(processName)s: %(message)s",
        datefmt="%Y-%m-%dT%H:%M:%S",
        force=True,
    )
