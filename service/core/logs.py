"""Logging of the service's processes: one line an event on standard error."""

from __future__ import annotations

import logging
import os
import sys
from typing import Any

from lumpwatch.service.core.plain_text import printable, printable_lines

_FORMAT = "%(asctime)s %(levelname)-7s %(processName)s: %(message)s"
LEVEL = "LUMPWATCH_LOG_LEVEL"
"""Environment variable: debug, info (default), warning or error; worker processes inherit it."""


def log_level() -> int:
    """The level that the environment asks for; info where it asks for none that there is."""
    return logging.getLevelNamesMapping().get(os.environ.get(LEVEL, "info").upper(), logging.INFO)


def log_to_stderr() -> None:
    """Set up logging of this process. Libraries log at info at most: at debug some write pages."""
    level = log_level()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(OneLine(_FORMAT, "%Y-%m-%dT%H:%M:%S"))
    logging.basicConfig(level=max(level, logging.INFO), handlers=[handler], force=True)
    logging.getLogger("lumpwatch").setLevel(level)


class OneLine(logging.Formatter):
    """A message is one line of bounded length, whatever stands in it; a traceback follows it line by line."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - as the library calls it
        """The line of a record."""
        record.message = printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: Any) -> str:  # noqa: N802 - as the library calls it
        """Its traceback."""
        return printable_lines(super().formatException(ei))
