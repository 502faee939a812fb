"""`lumpwatch schema`: the JSON Schemas of configuration and messages."""

from __future__ import annotations

import argparse
import sys

from lumpwatch.service.config import config_schema
from lumpwatch.service.protocol import asyncapi_text, message_schema


def schema(arguments: argparse.Namespace) -> int:
    """Run the command."""
    sys.stdout.write(text(arguments.of).rstrip("\n") + "\n")
    return 0


def text(of: str) -> str:
    """One schema as JSON text; the AsyncAPI document as YAML."""
    if of == "config":
        return config_schema()
    return asyncapi_text() if of == "asyncapi" else message_schema(of)
