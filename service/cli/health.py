"""`lumpwatch health`: whether the daemon on this host decides, for container engines and scripts."""

from __future__ import annotations

import argparse
import json
import urllib.error
import urllib.request
from http.client import HTTPException
from pathlib import Path

from lumpwatch.service.cli.common import Commands, add_command, add_json, tell_json
from lumpwatch.service.config import SiteConfig, load_config
from lumpwatch.service.errors import LumpwatchError

_MOST_BYTES = 1 << 20
_PAGES = {"live": "/livez", "ready": "/readyz", "started": "/startupz"}


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "health",
        health,
        "Ask the daemon on this host for its health: exit code 0 while every ROI decides, 1 otherwise.",
        "lumpwatch health site.yaml",
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--of", choices=tuple(_PAGES), default="ready", help="what is asked (default: ready)")
    parser.add_argument(
        "--timeout", type=float, default=2.0, metavar="S", help="seconds to wait (default: 2)"
    )
    add_json(parser)


def health(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    problems = ask(config, arguments.of, arguments.timeout)
    if arguments.json:
        tell_json({"of": arguments.of, "good": not problems, "problems": problems})
        return 1 if problems else 0
    print("\n".join(problems) if problems else arguments.of)  # noqa: T201 - the answer
    return 1 if problems else 0


def ask(config: SiteConfig, what: str, timeout_s: float) -> list[str]:
    """What is wrong; empty where nothing is. Raises LumpwatchError where nobody answers sensibly."""
    host, port = config.telemetry.address
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    url = f"http://{f'[{host}]' if ':' in host else host}:{port}{_PAGES[what]}"
    try:
        with urllib.request.urlopen(url, timeout=timeout_s) as answer:
            text = answer.read(_MOST_BYTES)
    except urllib.error.HTTPError as error:
        text = error.read(_MOST_BYTES)
    except urllib.error.URLError as error:
        raise LumpwatchError(f"{url}: no answer ({error.reason})") from error
    except (OSError, HTTPException) as error:
        raise LumpwatchError(f"{url}: no answer ({error or type(error).__name__})") from error
    try:
        problems = json.loads(text)["problems"]
    except (ValueError, KeyError, TypeError, RecursionError):
        problems = None
    if not isinstance(problems, list):
        raise LumpwatchError(f"{url}: not the answer of a lumpwatch daemon")
    return [str(problem) for problem in problems]
