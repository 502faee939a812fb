"""`lumpwatch ack`, `shelve`, …: what an operator does to a running daemon's alarms.

The options of each are the fields of its request in the command table.
"""

from __future__ import annotations

import argparse

from lumpwatch.service.bus import Keys, open_client
from lumpwatch.service.cli.alarms import as_client, ask_one, read_answer
from lumpwatch.service.cli.common import camera_of, roi_of
from lumpwatch.service.cli.options import tell_json
from lumpwatch.service.config import load_config
from lumpwatch.service.core import AlarmRequestError, seconds_of
from lumpwatch.service.errors import ConfigError
from lumpwatch.service.protocol import COMMANDS, ActReply, read_request

_SHARED = {"alarm_class", "actor"}
"""The fields of every request about an alarm."""
_SPAN = "_s"
"""What the names of fields with seconds end with; on the command line they are times like 30m, without it."""


def operate(arguments: argparse.Namespace) -> int:
    """Run a command."""
    row = COMMANDS[arguments.operation]
    given: dict[str, object] = {"actor": arguments.actor, "class": arguments.alarm_class}
    for name in row.request.model_fields.keys() - _SHARED:
        value = getattr(arguments, name)
        if value is not None:
            given[name] = seconds_of(value) if name.endswith(_SPAN) else value
    try:
        request = read_request(row.request, given)
    except AlarmRequestError as error:
        raise ConfigError(f"{row.name}: {error}") from error
    config = load_config(arguments.config)
    camera = camera_of(config, arguments.camera)
    roi = roi_of(camera, arguments.roi)
    target, key = f"{camera.id}/{roi.id}", Keys(config.site).command(camera.id, roi.id, row.name)
    parameters = request.model_dump(mode="json", by_alias=True, exclude_none=True)
    with open_client(as_client(config.bus), wait=False) as bus:
        answer = ask_one(bus, key, {name: str(value) for name, value in parameters.items()}, target)
    reply = read_answer(ActReply, answer, target)
    if arguments.json:
        told = reply.model_dump(mode="json", by_alias=True)
        tell_json({"command": row.name, "camera": camera.id, "roi": roi.id, **told})
        return 0
    changes = ", ".join(reply.changes) or "nothing to do"
    print(f"{target} {reply.alarm_class}: {changes}, now {reply.alarm}")  # noqa: T201
    return 0
