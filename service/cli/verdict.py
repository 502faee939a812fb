"""`lumpwatch verdict`: what an operator says of an alarm afterwards."""

from __future__ import annotations

import argparse
from pathlib import Path

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import Commands, add_actor, add_command, add_json, tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmRequestError
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import VerdictOutcome, VerdictReply, VerdictRequest, read_request


def add(commands: Commands) -> None:
    """Add the command."""
    parser = add_command(
        commands,
        "verdict",
        verdict,
        "Say whether an alarm was true; the last word counts, all are kept. For reports and training.",
        'lumpwatch verdict false site.yaml --camera crusher-1 --roi apron --alarm 12 --by anna --note "dust"',
    )
    parser.add_argument(
        "verdict", choices=tuple(verdict.value for verdict in VerdictOutcome), help="what the alarm was"
    )
    parser.add_argument("config", type=Path, metavar="CONFIG", help="configuration file (YAML)")
    parser.add_argument("--camera", metavar="ID", help="camera of the alarm (default: the only one)")
    parser.add_argument("--roi", metavar="ID", help="ROI of the alarm (default: the only one)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument(
        "--alarm", metavar="SEQ|ID", help="a record of the alarm, by its sequence or id (default: the last)"
    )
    which.add_argument("--evidence", metavar="ID", help="the alarm of that evidence")
    add_actor(parser, "who says it; it is recorded", required=True)
    parser.add_argument("--note", default="", metavar="TEXT", help="why")
    add_json(parser, "print what was recorded as JSON")


def verdict(arguments: argparse.Namespace) -> int:
    """Run the command."""
    config = load_config(arguments.config)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    asked = {"actor": arguments.actor, "verdict": arguments.verdict}
    for name in ("alarm", "evidence", "note"):
        if value := getattr(arguments, name):
            asked[name] = value.rpartition("/")[2] if name == "evidence" else value
    try:
        read_request(VerdictRequest, asked)
    except AlarmRequestError as error:
        raise ConfigError(f"verdict: {error}") from error
    target, key = f"{camera.id}/{roi.id}", Keys(config.site).command(camera.id, roi.id, "verdict")
    with open_client(as_client(config.bus), wait=False) as bus:
        reply = read_answer(VerdictReply, ask_one(bus, key, asked, target), target)
    if arguments.json:
        tell_json({"camera": camera.id, "roi": roi.id, **reply.model_dump(mode="json", by_alias=True)})
        return 0
    later = "" if reply.written else " (the disk is in trouble: it is written when the disk takes it again)"
    print(f"{target} alarm {reply.sequence}: {reply.verdict}{later}")  # noqa: T201
    return 0
