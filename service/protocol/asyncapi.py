"""The AsyncAPI 3.0 document of the bus, from the keys and the models.

It is written from the daemon's side: what it sends, and what it receives and answers.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import models_json_schema
from ruamel.yaml import YAML

from lumpwatch.service.bus import KEY_OF, FrameHeader, Kind, command_key
from lumpwatch.service.protocol.commands import COMMANDS
from lumpwatch.service.protocol.content import Content
from lumpwatch.service.protocol.examples import example
from lumpwatch.service.protocol.messages import AlarmEvent, Heartbeat, Level, StateMessage
from lumpwatch.service.protocol.proof import BlendPlan, BlendReply
from lumpwatch.service.protocol.shadow import ShadowState

_BYTES = {"type": "string", "format": "binary"}
_PARAMETERS = {
    "site": "Id of the site.",
    "camera": "Id of the camera.",
    "roi": "Id of the region of interest.",
    "role": "`daemon`, `camera` or `monitor`.",
    "name": "Id of the camera; of the daemon the site.",
}


@dataclass(frozen=True, slots=True)
class _Channel:
    """What a key carries: published messages, or a query with its reply."""

    text: str
    sends: type[BaseModel] | Content | None = None
    asks: type[BaseModel] | Content | None = None
    replies: type[BaseModel] | Content | None = None


_FRAME = Content(
    "Frame",
    "Pixels as payload, the header as JSON in zenoh's attachment.",
    "application/octet-stream",
    FrameHeader,
)
_JPEG = Content(
    "Picture", "A JPEG picture, the header as JSON in zenoh's attachment.", "image/jpeg", FrameHeader
)
_TOKEN = Content("Token", "A liveliness token; it has no content.", "application/octet-stream")

_PUBLISHED: dict[Kind, _Channel] = {
    Kind.FRAME: _Channel("What the monitor filters; newest wins, dropped where a receiver is slow.", _FRAME),
    Kind.JPEG: _Channel("The whole picture for people, encoded only while someone listens.", _JPEG),
    Kind.TEST_FRAME: _Channel("Frames with the synthetic lump of a proof test.", _FRAME),
    Kind.BLEND: _Channel("Asks the camera's process for those.", asks=BlendPlan, replies=BlendReply),
    Kind.HEARTBEAT: _Channel("The dead man's switch of the camera's monitor, once a second.", Heartbeat),
    Kind.STATE: _Channel("State of the ROI, on every frame.", StateMessage),
    Kind.ALARM: _Channel("Changes of the ROI's alarms; never dropped, the last 64 kept.", AlarmEvent),
    Kind.LEVEL: _Channel("The least that a PLC gateway needs, when it changes and twice a second.", Level),
    Kind.SHADOW: _Channel(
        "State of the prior that runs in shadow, once a second while one does.", ShadowState
    ),
    Kind.TEST: _Channel("Alarms of proof tests, each marked `test`.", AlarmEvent),
    Kind.ALIVE: _Channel("Liveliness tokens of daemon, cameras and monitors.", _TOKEN),
}

_CHANNELS: dict[str, tuple[str, _Channel]] = {
    **{kind.name.lower(): (KEY_OF[kind], channel) for kind, channel in _PUBLISHED.items()},
    **{
        name: (command_key(name), _Channel(command.text, asks=command.request, replies=command.reply))
        for name, command in COMMANDS.items()
    },
}
"""Address and content by the name of the channel."""


def asyncapi_document() -> dict[str, Any]:
    """The whole document as plain data."""
    models = sorted(
        {model for _, channel in _CHANNELS.values() for model in _models(channel)},
        key=lambda model: model.__name__,
    )
    _, schemas = models_json_schema(
        [(model, "serialization") for model in models], ref_template="#/components/schemas/{model}"
    )
    messages: dict[str, Any] = {}
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for name, (address, channel) in _CHANNELS.items():
        of_channel = [
            message for message in (channel.sends, channel.asks, channel.replies) if message is not None
        ]
        messages |= {_name(message): _message(message) for message in of_channel}
        channels[name] = {
            "address": address,
            "description": channel.text,
            "parameters": {
                part: {"description": text} for part, text in _PARAMETERS.items() if f"{{{part}}}" in address
            },
            "messages": {_name(message): _ref("components/messages", message) for message in of_channel},
        }
        operations[name] = _operation(name, channel)
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "lumpwatch",
            "version": "1",
            "description": "What the daemon publishes and answers on its zenoh bus. Queries are zenoh queries, whose "
            "parameters stand behind the `?` of the selector or in the payload.",
            "license": {"name": "Apache-2.0"},
        },
        "defaultContentType": "application/json",
        "servers": {
            "hub": {"host": "127.0.0.1:7447", "protocol": "zenoh", "description": "The daemon, by default."}
        },
        "channels": channels,
        "operations": operations,
        "components": {"messages": messages, "schemas": schemas["$defs"]},
    }


def asyncapi_text() -> str:
    """The document as YAML."""
    out = StringIO()
    yaml = YAML()
    yaml.width = 110
    yaml.dump(asyncapi_document(), out)
    return out.getvalue()


def _models(channel: _Channel) -> list[type[BaseModel]]:
    found = []
    for message in (channel.sends, channel.asks, channel.replies):
        model = message.headers if isinstance(message, Content) else message
        if model is not None:
            found.append(model)
    return found


def _operation(name: str, channel: _Channel) -> dict[str, Any]:
    where = {"$ref": f"#/channels/{name}"}
    if channel.sends is not None:
        return {
            "action": "send",
            "channel": where,
            "messages": [_ref(f"channels/{name}/messages", channel.sends)],
        }
    assert channel.asks is not None
    assert channel.replies is not None
    return {
        "action": "receive",
        "channel": where,
        "messages": [_ref(f"channels/{name}/messages", channel.asks)],
        "reply": {"channel": where, "messages": [_ref(f"channels/{name}/messages", channel.replies)]},
    }


def _message(message: type[BaseModel] | Content) -> dict[str, Any]:
    if isinstance(message, Content):
        made = {"name": message.name, "summary": message.text, "contentType": message.content_type}
        if message.headers is None:
            return made
        headers = {"$ref": f"#/components/schemas/{message.headers.__name__}"}
        return made | {
            "headers": headers,
            "payload": dict(_BYTES),
            "examples": [{"headers": example(message.headers)}],
        }
    kind = "application/cloudevents+json" if message is AlarmEvent else "application/json"
    return {
        "name": message.__name__,
        "summary": " ".join((message.__doc__ or "").split()),
        "contentType": kind,
        "payload": {"$ref": f"#/components/schemas/{message.__name__}"},
        "examples": [{"payload": example(message)}],
    }


def _name(message: type[BaseModel] | Content) -> str:
    return message.name if isinstance(message, Content) else message.__name__


def _ref(where: str, message: type[BaseModel] | Content) -> dict[str, str]:
    return {"$ref": f"#/{where}/{_name(message)}"}
