"""Arguments of `lumpwatch deploy`."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumpwatch.service.cli.late import late
from lumpwatch.service.cli.options import Command, Commands, add_command, add_json, timeout

IMAGE = "lumpwatch:latest"


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "deploy",
        late("deploy", "status"),
        "Run the daemon as a container: roll out, look at it, go back. Talks to Docker or Podman.",
        "lumpwatch deploy up site.yaml --image registry.example/lumpwatch:0.1.0",
    )
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)
    for name, command, help_text in (
        ("plan", late("deploy", "plan"), "say what `up` would do, and change nothing"),
        (
            "up",
            late("deploy", "up"),
            "bring the site to this image and configuration, and wait until it is ready",
        ),
    ):
        parser = _action(actions, name, command, help_text)
        parser.add_argument("--image", default=IMAGE, metavar="NAME", help=f"image to run (default: {IMAGE})")
        parser.add_argument("--network", default="host", metavar="NAME", help="network (default: host)")
        parser.add_argument("--memory", type=_mib, metavar="MIB", help="limit (default: 512 + 1024 a camera)")
        if name == "up":
            parser.add_argument("--pull", action="store_true", help="ask the registry even where it is here")
            parser.add_argument(
                "--build", type=Path, metavar="FOLDER", help="build the image from this source"
            )
            parser.add_argument(
                "--build-arg", action="append", default=[], metavar="KEY=VALUE", help="for --build"
            )
            _timeout(parser)
    parser = _action(
        actions, "status", late("deploy", "status"), "what runs, what is kept; exit code 0 while it is ready"
    )
    parser = _action(actions, "logs", late("deploy", "logs"), "the log of the container in use")
    parser.add_argument("--tail", type=int, default=100, metavar="N", help="last lines (default: 100)")
    parser.add_argument("--follow", action="store_true", help="go on until interrupted")
    parser = _action(
        actions, "rollback", late("deploy", "rollback"), "exchange the container in use and the one before"
    )
    _timeout(parser)


def _action(
    actions: argparse._SubParsersAction[argparse.ArgumentParser], name: str, command: Command, text: str
) -> argparse.ArgumentParser:
    parser = actions.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
    parser.set_defaults(command=command)
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--socket", metavar="PATH", help="socket or address of the engine")
    if name != "logs":
        add_json(parser, "print the facts as JSON; progress goes to standard error")
    return parser


def _timeout(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--timeout",
        type=timeout,
        default=120.0,
        metavar="TIME",
        help="how long it may take until ready (default 2m)",
    )


def _mib(text: str) -> int:
    value = int(text)
    if value < 64:
        raise argparse.ArgumentTypeError(f"{value} MiB: too little, expected at least 64")
    return value
