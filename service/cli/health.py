"""`lumpwatch health`: whether the daemon on this host decides, for container engines and scripts.

It runs every few seconds beside the filter, so it imports nothing large: of the configuration it reads the one address.
"""

from __future__ import annotations

import argparse
import json
import re
import urllib.error
import urllib.request
from http.client import HTTPException
from pathlib import Path

from lumpwatch.service.cli.options import Commands, add_command, add_json, tell_json, timeout
from lumpwatch.service.errors import LumpwatchError

_HOST = re.compile(r"[A-Za-z0-9.-]+|\[[0-9A-Fa-f:]+\]")
USUAL = "127.0.0.1:9464"
"""What `telemetry.listen` is where it is left out."""
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
        "--timeout", type=timeout, default=2.0, metavar="TIME", help="how long to wait (default 2s)"
    )
    add_json(parser)


def health(arguments: argparse.Namespace) -> int:
    """Run the command."""
    problems = ask(telemetry_address(arguments.config), arguments.of, arguments.timeout)
    if arguments.json:
        tell_json({"of": arguments.of, "good": not problems, "problems": problems})
        return 1 if problems else 0
    print("\n".join(problems) if problems else arguments.of)  # noqa: T201 - the answer
    return 1 if problems else 0


def telemetry_address(path: Path) -> tuple[str, int]:
    """Where the daemon of this configuration answers. Raises ConfigError.

    A plain `telemetry.listen` is read as it stands; whatever else is in the way, the whole file is read and checked.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import YAMLError

    try:
        tree = YAML(typ="safe").load(path)
        telemetry = tree.get("telemetry", {})
        host, _, port = str(telemetry.get("listen", USUAL)).rpartition(":")
    except (OSError, ValueError, YAMLError, AttributeError):
        host = port = ""
    if port.isascii() and port.isdigit() and int(port) <= 65535 and _HOST.fullmatch(host):
        return host.strip("[]"), int(port)
    from lumpwatch.service.config import load_config

    return load_config(path, secrets=False).telemetry.address


def ask(address: tuple[str, int], what: str, timeout_s: float) -> list[str]:
    """What is wrong; empty where nothing is. Raises LumpwatchError where nobody answers sensibly."""
    host, port = address
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
