"""Modules that are imported only when something is asked of them: some take seconds."""

from __future__ import annotations

import argparse
import importlib
from typing import Any

from lumpwatch.service.cli.options import Command
from lumpwatch.service.errors import LumpwatchError

_EXTRAS = {
    "console": ("anyio", "jinja2", "starlette", "uvicorn"),
}
"""What an extra brings."""


def late(module: str, function: str) -> Command:
    """A command of a module of this package that is imported when the command is called."""

    def call(arguments: argparse.Namespace) -> int:
        command: Command = getattr(module_of(module), function)
        return command(arguments)

    return call


def module_of(name: str) -> Any:
    """A module of this package. Raises LumpwatchError where the installation holds the numerics alone."""
    try:
        return importlib.import_module(f"lumpwatch.service.cli.{name}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.startswith("lumpwatch"):
            raise
        missing = error.name.partition(".")[0]
        extra = next((name for name, packages in _EXTRAS.items() if missing in packages), "service")
        raise LumpwatchError(
            f"the package {error.name} is missing, which the command needs: pip install 'lumpwatch[{extra}]'"
        ) from error
