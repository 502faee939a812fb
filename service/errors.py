"""The errors that a user meets: each carries one line that names the thing."""

from __future__ import annotations


class LumpwatchError(Exception):
    """Base of all expected failures; `str(error)` is one line fit for a person."""

    exit_code = 1


class ConfigError(LumpwatchError):
    """The configuration or the arguments are wrong."""

    exit_code = 2
