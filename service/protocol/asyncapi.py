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

from lumpwatch.service.bus import KEY_OF, FrameHeader, Kind
from lumpwatch.service.protocol.examples import example
from lumpwatch.service.protocol.messages import AlarmEvent, Heartbeat, Level, StateMessage
from lumpwatch.service.protocol.proof import BlendPlan, BlendReply, ProofRequest, ProofResult
from lumpwatch.service.protocol.requests import (
    AckRequest,
    ActReply,
    ResetRequest,
    ServiceRequest,
    ShelveRequest,
    SuppressRequest,
    UnshelveRequest,
)
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
class _Content:
    """A message that is not JSON, or has a header."""

    name: str
    text: str
    content_type: str
    headers: type[BaseModel] | None = None


@dataclass(frozen=True, slots=True)
class _Channel:
    """What a key carries: published messages, or a query with its reply."""

    text: str
    sends: type[BaseModel] | _Content | None = None
    asks: type[BaseModel] | _Content | None = None
    replies: type[BaseModel] | _Content | None = None


_FRAME = _Content(
    "Frame",
    "Pixels as payload, the header as JSON in zenoh's attachment.",
    "application/octet-stream",
    FrameHeader,
)
_JPEG = _Content(
    "Picture", "A JPEG picture, the header as JSON in zenoh's attachment.", "image/jpeg", FrameHeader
)
_NOTHING = _Content("PriorRequest", "An empty query.", "application/json")
_PRIOR = _Content(
    "Prior",
    "The bytes of the prior in use, as `lumpwatch priors export` writes them.",
    "application/octet-stream",
)
_VERDICT = _Content(
    "VerdictRequest", "Parameters actor, verdict, alarm or evidence, note.", "application/json"
)
_JUDGED = _Content("VerdictReply", "JSON: verdict, sequence, alarm, written.", "application/json")
_WANTED = _Content("EvidenceRequest", "Parameters newest, or id, file, offset, length.", "application/json")
_EVIDENCE = _Content(
    "Evidence",
    "JSON of evidence (`lumpwatch schema evidence`, with verdict) or a list of it; with file its bytes.",
    "application/octet-stream",
)
_TOKEN = _Content("Token", "A liveliness token; it has no content.", "application/octet-stream")

_CHANNELS: dict[Kind, _Channel] = {
    Kind.FRAME: _Channel("What the monitor looks at; newest wins, dropped where a receiver is slow.", _FRAME),
    Kind.JPEG: _Channel("The whole picture for people, encoded only while someone listens.", _JPEG),
    Kind.TEST_FRAME: _Channel("Frames with the synthetic lump of a proof test.", _FRAME),
    Kind.BLEND: _Channel("Asks the camera's process for those.", asks=BlendPlan, replies=BlendReply),
    Kind.HEARTBEAT: _Channel("The dead man's switch of the camera's monitor, once a second.", Heartbeat),
    Kind.STATE: _Channel("State of the ROI, on every frame.", StateMessage),
    Kind.ALARM: _Channel("Changes of the ROI's alarms; never dropped, the last 64 kept.", AlarmEvent),
    Kind.LEVEL: _Channel("The least that a PLC gateway needs, when it changes and twice a second.", Level),
    Kind.ACK: _Channel("Acknowledges an alarm.", asks=AckRequest, replies=ActReply),
    Kind.RESET: _Channel("Resets an alarm that is latched.", asks=ResetRequest, replies=ActReply),
    Kind.SHELVE: _Channel("Shelves an alarm.", asks=ShelveRequest, replies=ActReply),
    Kind.UNSHELVE: _Channel("Ends the shelving.", asks=UnshelveRequest, replies=ActReply),
    Kind.SERVICE: _Channel(
        "Takes an alarm out of service, or puts it back.", asks=ServiceRequest, replies=ActReply
    ),
    Kind.SUPPRESS: _Channel(
        "A plant signal suppresses an alarm; also taken as a plain put.",
        asks=SuppressRequest,
        replies=ActReply,
    ),
    Kind.VERDICT: _Channel("Says whether a lump alarm was one.", asks=_VERDICT, replies=_JUDGED),
    Kind.EVIDENCE: _Channel("Lists evidence and hands it out.", asks=_WANTED, replies=_EVIDENCE),
    Kind.PRIOR: _Channel("Asks for the prior in use.", asks=_NOTHING, replies=_PRIOR),
    Kind.SHADOW: _Channel(
        "State of the prior that runs in shadow, once a second while one does.", ShadowState
    ),
    Kind.PROOF: _Channel(
        "Starts a proof test; the reply comes when it has ended.", asks=ProofRequest, replies=ProofResult
    ),
    Kind.TEST: _Channel("Alarms of proof tests, each marked `test`.", AlarmEvent),
    Kind.ALIVE: _Channel("Liveliness tokens of daemon, cameras and monitors.", _TOKEN),
}


def asyncapi_document() -> dict[str, Any]:
    """The whole document as plain data."""
    models = sorted(
        {one for channel in _CHANNELS.values() for one in _models(channel)}, key=lambda model: model.__name__
    )
    _, schemas = models_json_schema(
        [(model, "serialization") for model in models], ref_template="#/components/schemas/{model}"
    )
    messages: dict[str, Any] = {}
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    for kind, channel in _CHANNELS.items():
        name = kind.name.lower()
        of_channel = [one for one in (channel.sends, channel.asks, channel.replies) if one is not None]
        messages |= {_name(one): _message(one) for one in of_channel}
        address = KEY_OF[kind]
        channels[name] = {
            "address": address,
            "description": channel.text,
            "parameters": {
                part: {"description": text} for part, text in _PARAMETERS.items() if f"{{{part}}}" in address
            },
            "messages": {_name(one): _ref("components/messages", one) for one in of_channel},
        }
        operations[name] = _operation(name, channel)
    return {
        "asyncapi": "3.0.0",
        "info": {
            "title": "lumpwatch",
            "version": "1",
            "description": "What the daemon says and takes on its zenoh bus. Queries are zenoh queries, whose "
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
    for one in (channel.sends, channel.asks, channel.replies):
        model = one.headers if isinstance(one, _Content) else one
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


def _message(one: type[BaseModel] | _Content) -> dict[str, Any]:
    if isinstance(one, _Content):
        made = {"name": one.name, "summary": one.text, "contentType": one.content_type}
        if one.headers is None:
            return made
        headers = {"$ref": f"#/components/schemas/{one.headers.__name__}"}
        return made | {
            "headers": headers,
            "payload": dict(_BYTES),
            "examples": [{"headers": example(one.headers)}],
        }
    kind = "application/cloudevents+json" if one is AlarmEvent else "application/json"
    return {
        "name": one.__name__,
        "summary": " ".join((one.__doc__ or "").split()),
        "contentType": kind,
        "payload": {"$ref": f"#/components/schemas/{one.__name__}"},
        "examples": [{"payload": example(one)}],
    }


def _name(one: type[BaseModel] | _Content) -> str:
    return one.name if isinstance(one, _Content) else one.__name__


def _ref(where: str, one: type[BaseModel] | _Content) -> dict[str, str]:
    return {"$ref": f"#/{where}/{_name(one)}"}
