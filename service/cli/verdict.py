"""`lumpwatch verdict`: what an operator says of an alarm afterwards."""

from __future__ import annotations

import argparse

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmRequestError
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import VerdictReply, VerdictRequest, read_request


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
