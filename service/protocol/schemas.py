"""The contract with other programs: every message by name, and the AsyncAPI document of all keys."""

from __future__ import annotations

import json

from pydantic import BaseModel

from lumpwatch.service.bus import FrameHeader
from lumpwatch.service.protocol.commands import COMMANDS
from lumpwatch.service.protocol.evidence import EvidenceMeta
from lumpwatch.service.protocol.messages import AlarmEvent, Heartbeat, Level, StateLine, StateMessage
from lumpwatch.service.protocol.proof import BlendPlan, BlendReply, ProofResult
from lumpwatch.service.protocol.requests import ActReply
from lumpwatch.service.protocol.shadow import ShadowState
from lumpwatch.service.protocol.verdict import VerdictReply

_PUBLISHED: dict[str, type[BaseModel]] = {
    "alarm": AlarmEvent,
    "state": StateMessage,
    "heartbeat": Heartbeat,
    "level": Level,
    "replay": StateLine,
    "shadow": ShadowState,
    "frame": FrameHeader,
    "act-reply": ActReply,
    "verdict-reply": VerdictReply,
    "proof-result": ProofResult,
    "blend": BlendPlan,
    "blend-reply": BlendReply,
    "evidence": EvidenceMeta,
}
MESSAGES: dict[str, type[BaseModel]] = _PUBLISHED | {
    f"{name}-request" if name in _PUBLISHED else name: command.request for name, command in COMMANDS.items()
}
"""By the name under which `lumpwatch schema` prints them; requests have that of their command."""


def message_schema(name: str) -> str:
    """The JSON Schema of one message as text."""
    return json.dumps(MESSAGES[name].model_json_schema(mode="serialization"), indent=2, sort_keys=True)
